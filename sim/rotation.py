"""Poses as PyBullet gives them (position, quaternion xyzw) and as the rest of the world has them (4, 4)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stack.messages import Matrix, Vector


def pose_of(position: Sequence[float], quaternion: Sequence[float]) -> Matrix:
    """(4, 4) from a position (3,) and a unit quaternion xyzw."""
    x, y, z, w = quaternion
    px, py, pz = position
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), px],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), py],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), pz],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def inverse(pose: Matrix) -> Matrix:
    """Inverse of a rigid transform (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def quaternion_of(rotation: Matrix) -> list[float]:
    """Unit quaternion xyzw of a rotation (3, 3), w >= 0 (Shepperd's method: the largest component first)."""
    trace = float(np.trace(rotation))
    four = np.array([*(1.0 + 2.0 * np.diag(rotation) - trace), 1.0 + trace])  # 4x², 4y², 4z², 4w²
    largest = int(np.argmax(four))
    r = rotation
    rows = (
        (four[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]),
        (r[0, 1] + r[1, 0], four[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]),
        (r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], four[2], r[1, 0] - r[0, 1]),
        (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], four[3]),
    )
    quaternion = np.array(rows[largest]) / (2.0 * np.sqrt(four[largest]))
    if quaternion[3] < 0.0:
        quaternion = -quaternion
    return [float(value) for value in quaternion]


def cross(a: Sequence[float] | Vector, b: Sequence[float] | Vector) -> Vector:
    """a x b (3,); a tenth of the cost of numpy.cross."""
    ax, ay, az = a
    bx, by, bz = b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def rotation_vector_of(rotation: Matrix) -> Vector:
    """Axis times angle (3,) of a rotation (3, 3); the angle is in [0, pi]."""
    quaternion = np.array(quaternion_of(rotation))
    sine = float(np.linalg.norm(quaternion[:3]))
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, quaternion[3]) / sine
    vector: Vector = scale * quaternion[:3]
    return vector


def rotation_of(vector: Sequence[float] | Vector) -> Matrix:
    """Rotation (3, 3) from a rotation vector (3,) (Rodrigues)."""
    v = np.asarray(vector, dtype=np.float64)
    angle = float(np.linalg.norm(v))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = v / angle
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Matrix = np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew
    return rotation
