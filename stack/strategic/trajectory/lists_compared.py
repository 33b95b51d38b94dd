"""What the exact manifolds F1–F3 change against the thesis's list A1–A6: pairs of moma8 whose straight way crosses F1."""

from __future__ import annotations

import numpy as np

from stack.messages import Vector
from stack.strategic.trajectory.problem import Objective, Trajectory, TrajectoryProblem, arm_model, limits_of
from stack.strategic.trajectory.solve import solve


def crossing_pair(seed: int) -> tuple[Vector, Vector]:
    """Start and target (8,) inside the limits, mirror images about a configuration on F1 away from A1–A6."""
    rng, limits = np.random.default_rng(seed), limits_of("moma8")
    while True:
        ua, el = rng.uniform(0.4, 1.1, 2) * rng.choice([-1.0, 1.0], 2)
        la = -np.arctan(np.tan(ua) * np.cos(el))
        middle = np.array([rng.uniform(-1, 1), rng.uniform(0.6, 0.9), 0.0, ua, el, la, 0.0, rng.uniform(-1, 1)])
        apart = rng.uniform(-0.5, 0.5, 8) * np.array([1, 0.2, 0.5, 1, 1, 1, 1, 1])
        start, goal = middle - apart, middle + apart
        inside = [(limits.q_min < q).all() and (q < limits.q_max).all() for q in (start, goal)]
        if all(inside):
            return start, goal


def least_singular_value(found: Trajectory, samples: int = 200) -> float:
    """The smallest σ_min of the 6×8 Jacobian on the way."""
    arm = arm_model("moma8")
    way = [found.at(t)[0] for t in np.linspace(0.0, found.duration_s, samples)]
    return min(float(np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1]) for q in way)


def compare_lists(pairs: int) -> Vector:
    """(pairs, 3): least σ_min on the way with no potentials, with those of A1–A6, with the exact ones."""
    rows = []
    for seed in range(pairs):
        start, goal = crossing_pair(seed)
        ways = (Objective.NONE, Objective.LISTED_POTENTIALS, Objective.POTENTIALS)
        rows.append(
            [least_singular_value(solve(TrajectoryProblem("moma8", start, goal, objective=way))) for way in ways]
        )
    return np.array(rows)
