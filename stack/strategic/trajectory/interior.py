"""The primal-dual interior-point method on the scaled transcription, compiled.

Unknowns: q_k (N, n), w_k = h q̇_k (N, n), a_k = h² q̈_k (N−1, n) and the step h. The dynamics are linear in them and hold in every iterate
(see `riccati`); h is a scalar border; the limits are in `slack`, the singularities in `node_cost`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.strategic.trajectory.node_cost import node_derivatives, objective, without_negative_curvature
from stack.strategic.trajectory.riccati import descend, factorise
from stack.strategic.trajectory.slack import advance, condense, first_slacks, slack_merit, slack_steps

# Columns of the result's numbers.
H, VALUE, ITERATIONS, DECREMENT, RESIDUAL, GAP, BARRIER = range(7)


@compiled
def _border(
    Qq: Matrix, Qm: Matrix, Qw: Matrix, R: Matrix, gq: Matrix, gw: Matrix, ga: Matrix, cq: Matrix, cw: Matrix, ca: Matrix,
    q0: Matrix, w0: Matrix, a0: Matrix, q1: Matrix, w1: Matrix, a1: Matrix,
) -> tuple[float, float]:  # fmt: skip
    """Of dx = dx⁰ + dh dx¹: curvature and slope along dh, without what h has of its own:
    dx¹ᵀ H dx¹ + 2 cᵀ dx¹ and dx⁰ᵀ H dx¹ + cᵀ dx⁰ + gᵀ dx¹."""
    stages, n = R.shape
    bend, slope = 0.0, 0.0
    for k in range(stages):
        for i in range(n):
            row = Qm[k, i] * w1[k, i]
            for j in range(n):
                row += Qq[k, i, j] * q1[k, j]
            bend += q1[k, i] * (row + Qm[k, i] * w1[k, i]) + Qw[k, i] * w1[k, i] ** 2 + R[k, i] * a1[k, i] ** 2
            bend += 2.0 * (cq[k, i] * q1[k, i] + cw[k, i] * w1[k, i] + ca[k, i] * a1[k, i])
            slope += gq[k, i] * q1[k, i] + gw[k, i] * w1[k, i] + ga[k, i] * a1[k, i]
            slope += cq[k, i] * q0[k, i] + cw[k, i] * w0[k, i] + ca[k, i] * a0[k, i]
            slope += q0[k, i] * row + w0[k, i] * (Qw[k, i] * w1[k, i] + Qm[k, i] * q1[k, i])
            slope += a0[k, i] * R[k, i] * a1[k, i]
    return bend, slope


@compiled
def interior_point(
    kind: int, q: Matrix, w: Matrix, a: Matrix, h: float, dq_first: Vector, dq_last: Vector, bounds: Matrix, time: float, effort: float,
    chain: Matrix, f: Matrix, fa: Vector, fb: Vector, conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector,
    spheres: Matrix, touching: NDArray[np.int64], barrier: float, barrier_last: float, most: int,
) -> Vector:  # fmt: skip
    """Minimise from `q`, `w`, `a`, `h` (which fulfil the dynamics and the end states); overwrites `q`, `w`, `a`.

    `bounds` (4, n, 2) in q, q̇, q̈, q. Returns (h, value, iterations, decrement, residual, gap, barrier).
    """
    points, n = q.shape
    stages = points - 1
    s, z = np.ones((4, stages, n, 2)), np.zeros((4, stages, n, 2))
    ds, dz, s_try = np.zeros((4, stages, n, 2)), np.zeros((4, stages, n, 2)), np.ones((4, stages, n, 2))
    mu = barrier
    first_slacks(q, w, a, h, bounds, mu, s, z)
    Qq, hessian, convex = np.zeros((stages, n, n)), np.zeros((stages, n, n)), np.zeros((stages, n, n))
    Qm, Qw, R, diagonal = np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n))
    fq = np.zeros((stages, n))
    gq, gw, ga = np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n))
    cq, cw, ca = np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n))
    P, Z, L = np.zeros((2 * n, 2 * n)), np.zeros((stages, n, 2 * n)), np.zeros((stages, n, n))
    q0, w0, a0 = np.zeros((points, n)), np.zeros((points, n)), np.zeros((stages, n))
    q1, w1, a1 = np.zeros((points, n)), np.zeros((points, n)), np.zeros((stages, n))
    q_try, w_try, a_try = q.copy(), w.copy(), a.copy()
    still = np.zeros(n)
    arguments = (chain, f, fa, fb, conditions, sets, shape, spheres, touching)
    value = objective(kind, q, a, h, time, effort, *arguments)
    curved = kind != 0 or touching.shape[0] > 0
    penalty = 1.0
    decrement, residual, gap = np.inf, np.inf, np.inf
    share = 1.0
    fresh, projected = True, False
    iteration = 0
    refused = 0
    while iteration < most:
        if fresh:
            for k in range(1, stages):
                node_derivatives(kind, q[k], *arguments, fq[k], hessian[k])
            fresh, projected = False, False
        iteration += 1
        # --- the condensed Newton system
        gq[:, :] = fq
        for block in (gw, cq, cw, Qm, Qw, diagonal):
            block[:, :] = 0.0
        h4 = h**4
        energy = float(np.sum(a * a))
        R[:, :] = 2.0 * effort / h4
        ga[:, :] = 2.0 * effort / h4 * a
        ca[:, :] = -8.0 * effort / (h4 * h) * a
        fh = time * points - 4.0 * effort * energy / (h4 * h)
        gh, chh, residual, gap = condense(
            q, w, a, h, bounds, mu, s, z, diagonal, Qm, Qw, R, gq, gw, ga, cw, ca
        )  # fmt: skip
        gh += fh
        chh += 20.0 * effort * energy / (h4 * h * h)
        # --- the exact Hessian where it is convex along the dynamics and in h, else as much of its negative part as leaves it so
        share = min(1.0, 4.0 * share) if curved else 0.0
        while True:
            if share < 1.0 and curved and not projected:
                for k in range(1, stages):
                    without_negative_curvature(hessian[k], convex[k])
                projected = True
            for k in range(stages):
                for i in range(n):
                    for j in range(n):
                        Qq[k, i, j] = hessian[k, i, j]
                        if share < 1.0 and curved:
                            Qq[k, i, j] += (1.0 - share) * (convex[k, i, j] - hessian[k, i, j])
                    Qq[k, i, i] += diagonal[k, i]
            if factorise(Qq, Qm, Qw, R, P, Z, L) or share == 0.0:
                descend(Qq, Qm, Qw, R, Z, L, gq, gw, ga, still, still, q0, w0, a0)
                descend(Qq, Qm, Qw, R, Z, L, cq, cw, ca, dq_first, dq_last, q1, w1, a1)
                bend, slope = _border(Qq, Qm, Qw, R, gq, gw, ga, cq, cw, ca, q0, w0, a0, q1, w1, a1)
                if bend + chh > 1e-12 * abs(chh) or share == 0.0:
                    break
            share = 0.5 * share if share > 0.05 else 0.0
        used = share
        share = max(share, 0.05)
        bend, slope = max(abs(bend + chh), 1e-12 * abs(chh), 1e-6), slope + gh
        dh = min(max(-slope / bend, -0.5 * h), 2.0 * h)
        down = fh * dh
        decrement = -gh * dh
        for k in range(points):
            for i in range(n):
                q0[k, i] += dh * q1[k, i]
                w0[k, i] += dh * w1[k, i]
                if k < stages:
                    a0[k, i] += dh * a1[k, i]
                    down += fq[k, i] * q0[k, i] + 2.0 * effort * a[k, i] / h4 * a0[k, i]
                    decrement -= gq[k, i] * q0[k, i] + gw[k, i] * w0[k, i] + ga[k, i] * a0[k, i]
        # --- slacks and multipliers, how far they go
        alpha, alpha_z, off_now, barrier_down = slack_steps(
            q, w, a, h, q0, w0, a0, dh, bounds, mu, s, z, ds, dz
        )  # fmt: skip
        down += barrier_down
        if off_now > 1e-12:
            penalty = max(penalty, 2.0 * down / off_now)
        down -= penalty * off_now
        # --- done, or the next barrier
        settled = decrement <= 3.0 * mu and residual <= max(1e-7, 0.1 * mu) and gap <= 10.0 * mu
        if mu <= barrier_last and decrement <= 1e-7 * (1.0 + abs(value)) and residual <= 1e-8 and gap <= 10.0 * mu:
            break
        # --- line search on the merit function
        logs, off = slack_merit(q, w, a, h, bounds, s, ds, 0.0, s_try)
        merit = value - mu * logs + penalty * off
        accepted = False
        value_try = value
        for _ in range(30):
            h_try = h + alpha * dh
            for k in range(points):
                for i in range(n):
                    q_try[k, i] = q[k, i] + alpha * q0[k, i]
                    w_try[k, i] = w[k, i] + alpha * w0[k, i]
                    if k < stages:
                        a_try[k, i] = a[k, i] + alpha * a0[k, i]
            value_try = objective(kind, q_try, a_try, h_try, time, effort, *arguments)
            logs, off = slack_merit(q_try, w_try, a_try, h_try, bounds, s, ds, alpha, s_try)
            new = value_try - mu * logs + penalty * off
            # Where the decrement is next to rounding, the merit's differences say nothing any more.
            flat = decrement <= 1e-8 * (1.0 + abs(value)) and off < 1e-6
            if flat or new <= merit + 1e-4 * alpha * min(down, 0.0) + 1e-12 * (1.0 + abs(merit)):
                accepted = True
                break
            alpha *= 0.5
        if not accepted:
            refused += 1
            if used > 0.0 and curved and refused < 5:
                share = 0.0  # once without any negative curvature
                continue
            break
        h += alpha * dh
        q[:, :] = q_try
        w[:, :] = w_try
        a[:, :] = a_try
        value = value_try
        fresh = True
        advance(s, z, dz, s_try, alpha_z, mu)
        if settled and mu > barrier_last:
            mu = max(barrier_last, min(0.2 * mu, mu**1.5))
            penalty = 1.0
    return np.array([h, value, float(iteration), decrement, residual, gap, mu])
