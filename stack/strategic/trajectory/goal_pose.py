"""Configurations that have a given TCP pose, nearest to the start first, by damped Newton from many seeds."""

from __future__ import annotations

import numpy as np

from stack.kinematics.se3 import pose_inverse
from stack.messages import Matrix, Vector
from stack.strategic.trajectory.chain import chain_jacobian, chain_table
from stack.strategic.trajectory.problem import TrajectoryLimits

SEEDS = 40
STEPS = 60
CLOSE = 1e-9
APART = 0.05
"""Configurations nearer to each other than this (rad, largest joint) count as one."""


def goal_configurations(robot: str, pose: Matrix, start: Vector, limits: TrajectoryLimits) -> list[Vector]:
    """(n,) each, inside the limits, pose met to 1e-9 (m, rad); nearest first, by the time at full speed. Same inputs, same list."""
    table, seeds = chain_table(robot), np.random.default_rng(1).random((SEEDS, start.size))
    seeds = limits.q_min + seeds * (limits.q_max - limits.q_min)
    found: list[Vector] = []
    for seed in [start, *seeds]:
        q = _descend(table, pose, seed.copy(), limits)
        if q is not None and all(np.abs(q - other).max() > APART for other in found):
            found.append(q)
    return sorted(found, key=lambda q: float((np.abs(q - start) / limits.dq_max).max()))


def _descend(table: Matrix, pose: Matrix, q: Vector, limits: TrajectoryLimits) -> Vector | None:
    jacobian = np.empty((6, q.size))
    for _ in range(STEPS):
        here = chain_jacobian(table, q, jacobian)
        error = _error(here, pose)
        size = float(np.abs(error).max())
        if size < CLOSE:
            return q
        gram = jacobian @ jacobian.T + min(1e-2, size * size) * np.eye(6)
        step = jacobian.T @ np.linalg.solve(gram, error)
        step *= min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
        q = np.clip(q + step, limits.q_min, limits.q_max)
    return None


def _error(here: Matrix, pose: Matrix) -> Vector:
    """(6,) twist from `here` to `pose`, base frame."""
    turn = pose[:3, :3] @ pose_inverse(here)[:3, :3]
    axis = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = float(np.linalg.norm(axis)), 0.5 * (float(np.trace(turn)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine < 1e-9 and cosine < 0.0:
        # Half a turn: any axis of it will do to leave this point.
        axis, sine = np.array([1.0, 0.0, 0.0]), 1.0
    return np.concatenate([pose[:3, 3] - here[:3, 3], axis * (angle / sine if sine > 1e-12 else 1.0)])
