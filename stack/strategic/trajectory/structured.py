"""The structured solver: starts, the interior-point method, what to say about the result."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np

from stack.messages import Matrix, Vector
from stack.strategic.trajectory import interior, node_cost
from stack.strategic.trajectory.chain import chain_table
from stack.strategic.trajectory.potentials import Potentials, no_potentials, potentials
from stack.strategic.trajectory.problem import Objective, Status, Trajectory, TrajectoryLimits, TrajectoryProblem
from stack.strategic.trajectory.self_collision import cover, no_cover, sphere_gaps
from stack.strategic.trajectory.start import by_way_of, least_acceleration, moved

KINDS = {
    Objective.NONE: node_cost.PLAIN,
    Objective.MANIPULABILITY: node_cost.AWAY,
    Objective.POTENTIALS: node_cost.POTENTIAL,
    Objective.LISTED_POTENTIALS: node_cost.POTENTIAL,
}
FIRST_BARRIER = 1e-3
LAST_BARRIER = 1e-8
WARM_BARRIER = 1e-4
MOST_ITERATIONS = 300
WIDTH = 1e-6
"""How far (rad, m) positions between the nodes may pass a limit, and only that of a joint which starts or ends on it."""
OTHER_STEP = 0.35
"""Factor on the first step of a further start: where the nodes jump across a manifold decides which local optimum is found."""
BEND = 0.6
"""How far another one is bent towards the middle of the joint limits, as a share of the way there."""
DEAR, DEARER = 1.2, 1.6
"""A motion that costs this many times the first cubic without singularities is worth the bent start, and the other one, too."""
BETWEEN_NODES = 4
"""Configurations per step that are looked at for links that touch."""
Begin = tuple[Matrix, Matrix, Matrix, float]


def solve_structured(problem: TrajectoryProblem, guess: Trajectory | None = None) -> Trajectory:
    """A local optimum of the transcription; `guess` begins where an earlier solution was. Pure.

    Where potentials make it dear and no guess is given, the best of up to three starts. ValueError for a guess of another shape.
    """
    limits, goal = problem.limits, problem.q_goal
    assert isinstance(limits, TrajectoryLimits)
    assert isinstance(goal, np.ndarray)
    if not ((limits.q_min <= goal) & (goal <= limits.q_max)).all():
        return nothing(problem, Status.GOAL_OUTSIDE_LIMITS)
    if _cannot_stop(problem, limits):
        return nothing(problem, Status.START_CANNOT_STOP)
    shape = (problem.points, goal.size)
    if guess is not None and guess.q.shape != shape:
        raise ValueError(f"guess.q has shape {guess.q.shape}, must have {shape}: (points, joints) of the problem")
    best: Trajectory | None = None
    for begin, barrier in _starts(problem, limits, goal, guess):
        found = _run(problem, limits, begin, barrier)
        if best is None or _rank(found) < _rank(best):
            best = found
        if best.status is Status.SOLVED:
            break
    assert best is not None
    dearness = 0.0 if guess is not None else _dearness(problem, goal, best)
    for begin, dear in ((_bent(problem, limits, goal), DEAR), (_cubic(problem, goal, OTHER_STEP), DEARER)):
        if dearness > dear:
            found = _run(problem, limits, begin, FIRST_BARRIER)
            best = found if _rank(found) < _rank(best) else best
    return _apart(problem, best)


def _dearness(problem: TrajectoryProblem, goal: Vector, found: Trajectory) -> float:
    """How many times the first cubic without potentials `found` costs with them, its ends left out; 0 without potentials."""
    if KINDS[problem.objective] != node_cost.POTENTIAL:
        return 0.0
    q, _, a, h = _cubic(problem, goal, 1.0)
    weights, rest = problem.weights, cast(Any, arguments(problem))
    ends = sum(node_cost.node_value(node_cost.POTENTIAL, np.ascontiguousarray(end), *rest) for end in (q[0], q[-1]))
    plain = problem.points * h * weights.time + weights.acceleration * float(np.sum(a * a)) / h**4
    return float((found.objective - ends * weights.time) / plain)


def _apart(problem: TrajectoryProblem, found: Trajectory) -> Trajectory:
    """`found`, with a status that says so where its links could touch."""
    if problem.clearance is None or not found.status.usable:
        return found
    links, table = cover(problem.robot), chain_table(problem.robot)
    times = np.linspace(0.0, found.duration_s, BETWEEN_NODES * (len(found.q) - 1) + 1)
    touches = any(sphere_gaps(table, found.at(t)[0], links.spheres, links.pairs).min() < 0.0 for t in times)
    return replace(found, status=Status.COLLIDES) if touches else found


def _cannot_stop(problem: TrajectoryProblem, limits: TrajectoryLimits) -> bool:
    """Whether braking as hard as possible from now on ends outside the position limits, or the start is outside already."""
    start, speed = np.asarray(problem.q_start), np.asarray(problem.dq_start)
    ahead = start + 0.5 * speed * np.abs(speed) / limits.ddq_max
    low, high = np.minimum(start, ahead), np.maximum(start, ahead)
    return bool((low < limits.q_min).any() or (high > limits.q_max).any() or (np.abs(speed) > limits.dq_max).any())


def _rank(found: Trajectory) -> tuple[int, float]:
    order = {Status.SOLVED: 0, Status.ACCEPTABLE: 1}
    return order.get(found.status, 2), found.objective


def _starts(
    problem: TrajectoryProblem, limits: TrajectoryLimits, goal: Vector, guess: Trajectory | None
) -> list[tuple[Begin, float]]:
    start, dq_start, dq_goal = np.asarray(problem.q_start), np.asarray(problem.dq_start), np.asarray(problem.dq_goal)
    starts: list[tuple[Begin, float]] = []
    if guess is not None:
        q, w, a = moved(guess, start, dq_start, goal, dq_goal)
        h = max(float(guess.step_s * (problem.points - 1 - _nearest(guess, start)) / (problem.points - 1)), 1e-3)
        starts.append(((*_again(q, w, a, h, start, dq_start, goal, dq_goal), h), WARM_BARRIER))
    starts += [(_cubic(problem, goal, longer), FIRST_BARRIER) for longer in (1.0, 2.0, 4.0)]
    return starts


def _cubic(problem: TrajectoryProblem, goal: Vector, longer: float) -> Begin:
    """The motion of least acceleration in `longer` times the first step."""
    h = longer * first_step(problem)
    dq_start, dq_goal = np.asarray(problem.dq_start), np.asarray(problem.dq_goal)
    q, w, a = least_acceleration(np.asarray(problem.q_start), h * dq_start, goal, h * dq_goal, problem.points)
    return q, w, a, h


def _bent(problem: TrajectoryProblem, limits: TrajectoryLimits, goal: Vector) -> Begin:
    """By way of a configuration nearer to the middle of the limits."""
    h, start = first_step(problem), np.asarray(problem.q_start)
    half_way = 0.5 * (start + goal)
    via = half_way + BEND * (0.5 * (limits.q_min + limits.q_max) - half_way)
    dq_start, dq_goal = np.asarray(problem.dq_start), np.asarray(problem.dq_goal)
    return *by_way_of(via, start, h * dq_start, goal, h * dq_goal, problem.points), h


def first_step(problem: TrajectoryProblem) -> float:
    """Step (s) of the cubic to begin with: the best one without singularities, or as long as speed and acceleration want it."""
    limits, start, goal = problem.limits, np.asarray(problem.q_start), np.asarray(problem.q_goal)
    assert isinstance(limits, TrajectoryLimits)
    reach = np.abs(goal - start)
    stages = problem.points - 1
    h_speed = float((1.5 * reach / limits.dq_max).max()) / stages
    h_push = float(np.sqrt((6.0 * reach / limits.ddq_max).max())) / stages
    energy = 12.0 * float(reach @ reach) / stages**3 * problem.weights.acceleration
    h_best = (4.0 * energy / (problem.weights.time * problem.points)) ** 0.2
    return max(1.1 * h_speed, 1.1 * h_push, float(h_best), 1e-2)


def _nearest(guess: Trajectory, start: Vector) -> int:
    return int(np.argmin(((guess.q[: len(guess.q) - 2] - start) ** 2).sum(axis=1)))


def _again(
    q: Matrix, w: Matrix, a: Matrix, h: float, start: Vector, dq_start: Vector, goal: Vector, dq_goal: Vector
) -> tuple[Matrix, Matrix, Matrix]:
    """With ends exactly those of the problem."""
    dq, dw, da = least_acceleration(start - q[0], h * dq_start - w[0], goal - q[-1], h * dq_goal - w[-1], len(q))
    return q + dq, w + dw, a + da


def _table(problem: TrajectoryProblem) -> Potentials:
    if problem.objective is Objective.POTENTIALS:
        return potentials(problem.robot)
    if problem.objective is Objective.LISTED_POTENTIALS:
        return potentials(problem.robot, listed=True)
    return no_potentials(np.asarray(problem.q_start).size)


def arguments(problem: TrajectoryProblem) -> tuple[Any, ...]:
    """What the kernels want: chain, potentials, shape, spheres; the objective in units of `weights.time`."""
    table, weights = _table(problem), problem.weights
    links = no_cover() if problem.clearance is None else cover(problem.robot)
    singular = [weights.singularity / weights.time, weights.epsilon, weights.height, weights.steepness]
    shape = np.array([*singular, problem.clearance or 1.0, weights.collision / weights.time])
    return (
        chain_table(problem.robot), table.frequencies, table.cosines, table.sines, table.conditions, table.sets, shape,
        links.spheres, links.pairs,
    )  # fmt: skip


def _run(problem: TrajectoryProblem, limits: TrajectoryLimits, begin: Begin, barrier: float) -> Trajectory:
    q, w, a = (np.array(x, order="C") for x in begin[:3])
    position = np.stack([limits.q_min, limits.q_max], axis=1)
    speed, push = (np.stack([-x, x], axis=1) for x in (limits.dq_max, limits.ddq_max))
    # An end on its limit is a control point itself: without this width its slack would be zero for good.
    ends = np.stack([np.asarray(problem.q_start), np.asarray(problem.q_goal)])
    between = np.stack(
        [np.minimum(limits.q_min, ends.min(axis=0) - WIDTH), np.maximum(limits.q_max, ends.max(axis=0) + WIDTH)], axis=1
    )
    bounds = np.stack([position, speed, push, between])
    kind, weights = KINDS[problem.objective], problem.weights
    rest: Any = arguments(problem)
    interior_point: Any = interior.interior_point  # its arguments come in bundles
    numbers = interior_point(
        kind, q, w, a, begin[3], np.array(problem.dq_start), np.array(problem.dq_goal), bounds, 1.0,
        weights.acceleration / weights.time, *rest, barrier, LAST_BARRIER, MOST_ITERATIONS,
    )  # fmt: skip
    h, value = float(numbers[interior.H]), float(numbers[interior.VALUE])
    for end in (q[0], q[-1]):
        value += node_cost.node_value(kind, np.ascontiguousarray(end), *rest)
    stationarity = float(numbers[interior.DECREMENT]) / (1.0 + abs(value))
    infeasibility, barrier_end = float(numbers[interior.RESIDUAL]), float(numbers[interior.BARRIER])
    status = Status.STALLED
    if barrier_end <= LAST_BARRIER and stationarity <= 1e-7 and infeasibility <= 1e-8:
        status = Status.SOLVED
    elif infeasibility <= 1e-6 and stationarity <= 1e-2:
        status = Status.ACCEPTABLE
    ddq = np.vstack([a / h**2, np.zeros(a.shape[1])])
    return Trajectory(
        q, w / h, ddq, problem.points * h, status, int(numbers[interior.ITERATIONS]), value * weights.time,
        stationarity, infeasibility, float(numbers[interior.GAP]) + barrier_end,
    )  # fmt: skip


def nothing(problem: TrajectoryProblem, status: Status) -> Trajectory:
    """No motion at all: the start, held."""
    q = np.tile(np.asarray(problem.q_start), (problem.points, 1))
    still = np.zeros_like(q)
    return Trajectory(q, still, still, 0.0, status, 0, float("inf"), float("inf"), float("inf"), float("inf"))
