"""The random pairs of Beck et al., and what is measured on a trajectory between two of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from canipulator.campaigns.campaign import unit_generator
from stack.kinematics import ArmModel

Vector = NDArray[np.float64]

LEAST_MANIPULABILITY = 1e-4
"""A start or target below it is drawn again (the paper's rule)."""


@dataclass(frozen=True, slots=True)
class Pair:
    """`start` and `target` (n,), rad; the smaller of their two `manipulability`; how many pairs were `rejected` before."""

    start: Vector
    target: Vector
    manipulability: float
    rejected: int


def draw_pair(arm: ArmModel, seed: int, index: int) -> Pair:
    """Pair number `index` of a robot: uniform inside its joint limits, both ends at least `LEAST_MANIPULABILITY`."""
    generator, rejected = unit_generator(seed, arm.name, index), 0
    while True:
        ends = arm.q_min + (arm.q_max - arm.q_min) * generator.random((2, arm.n))
        least = float(manipulability(arm, ends).min())
        if least >= LEAST_MANIPULABILITY:
            return Pair(ends[0], ends[1], least, rejected)
        rejected += 1


def manipulability(arm: ArmModel, q: ArrayLike) -> Vector:
    """(N,) of the rows of `q` (N, n): the product of the Jacobian's singular values, exact to rounding near zero, too."""
    jacobians = np.array([arm.jacobian(row) for row in np.asarray(q)])
    products: Vector = np.linalg.svd(jacobians, compute_uv=False).prod(axis=1)
    return products


@dataclass(frozen=True, slots=True)
class Measured:
    """Equations (28–32) on the N nodes: least, greatest and mean manipulability, length of the TCP's path (m), of its rotation (rad)."""

    m_min: float
    m_max: float
    m_avg: float
    path_m: float
    rotation_rad: float


def measure(arm: ArmModel, q: ArrayLike) -> Measured:
    """Of the nodes `q` (N, n). The rotation between two nodes is the shortest; the paper's counts sign flips of the quaternion on top."""
    rows = np.asarray(q, dtype=np.float64)
    m = manipulability(arm, rows)
    poses = np.array([arm.pose(row) for row in rows])
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    turns = np.einsum("kji,kjl->kil", poses[:-1, :3, :3], poses[1:, :3, :3])
    axis = np.stack([turns[:, 2, 1] - turns[:, 1, 2], turns[:, 0, 2] - turns[:, 2, 0], turns[:, 1, 0] - turns[:, 0, 1]])
    angles = np.arctan2(np.linalg.norm(axis, axis=0), np.trace(turns, axis1=1, axis2=2) - 1.0)
    return Measured(float(m.min()), float(m.max()), float(m.mean()), float(steps.sum()), float(angles.sum()))
