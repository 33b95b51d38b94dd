"""The steps between an SVD and joint velocities, compiled: particular part, unconstrained split, hard and soft restrictions.

Written in the whitened null-space base P = L⁻¹ Nᵀ with LLᵀ = NᵀBN, so that N G⁻¹ Nᵀ = PᵀP (2.112-2.138 in these coordinates).
Every function is linear in (ẋ, z, b) as long as the same restrictions are active; the path scaling relies on that.
"""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.resolvers.decomposition import damped_inverse, orthogonalise, prop

_DEPENDENT = 1e-9
_ROUNDS = 14
_CONVERGED = 1e-15
_HELD = 1e-12


@compiled
def particular(u: Matrix, sigma: Vector, vt: Matrix, xdot: Vector, epsilon: float) -> tuple[Vector, bool]:
    """q̇_p = J⁺ẋ (n,) with singular values damped below ε (2.139, see `damped_inverse`), and whether any was."""
    m = sigma.shape[0]
    n = vt.shape[1]
    result = np.zeros(n)
    propped = False
    for i in range(m):
        dot = 0.0
        for j in range(m):
            dot += u[j, i] * xdot[j]
        dot *= damped_inverse(sigma[i], epsilon)
        for j in range(n):
            result[j] += dot * vt[i, j]
        propped = propped or sigma[i] < epsilon
    return result, propped


@compiled
def cholesky(matrix: Matrix) -> Matrix:
    """Lower factor L of a symmetric positive definite matrix."""
    n = matrix.shape[0]
    lower = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(value) if i == j else value / lower[j, j]
    return lower


@compiled
def whiten(base: Matrix, weight: Matrix) -> Matrix:
    """P (r, n) = L⁻¹ Nᵀ with LLᵀ = Nᵀ B N; `base` (r, n) holds the null-space base N as rows."""
    r, n = base.shape
    weighted = np.zeros((r, n))
    for a in range(r):
        for i in range(n):
            value = base[a, i]
            for j in range(n):
                weighted[a, j] += value * weight[i, j]
    gram = np.empty((r, r))
    for a in range(r):
        for c in range(a + 1):
            dot = 0.0
            for j in range(n):
                dot += weighted[a, j] * base[c, j]
            gram[a, c] = dot
            gram[c, a] = dot
    lower = cholesky(gram)
    result = base.copy()
    for a in range(r):
        for c in range(a):
            for j in range(n):
                result[a, j] -= lower[a, c] * result[c, j]
        for j in range(n):
            result[a, j] /= lower[a, a]
    return result


@compiled
def split(white: Matrix, weight: Matrix, dq_particular: Vector, z: Vector) -> Vector:
    """q̇_u = q̇_p + PᵀP B (z − q̇_p): the unconstrained optimum, known before any restriction is looked at."""
    r, n = white.shape
    pull = np.zeros(n)
    for i in range(n):
        difference = z[i] - dq_particular[i]
        for j in range(n):
            pull[j] += weight[i, j] * difference
    result = dq_particular.copy()
    for a in range(r):
        dot = 0.0
        for j in range(n):
            dot += white[a, j] * pull[j]
        for j in range(n):
            result[j] += dot * white[a, j]
    return result


@compiled
def _row_lengths(rows: Matrix, weight: Matrix) -> Vector:
    """√(a B⁻¹ aᵀ) of every row: its restriction's mobility if there were no task, 1 for a zero row."""
    k, n = rows.shape
    lower = cholesky(weight)
    lengths = np.ones(k)
    solved = np.empty(n)
    for i in range(k):
        total = 0.0
        for j in range(n):
            value = rows[i, j]
            for c in range(j):
                value -= lower[j, c] * solved[c]
            solved[j] = value / lower[j, j]
            total += solved[j] * solved[j]
        if total > 0.0:
            lengths[i] = math.sqrt(total)
    return lengths


@compiled
def _inverse(matrix: Matrix) -> Matrix:
    """Inverse of a small regular matrix, by elimination with pivoting."""
    k = matrix.shape[0]
    left = matrix.copy()
    right = np.zeros((k, k))
    for i in range(k):
        right[i, i] = 1.0
    for p in range(k):
        best = p
        for i in range(p + 1, k):
            if abs(left[i, p]) > abs(left[best, p]):
                best = i
        if best != p:
            for j in range(k):
                left[p, j], left[best, j] = left[best, j], left[p, j]
                right[p, j], right[best, j] = right[best, j], right[p, j]
        pivot = left[p, p]
        for j in range(k):
            left[p, j] /= pivot
            right[p, j] /= pivot
        for i in range(k):
            if i != p:
                factor = left[i, p]
                for j in range(k):
                    left[i, j] -= factor * left[p, j]
                    right[i, j] -= factor * right[p, j]
    return right


