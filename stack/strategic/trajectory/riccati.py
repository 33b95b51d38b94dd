"""Newton's step of a discrete double integrator between two given states, by a Riccati recursion with n×n factors.

With time in steps, `q_{k+1} = q_k + w_k + a_k/2`, `w_{k+1} = w_k + a_k` is linear whatever the step is, so every iterate fulfils it. Two
steps reach any state (dead beat), so the last two accelerations follow from the state before them: no multiplier for the goal.
"""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector


@compiled
def factorise(Qq: Matrix, Qm: Matrix, Qw: Matrix, R: Matrix, P: Matrix, Z: Matrix, L: Matrix) -> bool:
    """Backward pass over N − 1 stages; False if the problem is not convex along the dynamics (nothing is usable then).

    Stage Hessian: `Qq` (N−1, n, n) of q; diagonals `Qw` of w, `Qm` of their product, `R` of a, (N−1, n) each. Fills `L` (N−1, n, n)
    Cholesky factors, `Z` (N−1, n, 2n) = L⁻¹ Bᵀ P A, and uses `P` (2n, 2n).
    """
    stages, n = R.shape
    e = stages - 2
    # The last two steps in terms of x_e: a_e = −q − 1.5 w, a_{e+1} = q + 0.5 w, q_{e+1} = 0.5 q + 0.25 w, w_{e+1} = −q − 0.5 w.
    for i in range(n):
        for j in range(n):
            near, last = Qq[e, i, j], Qq[e + 1, i, j]
            P[i, j] = near + 0.25 * last
            P[i, n + j] = 0.125 * last
            P[n + i, n + j] = 0.0625 * last
    for i in range(n):
        cross = Qm[e + 1, i]
        P[i, i] += R[e, i] + R[e + 1, i] + Qw[e + 1, i] - cross
        P[i, n + i] += 1.5 * R[e, i] + 0.5 * R[e + 1, i] + 0.5 * Qw[e + 1, i] - 0.5 * cross + Qm[e, i]
        P[n + i, n + i] += 2.25 * R[e, i] + 0.25 * R[e + 1, i] + 0.25 * Qw[e + 1, i] - 0.25 * cross + Qw[e, i]
    for i in range(n):
        for j in range(n):
            P[n + j, i] = P[i, n + j]
    for k in range(e - 1, -1, -1):
        for i in range(n):
            for j in range(n):
                y1 = 0.5 * P[i, j] + P[i, n + j]
                y2 = y1 + 0.5 * P[j, n + i] + P[n + i, n + j]
                Z[k, j, i] = y1
                Z[k, j, n + i] = y2
        for i in range(n):
            for j in range(i + 1):
                total = 0.25 * P[i, j] + 0.5 * (P[i, n + j] + P[j, n + i]) + P[n + i, n + j]
                if i == j:
                    total += R[k, i]
                for m in range(j):
                    total -= L[k, i, m] * L[k, j, m]
                if i == j:
                    if not total > 1e-6 * R[k, i]:
                        return False
                    L[k, i, i] = math.sqrt(total)
                else:
                    L[k, i, j] = total / L[k, j, j]
        for i in range(n):
            inverse = 1.0 / L[k, i, i]
            for m in range(i):
                factor = L[k, i, m]
                for c in range(2 * n):
                    Z[k, i, c] -= factor * Z[k, m, c]
            for c in range(2 * n):
                Z[k, i, c] *= inverse
        # P = Q + Aᵀ P A − Zᵀ Z
        for i in range(n):
            for j in range(n):
                P[n + i, n + j] += P[i, j] + P[i, n + j] + P[j, n + i]
        for i in range(n):
            for j in range(n):
                P[i, n + j] += P[i, j]
        for i in range(n):
            for j in range(n):
                P[i, j] += Qq[k, i, j]
            P[i, n + i] += Qm[k, i]
            P[n + i, n + i] += Qw[k, i]
        for m in range(n):
            for i in range(2 * n):
                factor = Z[k, m, i]
                for j in range(i, 2 * n):
                    P[i, j] -= factor * Z[k, m, j]
        for i in range(2 * n):
            for j in range(i):
                P[i, j] = P[j, i]
    return True


