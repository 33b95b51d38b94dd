"""The primal-dual interior-point method on the scaled transcription, compiled.

Unknowns: q_k (N, n), w_k = h q̇_k (N, n), a_k = h² q̈_k (N−1, n) and the step h. The dynamics are linear in them and hold in every iterate
(see `riccati`); h is a scalar border. Limits have slacks and multipliers `s`, `z` (4, N−1, n, 2), last index lower, upper:
0 the node q_k, 1 w_k, 2 a_k, 3 q_k + w_k/2, the middle control point of the parabola from node k to k + 1 (the ends are nodes): as a
curve stays inside the hull of its control points, positions hold their limits between the nodes, too.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.strategic.trajectory.chain import manipulability_gradient
from stack.strategic.trajectory.potentials import potential_derivatives, potential_value
from stack.strategic.trajectory.riccati import descend, factorise

NODE, SPEED, ACCELERATION, BETWEEN = 0, 1, 2, 3
PLAIN, AWAY, POTENTIAL = 0, 1, 2

# Columns of the result's numbers.
H, VALUE, ITERATIONS, DECREMENT, RESIDUAL, GAP, BARRIER = range(7)


@compiled
def node_value(
    kind: int, q: Vector, chain: Matrix, f: Matrix, a: Vector, b: Vector,
    conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector,
) -> float:  # fmt: skip
    """Singularity cost of one node; `shape` = (weight, ε, height, steepness)."""
    if kind == 1:
        return float(shape[0] / (manipulability_gradient(chain, q, np.empty(q.size)) + shape[1]))
    if kind == 2:
        return float(shape[0] * potential_value(q, f, a, b, conditions, sets, shape[2], shape[3]))
    return 0.0


@compiled
def node_derivatives(
    kind: int, q: Vector, chain: Matrix, f: Matrix, a: Vector, b: Vector,
    conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector,
    gradient: Vector, positive: Matrix, rest: Matrix,
) -> None:  # fmt: skip
    """Gradient and the two parts of the Hessian, the first semidefinite. Manipulability: second derivatives by central differences."""
    n = q.size
    if kind == 0:
        gradient[:] = 0.0
        positive[:, :] = 0.0
        rest[:, :] = 0.0
    elif kind == 2:
        potential_derivatives(q, f, a, b, conditions, sets, shape[2], shape[3], gradient, positive, rest)
        for i in range(n):
            gradient[i] *= shape[0]
            for j in range(n):
                positive[i, j] *= shape[0]
                rest[i, j] *= shape[0]
    else:
        slope, ahead, behind = np.empty(n), np.empty(n), np.empty(n)
        m = manipulability_gradient(chain, q, slope) + shape[1]
        moved = q.copy()
        for i in range(n):
            step = 1e-5
            moved[i] = q[i] + step
            manipulability_gradient(chain, moved, ahead)
            moved[i] = q[i] - step
            manipulability_gradient(chain, moved, behind)
            moved[i] = q[i]
            for j in range(n):
                rest[i, j] = (ahead[j] - behind[j]) / (2.0 * step)
        for i in range(n):
            gradient[i] = -shape[0] / (m * m) * slope[i]
            for j in range(n):
                positive[i, j] = 2.0 * shape[0] / (m * m * m) * slope[i] * slope[j]
        for i in range(n):
            for j in range(i + 1):
                both = -shape[0] / (m * m) * 0.5 * (rest[i, j] + rest[j, i])
                rest[i, j] = both
                rest[j, i] = both


@compiled
def objective(
    kind: int, q: Matrix, a: Matrix, h: float, time: float, effort: float, chain: Matrix, f: Matrix, fa: Vector, fb: Vector,
    conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector,
) -> float:  # fmt: skip
    """time · N h + effort · Σ|a|²/h⁴ + Σ over the inner nodes of the singularity cost."""
    value = float(time * q.shape[0] * h + effort * np.sum(a * a) / h**4)
    if kind != 0:
        for k in range(1, q.shape[0] - 1):
            value += node_value(kind, q[k], chain, f, fa, fb, conditions, sets, shape)
    return value


@compiled
def _expression(kind: int, k: int, i: int, q: Matrix, w: Matrix, a: Matrix) -> float:
    if kind == 0:
        return float(q[k, i])
    if kind == 1:
        return float(w[k, i])
    if kind == 2:
        return float(a[k, i])
    return float(q[k, i] + 0.5 * w[k, i])


@compiled
def _power(kind: int, h: float) -> float:
    return h if kind == 1 else (h * h if kind == 2 else 1.0)


@compiled
def _slack_merit(
    q: Matrix, w: Matrix, a: Matrix, h: float, bounds: Matrix, s: Matrix, ds: Matrix, alpha: float, out: Matrix
) -> tuple[float, float]:
    """Σ log s and Σ|c − s| at the trial point; `out` becomes its slacks, s + α ds or the constraint itself where that is larger."""
    stages, n = a.shape
    logs = 0.0
    residual = 0.0
    for kind in range(4):
        power = _power(kind, h)
        for k in range(1 if kind < 2 else 0, stages):
            product = 1.0
            for i in range(n):
                value = _expression(kind, k, i, q, w, a)
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    c = sign * (value - bounds[kind, i, side] * power)
                    slack = s[kind, k, i, side] + alpha * ds[kind, k, i, side]
                    if c > slack:
                        slack = c
                    out[kind, k, i, side] = slack
                    residual += slack - c
                    product *= slack
                    if product < 1e-200 or product > 1e200:
                        logs += math.log(product)
                        product = 1.0
            logs += math.log(product)
    return logs, residual


@compiled
def interior_point(
    kind: int, q: Matrix, w: Matrix, a: Matrix, h: float, dq_first: Vector, dq_last: Vector, bounds: Matrix, time: float, effort: float,
    chain: Matrix, f: Matrix, fa: Vector, fb: Vector, conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector,
    barrier: float, barrier_last: float, most: int,
) -> Vector:  # fmt: skip
    """Minimise from `q`, `w`, `a`, `h` (which fulfil the dynamics and the end states); overwrites `q`, `w`, `a`.

    `bounds` (4, n, 2) in q, q̇, q̈, q. Returns (h, value, iterations, decrement, residual, gap, barrier).
    """
    points, n = q.shape
    stages = points - 1
    s = np.ones((4, stages, n, 2))
    z = np.zeros((4, stages, n, 2))
    ds = np.zeros((4, stages, n, 2))
    dz = np.zeros((4, stages, n, 2))
    s_try = np.ones((4, stages, n, 2))
    mu = barrier
    for group in range(4):
        power = _power(group, h)
        for k in range(1 if group < 2 else 0, stages):
            for i in range(n):
                value = _expression(group, k, i, q, w, a)
                least = 0.01 * (bounds[group, i, 1] - bounds[group, i, 0]) * power
                for side in range(2):
                    slack = (1.0 - 2.0 * side) * (value - bounds[group, i, side] * power)
                    s[group, k, i, side] = max(slack, least)
                    z[group, k, i, side] = mu / s[group, k, i, side]
    Qq, rest = np.zeros((stages, n, n)), np.zeros((stages, n, n))
    positive = np.zeros((stages, n, n))
    Qm, Qw, R = np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n))
    fq = np.zeros((stages, n))
    gq, gw, ga = np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n))
    cq, cw, ca = np.zeros((stages, n)), np.zeros((stages, n)), np.zeros((stages, n))
    P, Z, L = np.zeros((2 * n, 2 * n)), np.zeros((stages, n, 2 * n)), np.zeros((stages, n, n))
    q0, w0, a0 = np.zeros((points, n)), np.zeros((points, n)), np.zeros((stages, n))
    q1, w1, a1 = np.zeros((points, n)), np.zeros((points, n)), np.zeros((stages, n))
    q_try, w_try, a_try = q.copy(), w.copy(), a.copy()
    still = np.zeros(n)
    value = objective(kind, q, a, h, time, effort, chain, f, fa, fb, conditions, sets, shape)
    penalty = 1.0
    decrement = np.inf
    residual = np.inf
    gap = np.inf
    curvature = 1.0
    fresh = True
    iteration = 0
    short = 0
    while iteration < most:
        if fresh:
            for k in range(1, stages):
                node_derivatives(
                    kind, q[k], chain, f, fa, fb, conditions, sets, shape, fq[k], positive[k], rest[k]
                )  # fmt: skip
            fresh = False
        iteration += 1
        # --- the condensed Newton system
        gq[:, :] = fq
        gw[:, :] = 0.0
        cq[:, :] = 0.0
        cw[:, :] = 0.0
        Qm[:, :] = 0.0
        Qw[:, :] = 0.0
        h2 = h * h
        h4 = h2 * h2
        energy = 0.0
        for k in range(stages):
            for i in range(n):
                R[k, i] = 2.0 * effort / h4
                ga[k, i] = 2.0 * effort * a[k, i] / h4
                ca[k, i] = -8.0 * effort * a[k, i] / (h4 * h)
                energy += a[k, i] * a[k, i]
        fh = time * points - 4.0 * effort * energy / (h4 * h)
        gh = fh
        chh = 20.0 * effort * energy / (h4 * h2)
        diagonal = np.zeros((stages, n))
        residual = 0.0
        gap = 0.0
        for group in range(4):
            power = _power(group, h)
            for k in range(1 if group < 2 else 0, stages):
                for i in range(n):
                    e = _expression(group, k, i, q, w, a)
                    for side in range(2):
                        sign = 1.0 - 2.0 * side
                        bound = bounds[group, i, side]
                        db = bound if group == 1 else (2.0 * bound * h if group == 2 else 0.0)
                        slack, force = s[group, k, i, side], z[group, k, i, side]
                        r = sign * (e - bound * power) - slack
                        ratio = force / slack
                        t = mu / slack - ratio * r
                        residual = max(residual, abs(r))
                        gap = max(gap, abs(slack * force - mu))
                        if group == 0:
                            diagonal[k, i] += ratio
                            gq[k, i] -= sign * t
                        elif group == 1:
                            Qw[k, i] += ratio
                            gw[k, i] -= sign * t
                            cw[k, i] -= db * ratio
                        elif group == 2:
                            R[k, i] += ratio
                            ga[k, i] -= sign * t
                            ca[k, i] -= db * ratio
                            chh += 2.0 * force * sign * bound
                        else:
                            diagonal[k, i] += ratio
                            Qm[k, i] += 0.5 * ratio
                            Qw[k, i] += 0.25 * ratio
                            gq[k, i] -= sign * t
                            gw[k, i] -= 0.5 * sign * t
                        gh += sign * db * t
                        chh += ratio * db * db
        # --- the exact Hessian, or as much of its indefinite part as leaves the step a descent
        share = min(1.0, 2.0 * curvature) if kind != 0 else 0.0
        while True:
            for k in range(stages):
                for i in range(n):
                    for j in range(n):
                        Qq[k, i, j] = positive[k, i, j] + share * rest[k, i, j]
                    Qq[k, i, i] += diagonal[k, i]
            if factorise(Qq, Qm, Qw, R, P, Z, L) or share == 0.0:
                break
            share = 0.5 * share if share > 0.1 else 0.0
        curvature = max(share, 0.1)
        descend(Qq, Qm, Qw, R, Z, L, gq, gw, ga, still, still, q0, w0, a0)
        descend(Qq, Qm, Qw, R, Z, L, cq, cw, ca, dq_first, dq_last, q1, w1, a1)
        bend = chh
        slope = gh
        for k in range(stages):
            for i in range(n):
                row = 2.0 * Qm[k, i] * w1[k, i]
                for j in range(n):
                    row += Qq[k, i, j] * q1[k, j]
                bend += q1[k, i] * row + Qw[k, i] * w1[k, i] ** 2 + R[k, i] * a1[k, i] ** 2
                bend += 2.0 * (cq[k, i] * q1[k, i] + cw[k, i] * w1[k, i] + ca[k, i] * a1[k, i])
                # dx⁰ᵀ H dx¹ + cᵀ dx⁰ + gᵀ dx¹
                slope += gq[k, i] * q1[k, i] + gw[k, i] * w1[k, i] + ga[k, i] * a1[k, i]
                slope += cq[k, i] * q0[k, i] + cw[k, i] * w0[k, i] + ca[k, i] * a0[k, i]
                row = Qm[k, i] * w1[k, i]
                for j in range(n):
                    row += Qq[k, i, j] * q1[k, j]
                slope += q0[k, i] * row + w0[k, i] * (Qw[k, i] * w1[k, i] + Qm[k, i] * q1[k, i])
                slope += a0[k, i] * R[k, i] * a1[k, i]
        bend = max(abs(bend), 1e-3 * abs(chh), 1e-9)
        dh = -slope / bend
        dh = min(max(dh, -0.5 * h), 2.0 * h)
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
        alpha, alpha_z = 1.0, 1.0
        keep = 1.0 - max(0.99, 1.0 - mu)
        total_residual = 0.0
        for group in range(4):
            power = _power(group, h)
            for k in range(1 if group < 2 else 0, stages):
                for i in range(n):
                    e = _expression(group, k, i, q, w, a)
                    de = _expression(group, k, i, q0, w0, a0)
                    for side in range(2):
                        sign = 1.0 - 2.0 * side
                        bound = bounds[group, i, side]
                        db = bound if group == 1 else (2.0 * bound * h if group == 2 else 0.0)
                        slack, force = s[group, k, i, side], z[group, k, i, side]
                        r = sign * (e - bound * power) - slack
                        step = sign * (de - db * dh) + r
                        ds[group, k, i, side] = step
                        push = mu / slack - force - force / slack * step
                        dz[group, k, i, side] = push
                        total_residual += abs(r)
                        down -= mu * step / slack
                        if step < 0.0:
                            alpha = min(alpha, -(1.0 - keep) * slack / step)
                        if push < 0.0:
                            alpha_z = min(alpha_z, -(1.0 - keep) * force / push)
        if total_residual > 1e-12:
            penalty = max(penalty, 2.0 * down / total_residual)
        down -= penalty * total_residual
        # --- done, or the next barrier
        settled = decrement <= 3.0 * mu and residual <= max(1e-7, 0.1 * mu) and gap <= 10.0 * mu
        if mu <= barrier_last and decrement <= 1e-7 * (1.0 + abs(value)) and residual <= 1e-8 and gap <= 10.0 * mu:
            break
        # --- line search on the merit function
        logs, off = _slack_merit(q, w, a, h, bounds, s, ds, 0.0, s_try)
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
            value_try = objective(kind, q_try, a_try, h_try, time, effort, chain, f, fa, fb, conditions, sets, shape)
            logs, off = _slack_merit(q_try, w_try, a_try, h_try, bounds, s, ds, alpha, s_try)
            new = value_try - mu * logs + penalty * off
            # Where the decrement is next to rounding, the merit's differences say nothing any more.
            flat = decrement <= 1e-8 * (1.0 + abs(value)) and off < 1e-6
            if flat or new <= merit + 1e-4 * alpha * min(down, 0.0) + 1e-12 * (1.0 + abs(merit)):
                accepted = True
                break
            alpha *= 0.5
        if not accepted:
            if curvature > 0.1 and kind != 0:
                curvature = 0.05
                short += 1
                if short < 5:
                    continue
            break
        h += alpha * dh
        q[:, :] = q_try
        w[:, :] = w_try
        a[:, :] = a_try
        value = value_try
        fresh = True
        for group in range(4):
            for k in range(1 if group < 2 else 0, stages):
                for i in range(n):
                    for side in range(2):
                        slack = s_try[group, k, i, side]
                        force = z[group, k, i, side] + alpha_z * dz[group, k, i, side]
                        s[group, k, i, side] = slack
                        # Never far from the central path: keeps the primal-dual Hessian a barrier's.
                        z[group, k, i, side] = min(max(force, mu / slack * 1e-6), mu / slack * 1e6)
        if settled and mu > barrier_last:
            mu = max(barrier_last, min(0.2 * mu, mu**1.5))
            penalty = 1.0
    return np.array([h, value, float(iteration), decrement, residual, gap, mu])
