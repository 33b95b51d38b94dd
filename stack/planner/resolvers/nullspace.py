"""The steps between an SVD and joint velocities, compiled: particular part, unconstrained split, hard and soft restrictions.

Written in the whitened null-space base P = L⁻¹ Nᵀ with LLᵀ = NᵀBN, so that N G⁻¹ Nᵀ = PᵀP (2.112-2.138 in these coordinates).
Every function is linear in (ẋ, z, b) as long as the same restrictions are active; the path scaling relies on that.
"""

from __future__ import annotations

import math

import numpy as np

from stack.messages import Matrix, Vector
from stack.planner.resolvers.decomposition import damped_inverse, orthogonalise, prop
from stack.servo.compiled import compiled

_DEPENDENT = 1e-9


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
def _soft_targets(rotation: Matrix, values: Vector, softness: Vector, residual: Vector) -> tuple[Vector, Vector]:
    """Row values that a soft restriction aims at, relative to its floor: each scales down the rate that its row would have if only the
    others held. (M̃ (1 − s) + diag(s M̃_jj)) η = −residual, target = −s_j M̃_jj η_j; hard rows (s = 0) aim at 0."""
    k = softness.shape[0]
    system = np.zeros((k, k))
    diagonal = np.zeros(k)
    for i in range(k):
        for j in range(k):
            for a in range(k):
                system[i, j] += rotation[a, i] * values[a] * rotation[a, j]
        diagonal[i] = system[i, i]
    for i in range(k):
        for j in range(k):
            system[i, j] *= 1.0 - softness[j]
        system[i, i] += softness[i] * diagonal[i]
    eta = -residual
    for p in range(k):
        best = p
        for i in range(p + 1, k):
            if abs(system[i, p]) > abs(system[best, p]):
                best = i
        if best != p:
            for j in range(k):
                system[p, j], system[best, j] = system[best, j], system[p, j]
            eta[p], eta[best] = eta[best], eta[p]
        for i in range(p + 1, k):
            factor = system[i, p] / system[p, p]
            for j in range(p, k):
                system[i, j] -= factor * system[p, j]
            eta[i] -= factor * eta[p]
    for p in range(k - 1, -1, -1):
        for j in range(p + 1, k):
            eta[p] -= system[p, j] * eta[j]
        eta[p] /= system[p, p]
    return -softness * diagonal * eta, eta


@compiled
def _overwrite(dq: Vector, rows: Matrix, target: Vector) -> None:
    """Move dq by the shortest way to where `rows·dq = target` (for rows that are single joints: overwrite those joints)."""
    k, n = rows.shape
    x = rows.copy()
    w = np.eye(k)
    orthogonalise(x, w)
    largest = 0.0
    lengths = np.zeros(k)
    for i in range(k):
        for j in range(n):
            lengths[i] += x[i, j] * x[i, j]
        largest = max(largest, lengths[i])
    for _refine in range(2):
        missing = target - rows @ dq
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
    """Correct q̇_u so that `rows·q̇` meets its targets: `floor` (k,) for hard rows (softness 0), and
    `floor + s (rate without this row − floor)` for soft ones (softness s in (0, 1]).

    Returns q̇ (n,), η (k,) whose sign tells on which side a row pulls, and whether damping was needed because the restrictions'
    own matrix C G⁻¹Cᵀ is near-singular. Where it was, the rows are met by overwriting and the task gives way.
    """
    k, n = rows.shape
    r = white.shape[0]
    lengths = _row_lengths(rows, weight)
    x = np.zeros((k, r))
    residual = np.empty(k)
    for i in range(k):
        value = -floor[i]
        for j in range(n):
            value += rows[i, j] * dq_unconstrained[j]
        residual[i] = value / lengths[i]
        for a in range(r):
            dot = 0.0
            for j in range(n):
                dot += rows[i, j] * white[a, j]
            x[i, a] = dot / lengths[i]
    rotation = np.eye(k)
    orthogonalise(x, rotation)
    values = np.zeros(k)
    damped = False
    for i in range(k):
        for a in range(r):
            values[i] += x[i, a] * x[i, a]
        damped = damped or values[i] < epsilon
        values[i] = prop(values[i], epsilon)
    target, eta = _soft_targets(rotation, values, softness, residual)
    dq = dq_unconstrained.copy()
    for _refine in range(1 if damped else 2):
        for i in range(k):
            dot = 0.0
            for j in range(k):
                missing = target[j] + floor[j] / lengths[j]
                for c in range(n):
                    missing -= rows[j, c] * dq[c] / lengths[j]
                dot += rotation[i, j] * missing
            dot /= values[i]
            residual[i] = dot
        for a in range(r):
            along = 0.0
            for i in range(k):
                along += x[i, a] * residual[i]
            for j in range(n):
                dq[j] += along * white[a, j]
    if damped:
        _overwrite(dq, rows, target * lengths + floor)
    return dq, eta, damped
