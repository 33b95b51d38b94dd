"""Kinematics of a serial arm from its DH rows, compiled: Jacobian, manipulability and its gradient."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.strategic.trajectory.problem import arm_model


@lru_cache(maxsize=16)
def chain_table(robot: str) -> Matrix:
    """(n, 5): revolute (1 or 0), d, a, cos α, sin α of every row."""
    rows = arm_model(robot).description.joints
    return np.array([[float(r.revolute), r.d, r.a, math.cos(r.alpha), math.sin(r.alpha)] for r in rows])


@compiled
def chain_jacobian(table: Matrix, q: Vector, jacobian: Matrix) -> Matrix:
    """Fills `jacobian` (6, n), rows [v; ω] at the end of the last row, base frame; the end's pose (4, 4)."""
    n = q.size
    pose = np.eye(4)
    origins = np.empty((n, 3))
    axes = np.empty((n, 3))
    for i in range(n):
        for r in range(3):
            origins[i, r] = pose[r, 3]
            axes[i, r] = pose[r, 2]
        revolute = table[i, 0] > 0.5
        c, s = (math.cos(q[i]), math.sin(q[i])) if revolute else (1.0, 0.0)
        d = table[i, 1] if revolute else table[i, 1] + q[i]
        a, ca, sa = table[i, 2], table[i, 3], table[i, 4]
        for r in range(3):
            x, y, z = pose[r, 0], pose[r, 1], pose[r, 2]
            along = c * x + s * y
            across = -s * x + c * y
            pose[r, 3] += d * z + a * along
            pose[r, 0] = along
            pose[r, 1] = ca * across + sa * z
            pose[r, 2] = -sa * across + ca * z
    for i in range(n):
        zx, zy, zz = axes[i, 0], axes[i, 1], axes[i, 2]
        if table[i, 0] > 0.5:
            rx, ry, rz = pose[0, 3] - origins[i, 0], pose[1, 3] - origins[i, 1], pose[2, 3] - origins[i, 2]
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = zx, zy, zz
        else:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = zx, zy, zz
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0
    return pose


@compiled
def manipulability_gradient(table: Matrix, q: Vector, gradient: Vector) -> float:
    """m = √det(J Jᵀ) and, in `gradient` (n,), `∂m/∂q_k = m · trace((J Jᵀ)⁻¹ ∂J/∂q_k Jᵀ)`; zero where m is (m has no gradient there).

    With A = Jᵀ (J Jᵀ)⁻¹: column i of J turns by axis k where k lies before i (∂J_i = ω_k × J_i), and its linear half by
    axis i where k lies behind it (∂v_i/∂q_k = ω_i × v_k).
    """
    n = q.size
    j = np.empty((6, n))
    chain_jacobian(table, q, j)
    gram = np.zeros((6, 6))
    for r in range(6):
        for c in range(r + 1):
            total = 0.0
            for i in range(n):
                total += j[r, i] * j[c, i]
            gram[r, c] = total
    m = 1.0
    for r in range(6):  # Cholesky, in place
        for c in range(r + 1):
            total = gram[r, c]
            for k in range(c):
                total -= gram[r, k] * gram[c, k]
            if r == c:
                if total <= 1e-28:
                    gradient[:] = 0.0
                    return 0.0
                gram[r, r] = math.sqrt(total)
                m *= gram[r, r]
            else:
                gram[r, c] = total / gram[c, c]
    back = np.empty((6, n))  # (J Jᵀ)⁻¹ J
    for i in range(n):
        for r in range(6):
            total = j[r, i]
            for k in range(r):
                total -= gram[r, k] * back[k, i]
            back[r, i] = total / gram[r, r]
        for r in range(5, -1, -1):
            total = back[r, i]
            for k in range(r + 1, 6):
                total -= gram[k, r] * back[k, i]
            back[r, i] = total / gram[r, r]
    for k in range(n):
        total = 0.0
        kx, ky, kz = j[3, k], j[4, k], j[5, k]
        for i in range(n):
            if k <= i:
                vx, vy, vz = j[0, i], j[1, i], j[2, i]
                total += back[0, i] * (ky * vz - kz * vy)
                total += back[1, i] * (kz * vx - kx * vz)
                total += back[2, i] * (kx * vy - ky * vx)
                if k < i:
                    wx, wy, wz = j[3, i], j[4, i], j[5, i]
                    total += back[3, i] * (ky * wz - kz * wy)
                    total += back[4, i] * (kz * wx - kx * wz)
                    total += back[5, i] * (kx * wy - ky * wx)
            else:
                wx, wy, wz = j[3, i], j[4, i], j[5, i]
                vx, vy, vz = j[0, k], j[1, k], j[2, k]
                total += back[0, i] * (wy * vz - wz * vy)
                total += back[1, i] * (wz * vx - wx * vz)
                total += back[2, i] * (wx * vy - wy * vx)
        gradient[k] = m * total
    return m
