"""What the thesis's list A1–A6 leaves out: motions of moma8 straight through F1, F2 and F3, planned with either set of potentials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stack.planner.singular_sets import AngleIs, ZeroOf
from stack.planner.singularities import singular_sets
from stack.strategic.trajectory import Objective, TrajectoryProblem, solve
from stack.strategic.trajectory.potentials import thesis_list
from stack.strategic.trajectory.problem import arm_model, limits_of

Vector = NDArray[np.float64]
WAYS = (Objective.NONE, Objective.LISTED_POTENTIALS, Objective.POTENTIALS)
CROSSED = {"F1": ("F1",), "F2": ("F2",), "F3": ("F3p",)}  # F3m has EL = π, outside the joint limits
AWAY = 0.25
"""rad between the crossing and the nearest of A1–A6 and L1–L4: nothing but the F set is met there."""
SOLVED_BY = 5
"""The joint (lower arm) that is turned until a formula vanishes."""
SPREAD = np.array([0.5, 0.1, 0.35, 0.6, 0.6, 0.6, 0.6, 0.5])
"""Farthest that start and target lie from the crossing, rad and m."""
LEAST_AT_ENDS = 0.02


def least_singular_value(q: Vector) -> float:
    """σ_min of moma8's 6×8 Jacobian."""
    return float(np.linalg.svd(arm_model("moma8").jacobian(q), compute_uv=False)[-1])


def on_set(name: str, rng: np.random.Generator) -> Vector:
    """A random configuration (8,) on a manifold, inside the limits and `AWAY` from every listed one."""
    sets, limits = singular_sets(arm_model("moma8")), limits_of("moma8")
    listed = [branch for branches in thesis_list("moma8").values() for branch in branches]
    listed += [branch for key, found in sets.items() if key.startswith("L") for branch in found.branches]
    while True:
        q = rng.uniform(limits.q_min, limits.q_max)
        branch = sets[name].branches[rng.integers(len(sets[name].branches))]
        for condition in branch:
            if isinstance(condition, AngleIs):
                q[condition.joint] -= condition(q)[0]
        formula = next(condition for condition in branch if isinstance(condition, ZeroOf))
        if not _solved(q, formula) or (q < limits.q_min).any() or (q > limits.q_max).any():
            continue
        if all(sum(condition(q)[0] ** 2 for condition in one) > AWAY**2 for one in listed):
            return q


def _solved(q: Vector, formula: ZeroOf) -> bool:
    """Turns one joint of `q` to a root of the formula; False where it has none between its limits."""
    limits = limits_of("moma8")

    def value(angle: float) -> float:
        q[SOLVED_BY] = angle
        return formula.polynomial.derivatives(q)[0]

    grid = np.linspace(limits.q_min[SOLVED_BY], limits.q_max[SOLVED_BY], 40)
    values = [value(angle) for angle in grid]
    for i in range(len(grid) - 1):
        if values[i] * values[i + 1] < 0.0:
            q[SOLVED_BY] = brentq(value, grid[i], grid[i + 1], xtol=1e-14)
            return True
    return False


def crossing_pair(name: str, seed: int) -> tuple[Vector, Vector]:
    """Start and target (8,), mirror images about a configuration on F1, F2 or F3 (`name`); both ends away from singularity."""
    rng, limits = np.random.default_rng([seed, *name.encode()]), limits_of("moma8")
    while True:
        middle = on_set(str(rng.choice(CROSSED[name])), rng)
        apart = rng.uniform(0.4, 1.0, 8) * rng.choice([-1.0, 1.0], 8) * SPREAD
        ends = middle - apart, middle + apart
        if any((q < limits.q_min).any() or (q > limits.q_max).any() for q in ends):
            continue
        if min(map(least_singular_value, ends)) > LEAST_AT_ENDS:
            return ends


@dataclass(frozen=True, eq=False)
class Motion:
    """`t` (s) and σ_min (samples,) each."""

    t: Vector
    sigma: Vector

    @property
    def least(self) -> float:
        return float(self.sigma.min())


def motions(name: str, seed: int, samples: int = 200) -> list[Motion] | None:
    """One for each of `WAYS` between the same two configurations; None if one of them was not solved."""
    start, goal = crossing_pair(name, seed)
    found = [solve(TrajectoryProblem("moma8", start, goal, objective=way)) for way in WAYS]
    if not all(trajectory.status.usable for trajectory in found):
        return None
    out = []
    for trajectory in found:
        t = np.linspace(0.0, trajectory.duration_s, samples)
        out.append(Motion(t, np.array([least_singular_value(trajectory.at(x)[0]) for x in t])))
    return out
