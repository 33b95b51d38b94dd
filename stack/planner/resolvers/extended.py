"""Mobile manipulators: the null space of `[J_arm | j_v | j_ω]` from the arm's own SVD (4.10-4.20), and a whole-robot step on it."""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.planner.limits import Flags
from stack.planner.problem import EPSILON, Matrix, Vector
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.nullspace import particular, whiten
from stack.planner.resolvers.step import Step, step_in_null_space, with_singularity


@compiled
def extended_base(u: Matrix, sigma: Vector, vt: Matrix, columns: Matrix, epsilon: float) -> Matrix:
    """Orthonormal null-space base (n − m + 2, n + 2), as rows, of `[J | j_v | j_ω]`, from the SVD of J (m, n); columns (m, 2).

    With a = J⁺ j_v, b = J⁺ j_ω: `[N, 0]`, `(−a, 1, 0)` and `(−(b + β a), β, 1)`, normalised, β = −a·b/(1 + a·a).
    Where J has a singular value below ε its propped inverse is used: the rows stay finite and orthonormal, but the extended matrix
    maps the last two to a small twist instead of zero.
    """
    m = sigma.shape[0]
    n = vt.shape[1]
    r = n - m
    base = np.zeros((r + 2, n + 2))
    base[:r, :n] = vt[m:]
    a, _ = particular(u, sigma, vt, np.ascontiguousarray(columns[:, 0]), epsilon)
    b, _ = particular(u, sigma, vt, np.ascontiguousarray(columns[:, 1]), epsilon)
    aa = 1.0
    ab = 0.0
    for i in range(n):
        aa += a[i] * a[i]
        ab += a[i] * b[i]
    beta = -ab / aa
    length = 0.0
    for i in range(n):
        base[r, i] = -a[i] / math.sqrt(aa)
        base[r + 1, i] = -(b[i] + beta * a[i])
        length += base[r + 1, i] ** 2
    base[r, n] = 1.0 / math.sqrt(aa)
    length = math.sqrt(length + beta * beta + 1.0)
    base[r + 1, n] = beta
    base[r + 1, n + 1] = 1.0
    for i in range(n + 2):
        base[r + 1, i] /= length
    return base


@compiled
def extended_split(
    arm_jacobian: Matrix, columns: Matrix, xdot: Vector, weight: Matrix, z: Vector, epsilon: float
) -> tuple[Matrix, Vector, Matrix, Vector, bool]:
    """(J_ext, q̇_p, P, σ of the arm, propped) of the whole robot: from the arm's SVD where the arm is regular, `[J⁺ẋ, 0, 0]` being the
    particular solution; from an SVD of the extended matrix where the arm is singular, so that the platform can stand in for it.
    Both agree at the threshold, where neither is damped."""
    m, n = arm_jacobian.shape
    jacobian = np.empty((m, n + 2))
    jacobian[:, :n] = arm_jacobian
    jacobian[:, n:] = columns
    u, sigma, vt = decompose(arm_jacobian)
    dq_particular = np.zeros(n + 2)
    if sigma[m - 1] >= epsilon:
        part, _ = particular(u, sigma, vt, xdot, epsilon)
        dq_particular[:n] = part
        return jacobian, dq_particular, whiten(extended_base(u, sigma, vt, columns, epsilon), weight), sigma, False
    u_ext, sigma_ext, vt_ext = decompose(jacobian)
    dq_particular, propped = particular(u_ext, sigma_ext, vt_ext, xdot, epsilon)
    return jacobian, dq_particular, whiten(vt_ext[m:], weight), sigma, propped


@compiled
def _extended_step(
    arm_jacobian: Matrix,
    columns: Matrix,
    xdot: Vector,
    q: Vector,
    z: Vector,
    weight: Matrix,
    table: Matrix,
    rows: Matrix,
    values: Vector,
    epsilon: float,
    epsilon_restriction: float,
    recovery_rate: float,
) -> tuple[Vector, Vector, Vector, Flags, float, float, int, int]:
    jacobian, dq_particular, white, sigma, propped = extended_split(arm_jacobian, columns, xdot, weight, z, epsilon)
    dq, first, limited, scale, null_scale, status, bound = step_in_null_space(
        jacobian, dq_particular, white, weight, z, q, table, rows, values, epsilon_restriction, recovery_rate
    )
    return dq, first, sigma, limited, scale, null_scale, with_singularity(status, propped), bound


def extended_step(
    arm_jacobian: Matrix,
    columns: Matrix,
    xdot: Vector,
    q: Vector,
    z: Vector,
    weight: Matrix,
    table: Matrix,
    rows: Matrix,
    values: Vector,
    epsilon: float = EPSILON,
    epsilon_restriction: float = 1e-4,
    recovery_rate: float = 2.0,
) -> Step:
    """Velocities `[q̇; v; ω]` (n + 2,) of one platform cycle. No checks; arrays as in `arm_step`, of width n + 2.

    arm_jacobian (m, n), columns (m, 2): j_v and j_ω in the same frame; q (n + 2,): joint positions, the last two anything finite
    (their limits in `table` are infinite); z (n + 2,): preferred velocities. `Step.sigma` is that of the
    arm alone. For a platform on a fixed path, take `arm_step` on `[J_arm | j_s]` instead.
    """
    return Step(
        *_extended_step(
            np.ascontiguousarray(arm_jacobian),
            np.ascontiguousarray(columns),
            xdot,
            q,
            z,
            weight,
            table,
            rows,
            values,
            epsilon,
            epsilon_restriction,
            recovery_rate,
        )
    )
