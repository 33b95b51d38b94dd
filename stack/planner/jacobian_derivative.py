"""How a serial arm's geometric Jacobian changes with its joints, and Yoshikawa's measure with its derivatives, without differences.

Everything follows from the columns of the Jacobian alone: a joint before joint i turns its column, one behind it moves the point that
the column belongs to. No further pass through the kinematic model is needed, so second derivatives cost some ten µs.
Kernels, pure and compiled; arrays float64 and C-contiguous.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.resolvers.decomposition import decompose

Tensor = NDArray[np.float64]
Rows = NDArray[np.int64]


@compiled
def _add_cross(out: Vector, a: Vector, b: Vector) -> None:
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@compiled
def jacobian_derivative(jacobian: Matrix) -> Tensor:
    """(n, 6, n): entry j is ∂J/∂q_j of a geometric Jacobian (6, n) with rows `[v; ω]` in the axes of the arm's base.

    Columns are the joints in the order of the chain, revolute or prismatic (ω = 0). In units of J per rad or m.
    """
    n = jacobian.shape[1]
    columns = np.ascontiguousarray(jacobian.T)
    out = np.zeros((n, n, 6))
    for j in range(n):
        for i in range(n):
            if j <= i:
                _add_cross(out[j, i, :3], columns[j, 3:], columns[i, :3])
                _add_cross(out[j, i, 3:], columns[j, 3:], columns[i, 3:])
            else:
                _add_cross(out[j, i, :3], columns[i, 3:], columns[j, :3])
    return np.ascontiguousarray(out.transpose(0, 2, 1))


@compiled
def _second_derivative(columns: Matrix, along: Matrix, j: int, out: Matrix) -> None:
    """Columns (n, 6) of ∂(∂J/∂q_j)/∂q_b into `out`; `columns` (n, 6) of J, `along` (n, 6) of ∂J/∂q_b."""
    n = columns.shape[0]
    out[:] = 0.0
    for i in range(n):
        if j <= i:
            _add_cross(out[i, :3], along[j, 3:], columns[i, :3])
            _add_cross(out[i, :3], columns[j, 3:], along[i, :3])
            _add_cross(out[i, 3:], along[j, 3:], columns[i, 3:])
            _add_cross(out[i, 3:], columns[j, 3:], along[i, 3:])
        else:
            _add_cross(out[i, :3], along[i, 3:], columns[j, :3])
            _add_cross(out[i, :3], columns[i, 3:], along[j, :3])


@compiled
def manipulability_derivatives(
    jacobian: Matrix, rows: Rows
) -> tuple[Matrix, Tensor, Vector, Matrix, float, Vector, Matrix]:
    """Task Jacobian J (m, n) = `jacobian`[rows], ∂J (n, m, n), its σ (m,) and Vᵀ (n, n), H = √det(J Jᵀ), ∇H (n,), ∇²H (n, n).

    `jacobian` (6, n) geometric, of the task's point, base axes; `rows`: which of its rows the task uses.
    ∇ log H_a = tr(J⁺ ∂_a J); ∇² log H_ab = tr(J⁺ ∂_a ∂_b J) − tr(M_a M_b) + ⟨M_a P, M_b P⟩ with M_a = J⁺ ∂_a J and P the projector onto
    the null space. Where J has lost rank (σ_min < 1e-12 σ_max) H has no gradient: both derivatives come back as zero.
    """
    m, n = rows.shape[0], jacobian.shape[1]
    whole = jacobian_derivative(jacobian)
    task = np.empty((m, n))
    change = np.empty((n, m, n))
    for r in range(m):
        task[r] = jacobian[rows[r]]
        for j in range(n):
            change[j, r] = whole[j, rows[r]]
    u, sigma, vt = decompose(task)
    value = 1.0
    for r in range(m):
        value *= sigma[r]
    gradient = np.zeros(n)
    hessian = np.zeros((n, n))
    if sigma[m - 1] <= 1e-12 * sigma[0]:
        return task, change, sigma, vt, value, gradient, hessian
    inverse = np.zeros((n, m))
    for k in range(m):
        for i in range(n):
            for r in range(m):
                inverse[i, r] += vt[k, i] * u[r, k] / sigma[k]
    null = np.ascontiguousarray(vt[m:])
    turned = np.empty((n, n, n))
    free = np.empty((n, n, n - m))
    for j in range(n):
        turned[j] = inverse @ change[j]
        free[j] = turned[j] @ null.T
        for i in range(n):
            gradient[j] += turned[j, i, i]
    columns = np.ascontiguousarray(jacobian.T)
    second = np.empty((n, 6))
    for b in range(n):
        along = np.ascontiguousarray(whole[b].T)
        for a in range(b + 1):
            _second_derivative(columns, along, a, second)
            bend = gradient[a] * gradient[b]
            for i in range(n):
                for r in range(m):
                    bend += inverse[i, r] * second[i, rows[r]]
                for k in range(n):
                    bend -= turned[a, i, k] * turned[b, k, i]
                for k in range(n - m):
                    bend += free[a, i, k] * free[b, i, k]
            hessian[a, b] = hessian[b, a] = value * bend
    return task, change, sigma, vt, value, value * gradient, hessian
