"""Singular value decomposition of small wide matrices, compiled: pivoted Householder QR, then one-sided Jacobi.

LAPACK's drivers are made for large matrices and cost several times as much on a 6x8 one; Jacobi rotations on the triangular
factor (Drmač and Veselić, SIAM J. Matrix Anal. Appl. 29, 2008) are at least as accurate, also in the small singular values,
which is where singularity treatment looks, and give the same bits on every machine.
All matrices are C-contiguous float64; `Vt` has the right singular vectors as rows, so its last n − m rows are the null-space base.
"""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector

_SWEEPS = 40
_ORTHOGONAL = 1e-15


@compiled
def prop(sigma: float, epsilon: float) -> float:
    """σ̃ = (σ² + ε²)/2ε below ε, σ above (2.139): continuous with its derivative, never below ε/2."""
    return sigma if sigma >= epsilon else (sigma * sigma + epsilon * epsilon) / (2.0 * epsilon)


@compiled
def damped_inverse(sigma: float, epsilon: float) -> float:
    """What takes the place of 1/σ: σ/σ̃², which is 1/σ above ε and joins it with its derivative.

    1/σ̃ alone, as (2.139) has it, jumps from −2/ε to 2/ε where a path crosses a singularity: the pair of singular vectors changes
    its sign there and 1/σ̃ does not vanish. σ/σ̃² is odd in σ, so the pseudo-inverse is a C¹ function of J, and at most 1.3/ε.
    """
    propped = prop(sigma, epsilon)
    return sigma / (propped * propped)


@compiled
def _reflect(rows: Matrix, k: int, m: int, n: int, reflector: Vector) -> float:
    """Householder step k on the rows of `rows` below k; returns the scalar 2/vᵀv with v in reflector[k:]."""
    norm = 0.0
    for j in range(k, n):
        norm += rows[k, j] * rows[k, j]
    norm = math.sqrt(norm)
    if norm == 0.0:
        return 0.0
    alpha = -norm if rows[k, k] > 0.0 else norm
    length = 0.0
    for j in range(k, n):
        reflector[j] = rows[k, j]
    reflector[k] -= alpha
    for j in range(k, n):
        length += reflector[j] * reflector[j]
    scale = 2.0 / length
    rows[k, k] = alpha
    for j in range(k + 1, n):
        rows[k, j] = 0.0
    for i in range(k + 1, m):
        dot = 0.0
        for j in range(k, n):
            dot += rows[i, j] * reflector[j]
        dot *= scale
        for j in range(k, n):
            rows[i, j] -= dot * reflector[j]
    return scale


@compiled
def orthogonalise(x: Matrix, w: Matrix) -> None:
    """Rotate the rows of x until they are orthogonal to each other; the rows of the square w take the same rotations."""
    m, width = x.shape
    for _sweep in range(_SWEEPS):
        rotated = False
        for p in range(m - 1):
            for q in range(p + 1, m):
                pp = 0.0
                qq = 0.0
                pq = 0.0
                for j in range(width):
                    a = x[p, j]
                    b = x[q, j]
                    pp += a * a
                    qq += b * b
                    pq += a * b
                if abs(pq) <= _ORTHOGONAL * math.sqrt(pp) * math.sqrt(qq):
                    continue
                rotated = True
                zeta = (qq - pp) / (2.0 * pq)
                t = 1.0 / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                if zeta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = c * t
                for j in range(width):
                    a = x[p, j]
                    b = x[q, j]
                    x[p, j] = c * a - s * b
                    x[q, j] = s * a + c * b
                for j in range(m):
                    a = w[p, j]
                    b = w[q, j]
                    w[p, j] = c * a - s * b
                    w[q, j] = s * a + c * b
        if not rotated:
            break


@compiled
def _complete(u: Matrix, i: int, m: int) -> None:
    """Fill column i of u with a unit vector orthogonal to columns 0..i-1 (for a singular value of exactly zero)."""
    best = 0.0
    for trial in range(m):
        candidate = np.zeros(m)
        candidate[trial] = 1.0
        for _twice in range(2):
            for k in range(i):
                dot = 0.0
                for j in range(m):
                    dot += candidate[j] * u[j, k]
                for j in range(m):
                    candidate[j] -= dot * u[j, k]
        norm = 0.0
        for j in range(m):
            norm += candidate[j] * candidate[j]
        norm = math.sqrt(norm)
        if norm > best + 1e-3:
            best = norm
            for j in range(m):
                u[j, i] = candidate[j] / norm


@compiled
def decompose(jacobian: Matrix) -> tuple[Matrix, Vector, Matrix]:
    """U (m, m), σ (m,) descending, Vt (n, n) of the full SVD `J = U [diag σ, 0] Vt`, m ≤ n. Finite for every finite J."""
    m, n = jacobian.shape
    rows = jacobian.copy()
    order = np.arange(m)
    reflectors = np.zeros((m, n))
    scales = np.zeros(m)
    for k in range(m):
        best = -1.0
        pivot = k
        for i in range(k, m):
            norm = 0.0
            for j in range(k, n):
                norm += rows[i, j] * rows[i, j]
            if norm > best:
                best = norm
                pivot = i
        if pivot != k:
            order[k], order[pivot] = order[pivot], order[k]
            for j in range(n):
                rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
        scales[k] = _reflect(rows, k, m, n, reflectors[k])
    # rows = L Q0ᵀ with Q = H_0 H_1 ... H_{m-1}; the rows of R = Lᵀ are made orthogonal
    x = np.empty((m, m))
    w = np.zeros((m, m))
    for i in range(m):
        w[i, i] = 1.0
        for j in range(m):
            x[i, j] = rows[j, i]
    orthogonalise(x, w)
    raw = np.empty(m)
    for i in range(m):
        norm = 0.0
        for j in range(m):
            norm += x[i, j] * x[i, j]
        raw[i] = math.sqrt(norm)
    rank = np.arange(m)
    for i in range(1, m):
        j = i
        while j > 0 and raw[rank[j]] > raw[rank[j - 1]]:
            rank[j], rank[j - 1] = rank[j - 1], rank[j]
            j -= 1
    u = np.zeros((m, m))
    sigma = np.empty(m)
    vt = np.zeros((n, n))
    for i in range(m):
        r = rank[i]
        sigma[i] = raw[r]
        if raw[r] > 1e-150:
            for j in range(m):
                u[order[j], i] = x[r, j] / raw[r]
        else:
            _complete(u, i, m)
        for j in range(m):
            vt[i, j] = w[r, j]
    for i in range(m, n):
        vt[i, i] = 1.0
    for k in range(m - 1, -1, -1):
        reflector = reflectors[k]
        scale = scales[k]
        if scale == 0.0:
            continue
        for i in range(n):
            dot = 0.0
            for j in range(k, n):
                dot += vt[i, j] * reflector[j]
            dot *= scale
            for j in range(k, n):
                vt[i, j] -= dot * reflector[j]
    return u, sigma, vt