@compiled
def _overwrite(dq: Vector, rows: Matrix, target: Vector) -> None:
    """Move dq by the shortest way to where `rows·dq = target` (for rows that are single joints: overwrite those joints)."""
    k, n = rows.shape
    x = rows.copy()
    w = np.zeros((k, k))
    for i in range(k):
        w[i, i] = 1.0
    orthogonalise(x, w)
    largest = 0.0
    lengths = np.zeros(k)
    for i in range(k):
        for j in range(n):
            lengths[i] += x[i, j] * x[i, j]
        largest = max(largest, lengths[i])
    for _refine in range(2):
        missing = target.copy()
        for i in range(k):
            for j in range(n):
                missing[i] -= rows[i, j] * dq[j]
        for i in range(k):
            if lengths[i] > _DEPENDENT * _DEPENDENT * largest:
                dot = 0.0
                for j in range(k):
                    dot += w[i, j] * missing[j]
                dot /= lengths[i]
                for j in range(n):
                    dq[j] += dot * x[i, j]


@compiled
def restrict(
    white: Matrix,
    weight: Matrix,
    dq_unconstrained: Vector,
    rows: Matrix,
    floor: Vector,
    softness: Vector,
    epsilon: float,
) -> tuple[Vector, Vector, bool]:
    """Correct q̇_u so that `rows·q̇` (k,) meets its targets: `floor` for hard rows (softness 0), and
    `floor + s (rate without this row − floor)` for soft ones (softness s in (0, 1]).

    In terms of M = C G⁻¹ Cᵀ (rows normalised, so M_jj ≤ 1 is how free of the task a row is):
    (M (1 − s) + diag(s M_jj)) η = floor − rows·q̇_u, and q̇ = q̇_u + N G⁻¹ Cᵀ (1 − s) η.
    Solved by iterated damping, exact after a few rounds where M is regular; where it is singular to `epsilon` the rows are met by
    overwriting and the task gives way. The damping belongs to a row and does not depend on which others are present, so a row that
    enters or leaves while it does not pull changes nothing. Returns q̇ (n,), η (k,), whose sign tells to which side a row
    pulls, and whether overwriting was needed.
    """
    k, n = rows.shape
    r = white.shape[0]
    lengths = _row_lengths(rows, weight)
    into = np.zeros((k, r))
    for i in range(k):
        for a in range(r):
            for j in range(n):
                into[i, a] += rows[i, j] * white[a, j]
            into[i, a] /= lengths[i]
    system = np.zeros((k, k))
    for i in range(k):
        for j in range(k):
            for a in range(r):
                system[i, j] += into[i, a] * into[j, a]
    soft = np.empty(k)
    for i in range(k):
        soft[i] = softness[i] * prop(system[i, i], epsilon)
        for j in range(k):
            system[i, j] *= 1.0 - softness[j]
        system[i, i] += max(soft[i], epsilon)
    inverse = _inverse(system)
    eta = np.zeros(k)
    missing = np.empty(k)
    dq = dq_unconstrained.copy()
    damped = False
    for _round in range(_ROUNDS):
        worst = 0.0
        size = 1.0
        for i in range(k):
            rate = 0.0
            for j in range(n):
                rate += rows[i, j] * dq[j]
            missing[i] = (floor[i] - rate) / lengths[i] - soft[i] * eta[i]
            worst = max(worst, abs(missing[i]))
            size = max(size, abs(eta[i]))
        damped = worst > _HELD * size
        if worst <= _CONVERGED * size:
            break
        for i in range(k):
            change = 0.0
            for j in range(k):
                change += inverse[i, j] * missing[j]
            eta[i] += change
            change *= 1.0 - softness[i]
            for a in range(r):
                along = change * into[i, a]
                for j in range(n):
                    dq[j] += along * white[a, j]
    if damped:
        for i in range(k):
            missing[i] = floor[i] - soft[i] * lengths[i] * eta[i]
        _overwrite(dq, rows, missing)
    return dq, eta, damped