@compiled
def descend(
    Qq: Matrix,
    Qm: Matrix,
    Qw: Matrix,
    R: Matrix,
    Z: Matrix,
    L: Matrix,
    gq: Matrix,
    gw: Matrix,
    ga: Matrix,
    w_first: Vector,
    w_last: Vector,
    dq: Matrix,
    dw: Matrix,
    da: Matrix,
) -> None:
    """Minimiser of `½ xᵀHx + gᵀx` with q fixed at both ends and w given there (n,); fills `dq`, `dw` (N, n), `da` (N−1, n).

    Gradients `gq`, `gw`, `ga` (N−1, n). Needs the `Z`, `L` of `factorise`.
    """
    stages, n = R.shape
    e = stages - 2
    pq, pw = np.empty(n), np.empty(n)
    y = np.empty((stages, n))
    # With the goal's w: a_e −= 0.5 w, a_{e+1} += 1.5 w, q_{e+1} −= 0.25 w, w_{e+1} −= 0.5 w.
    for i in range(n):
        goal = w_last[i]
        r0 = ga[e, i] - 0.5 * R[e, i] * goal
        r1 = ga[e + 1, i] + 1.5 * R[e + 1, i] * goal
        curve = gq[e + 1, i] - 0.5 * Qm[e + 1, i] * goal
        for j in range(n):
            curve -= 0.25 * Qq[e + 1, i, j] * w_last[j]
        speed = gw[e + 1, i] - 0.25 * Qm[e + 1, i] * goal - 0.5 * Qw[e + 1, i] * goal
        pq[i] = gq[e, i] - r0 + r1 + 0.5 * curve - speed
        pw[i] = gw[e, i] - 1.5 * r0 + 0.5 * r1 + 0.25 * curve - 0.5 * speed
    for k in range(e - 1, -1, -1):
        for i in range(n):
            total = ga[k, i] + 0.5 * pq[i] + pw[i]
            for m in range(i):
                total -= L[k, i, m] * y[k, m]
            y[k, i] = total / L[k, i, i]
        for i in range(n):
            pw[i] += pq[i] + gw[k, i]
            pq[i] += gq[k, i]
        for m in range(n):
            factor = y[k, m]
            for i in range(n):
                pq[i] -= Z[k, m, i] * factor
                pw[i] -= Z[k, m, n + i] * factor
    for i in range(n):
        dq[0, i] = 0.0
        dw[0, i] = w_first[i]
    for k in range(e):
        for i in range(n):
            total = y[k, i]
            for j in range(n):
                total += Z[k, i, j] * dq[k, j] + Z[k, i, n + j] * dw[k, j]
            da[k, i] = -total
        for i in range(n - 1, -1, -1):
            total = da[k, i]
            for m in range(i + 1, n):
                total -= L[k, m, i] * da[k, m]
            da[k, i] = total / L[k, i, i]
        for i in range(n):
            dq[k + 1, i] = dq[k, i] + dw[k, i] + 0.5 * da[k, i]
            dw[k + 1, i] = dw[k, i] + da[k, i]
    for i in range(n):
        da[e, i] = -dq[e, i] - 1.5 * dw[e, i] - 0.5 * w_last[i]
        da[e + 1, i] = dq[e, i] + 0.5 * dw[e, i] + 1.5 * w_last[i]
        dq[e + 1, i] = dq[e, i] + dw[e, i] + 0.5 * da[e, i]
        dw[e + 1, i] = dw[e, i] + da[e, i]
        dq[e + 2, i] = 0.0
        dw[e + 2, i] = w_last[i]
