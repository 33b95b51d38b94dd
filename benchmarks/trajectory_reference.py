"""The same transcription for IPOPT and fatrop, by CasADi (only the benchmarks need it): same objective, limits, control points."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from stack.strategic.trajectory import Objective, TrajectoryProblem
from stack.strategic.trajectory.chain import chain_table
from stack.strategic.trajectory.potentials import potentials
from stack.strategic.trajectory.start import least_acceleration


@dataclass(frozen=True)
class Answer:
    """`objective` in the weights of the problem, `seconds` of the solver's call alone."""

    converged: bool
    objective: float
    t_f: float
    seconds: float
    iterations: int


class Reference:
    """One solver for one robot and objective; end states are parameters, so that nothing is built again for the next pair."""

    def __init__(self, like: TrajectoryProblem, solver: str) -> None:
        self.n, self.points, self.solver = np.asarray(like.q_start).size, like.points, solver
        self.weights, limits = like.weights, like.limits
        n, stages = self.n, self.points - 1
        cost = _node_cost(like)
        ends = ca.SX.sym("ends", 4 * n)
        first, last = ends[: 2 * n], ends[2 * n :]
        x, u, g, low, high, equal = [], [], [], [], [], []

        def add(value: Any, lower: Any, upper: Any) -> None:
            g.append(value)
            lower, upper = np.broadcast_to(lower, value.shape[0]), np.broadcast_to(upper, value.shape[0])
            low.extend(lower)
            high.extend(upper)
            equal.extend(bool(a == b) for a, b in zip(lower, upper, strict=True))

        # fatrop wants the step as a state of every stage; IPOPT gets it as one unknown.
        staged = solver == "fatrop"
        size = 2 * n + 1 if staged else 2 * n
        order = []
        for k in range(self.points):
            x.append(ca.SX.sym(f"x{k}", size))
            order.append(x[-1])
            if k < stages:
                u.append(ca.SX.sym(f"u{k}", n))
                order.append(u[-1])
        single = ca.SX.sym("h")
        total = 0
        for k in range(self.points):
            h = x[k][2 * n] if staged else single
            q, v = x[k][:n], x[k][n : 2 * n]
            if k < stages:
                following = [q + h * v + 0.5 * h**2 * u[k], v + h * u[k]] + ([h] if staged else [])
                add(x[k + 1] - ca.vertcat(*following), 0.0, 0.0)
            if k == 0:
                add(x[k][: 2 * n] - first, 0.0, 0.0)
            elif k == stages:
                add(x[k][: 2 * n] - last, 0.0, 0.0)
            else:
                add(q, limits.q_min, limits.q_max)
                add(v, -limits.dq_max, limits.dq_max)
            if k < stages:
                add(u[k], -limits.ddq_max, limits.ddq_max)
                add(q + 0.5 * h * v, limits.q_min, limits.q_max)
                total += self.weights.acceleration / self.weights.time * ca.sumsqr(u[k])
            if 0 < k < stages:
                total += cost(q) / self.weights.time
            if staged and k == stages:
                add(h, 1e-4, np.inf)
        total += self.points * (x[-1][2 * n] if staged else single)
        if not staged:
            order.append(single)
            add(single, 1e-4, np.inf)
        self.cost = ca.Function("cost", [x[0][:n]], [cost(x[0][:n])])
        problem = {"x": ca.vertcat(*order), "p": ends, "f": total, "g": ca.vertcat(*g)}
        options: dict[str, Any] = {"expand": True, "print_time": False, "error_on_fail": False}
        if solver == "ipopt":
            options |= {"ipopt": {"print_level": 0, "sb": "yes", "max_iter": 1000}}
        else:
            options |= {
                "structure_detection": "auto",
                "equality": equal,
                "fatrop": {"print_level": 0, "max_iter": 1000},
            }
        self.low, self.high = np.array(low), np.array(high)
        self.call = ca.nlpsol("reference", solver, problem, options)

    def solve(self, problem: TrajectoryProblem) -> Answer:
        """From the cubic that the structured solver also begins with."""
        start, goal = np.asarray(problem.q_start), np.asarray(problem.q_goal)
        dq_start, dq_goal = np.asarray(problem.dq_start), np.asarray(problem.dq_goal)
        h = first_step(problem)
        q, w, a = least_acceleration(start, h * dq_start, goal, h * dq_goal, self.points)
        guess: list[float] = []
        staged = [h] if self.solver == "fatrop" else []
        for k in range(self.points):
            guess += [*q[k], *(w[k] / h), *staged]
            if k < self.points - 1:
                guess += [*(a[k] / h**2)]
        guess += [] if staged else [h]
        ends = np.concatenate([start, dq_start, goal, dq_goal])
        began = perf_counter()
        found = self.call(x0=guess, p=ends, lbg=self.low, ubg=self.high)
        seconds = perf_counter() - began
        stats = self.call.stats()
        value = float(found["f"]) * self.weights.time + float(self.cost(start)) + float(self.cost(goal))
        step = float(found["x"][2 * self.n] if staged else found["x"][-1])
        return Answer(bool(stats["success"]), value, step * self.points, seconds, int(stats.get("iter_count", -1)))


def first_step(problem: TrajectoryProblem) -> float:
    from stack.strategic.trajectory.structured import first_step as ours

    return ours(problem)


def _node_cost(like: TrajectoryProblem) -> Any:
    weights = like.weights
    if like.objective is Objective.NONE:
        return lambda q: ca.SX(0.0)
    if like.objective is Objective.MANIPULABILITY:
        return lambda q: weights.singularity / (_manipulability(chain_table(like.robot), q) + weights.epsilon)
    table = potentials(like.robot, listed=like.objective is Objective.LISTED_POTENTIALS)

    def cost(q: Any) -> Any:
        total = 0
        for first, last in zip(table.sets[:-1], table.sets[1:], strict=True):
            psi = 0
            for j in range(first, last):
                r = 0
                for t in range(table.conditions[j], table.conditions[j + 1]):
                    phase = sum(float(k) * q[i] for i, k in enumerate(table.frequencies[t]) if k != 0.0)
                    r += table.cosines[t] * ca.cos(phase) + table.sines[t] * ca.sin(phase)
                psi += r**2
            total += ca.exp(np.log(weights.height) - weights.steepness * psi)
        return weights.singularity * total

    return cost


def _manipulability(table: Any, q: Any) -> Any:
    pose = ca.SX.eye(4)
    frames = []
    for i, (revolute, d, a, ca_, sa) in enumerate(table):
        frames.append(pose)
        c, s = (ca.cos(q[i]), ca.sin(q[i])) if revolute else (1.0, 0.0)
        lift = d if revolute else d + q[i]
        rows = [[c, -s * ca_, s * sa, a * c], [s, c * ca_, -c * sa, a * s], [0, sa, ca_, lift], [0, 0, 0, 1]]
        pose = pose @ ca.vertcat(*[ca.horzcat(*row) for row in rows])
    columns = []
    for i, frame in enumerate(frames):
        axis = frame[:3, 2]
        arm = ca.cross(axis, pose[:3, 3] - frame[:3, 3])
        columns.append(ca.vertcat(arm, axis) if table[i][0] else ca.vertcat(axis, ca.SX.zeros(3)))
    jacobian = ca.horzcat(*columns)
    return ca.sqrt(ca.det(jacobian @ jacobian.T))
