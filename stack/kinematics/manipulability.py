"""How freely a point can move: singular values, Yoshikawa's manipulability, the velocity ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stack.kinematics.arrays import Array, finite
from stack.kinematics.se3 import quaternion_from_rotation


def singular_values(jacobian: ArrayLike) -> Array:
    """(min(m, n),), in descending order."""
    j = _matrix(jacobian)
    return np.asarray(np.linalg.svd(j, compute_uv=False), dtype=np.float64)


def manipulability(jacobian: ArrayLike) -> float:
    """Product of the singular values of an (m, n) Jacobian, `√det(J Jᵀ)` for m ≤ n; 0 where it loses rank."""
    return float(np.prod(singular_values(jacobian)))


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """`centre` (3,), `half_sizes` (3,) along the ellipsoid's own axes (descending), their `quaternion` (4,) xyzw."""

    centre: Array
    half_sizes: Array
    quaternion: Array


def velocity_ellipsoid(jacobian: ArrayLike, centre: ArrayLike) -> Ellipsoid:
    """Velocities that joint velocities of norm 1 reach: image of the unit ball under a (3, n) block."""
    j = _matrix(jacobian)
    if j.shape[0] != 3:
        raise ValueError(f"jacobian has shape {j.shape}, expected (3, n)")
    axes, sizes, _ = np.linalg.svd(j, full_matrices=True)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] = -axes[:, 2]
    half_sizes = np.zeros(3)
    half_sizes[: sizes.size] = sizes
    return Ellipsoid(finite("centre", centre, (3,)).copy(), half_sizes, quaternion_from_rotation(axes))


def _matrix(jacobian: ArrayLike) -> Array:
    j = np.asarray(jacobian, dtype=np.float64)
    if j.ndim != 2:
        raise ValueError(f"jacobian has shape {j.shape}, expected (m, n)")
    return finite("jacobian", j, j.shape)
