"""Rotations and rigid motions: exponential and logarithm, quaternions (xyzw), differences of poses."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from stack.kinematics.arrays import Array, finite


def rotation_exp(vector: ArrayLike) -> Array:
    """Rotation (3, 3) by the angle |vector| about the vector (3,)."""
    rotation: Array = pin.exp3(finite("rotation vector", vector, (3,)))
    return rotation


def rotation_log(rotation: ArrayLike) -> Array:
    """Rotation vector (3,), its norm in [0, π]; of a half turn, one of the two."""
    x, y, z, w = quaternion_from_rotation(rotation)
    sine = math.sqrt(x * x + y * y + z * z)
    # atan2 keeps every digit near 0 and near π, where acos of the trace loses half of them.
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    return np.array([scale * x, scale * y, scale * z])


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Unit quaternion xyzw (4,), w ≥ 0, of a rotation (3, 3); pivots on its largest part (Shepperd)."""
    matrix = finite("rotation", rotation, (3, 3))
    xx, yy, zz = (float(matrix[i, i]) for i in range(3))
    squares = (1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz)
    k = squares.index(max(squares))
    # 4·q qᵀ in the order xyzw: its row k is the quaternion times four of its own k-th part.
    sums = matrix + matrix.T
    turns = (matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1])
    row = np.array([*turns, squares[3]]) if k == 3 else np.array([*sums[k], turns[k]])
    row[k] = squares[k]
    quaternion: Array = row / math.sqrt(float(row.dot(row)))
    return -quaternion if quaternion[3] < 0.0 else quaternion


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation (3, 3) of a quaternion xyzw (4,), normalised here; ValueError for the zero quaternion."""
    q = finite("quaternion", quaternion, (4,))
    norm = math.sqrt(float(q.dot(q)))
    if norm < 1e-12:
        raise ValueError("quaternion has norm zero, which is no rotation")
    x, y, z, w = q / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def pose_exp(twist: ArrayLike) -> Array:
    """Pose (4, 4) reached in unit time from the identity at the constant body twist (6,) `[v; ω]`."""
    pose: Array = pin.exp6(finite("twist", twist, (6,))).homogeneous
    return pose


def pose_log(pose: ArrayLike) -> Array:
    """Twist (6,) `[v; ω]` with `pose_exp(twist) = pose`, |ω| in [0, π]."""
    matrix = finite("pose", pose, (4, 4))
    omega = rotation_log(matrix[:3, :3])
    angle = math.sqrt(float(omega.dot(omega)))
    p = matrix[:3, 3]
    # Inverse of the left Jacobian of SO(3); its last factor tends to 1/12 at angle 0.
    half = 0.5 * angle
    factor = 1.0 / 12.0 + angle**2 / 720.0 if angle < 1e-3 else (1.0 - half / math.tan(half)) / angle**2
    turned = np.cross(omega, p)
    return np.concatenate((p - 0.5 * turned + factor * np.cross(omega, turned), omega))


def pose_matrix(rotation: ArrayLike, position: ArrayLike) -> Array:
    """(4, 4) from (3, 3) and (3,)."""
    pose = np.eye(4)
    pose[:3, :3] = finite("rotation", rotation, (3, 3))
    pose[:3, 3] = finite("position", position, (3,))
    return pose


def pose_inverse(pose: ArrayLike) -> Array:
    """Inverse of a rigid motion (4, 4)."""
    matrix = finite("pose", pose, (4, 4))
    transposed = matrix[:3, :3].T
    return pose_matrix(transposed, -transposed @ matrix[:3, 3])


def pose_difference(target: ArrayLike, actual: ArrayLike) -> Array:
    """(6,): way from `actual` to `target`, position and rotation vector, both in the axes of the common base frame."""
    a, b = finite("target", target, (4, 4)), finite("actual", actual, (4, 4))
    return np.concatenate((a[:3, 3] - b[:3, 3], rotation_log(a[:3, :3] @ b[:3, :3].T)))
