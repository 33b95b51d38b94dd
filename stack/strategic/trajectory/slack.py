"""The limits of the interior-point method: what each one bounds, its slack, its share of the Newton system and of the step; compiled.

Limits have slacks and multipliers `s`, `z` (4, N−1, n, 2), last index lower, upper: 0 the node q_k, 1 w_k, 2 a_k, 3 q_k + w_k/2, the middle
control point of the parabola from node k to k + 1 (the ends are nodes): as a curve stays inside the hull of its control points, positions
hold their limits between the nodes, too. `bounds` (4, n, 2) in q, q̇, q̈, q.
"""

from __future__ import annotations

import math

from stack.compiled import compiled
from stack.messages import Matrix

Slacks = Matrix
"""(4, N−1, n, 2)."""
NODE, SPEED, ACCELERATION, BETWEEN = range(4)


@compiled
def expression(kind: int, k: int, i: int, q: Matrix, w: Matrix, a: Matrix) -> float:
    """What limit `kind` bounds in stage k, joint i."""
    if kind == 0:
        return float(q[k, i])
    if kind == 1:
        return float(w[k, i])
    if kind == 2:
        return float(a[k, i])
    return float(q[k, i] + 0.5 * w[k, i])


@compiled
def power(kind: int, h: float) -> float:
    """Of the step: what a bound in SI is multiplied by."""
    return h if kind == 1 else (h * h if kind == 2 else 1.0)


@compiled
def bound_rate(kind: int, bound: float, h: float) -> float:
    """d(bound · power)/dh."""
    return bound if kind == 1 else (2.0 * bound * h if kind == 2 else 0.0)


@compiled
def first_slacks(q: Matrix, w: Matrix, a: Matrix, h: float, bounds: Matrix, mu: float, s: Slacks, z: Slacks) -> None:
    """Slacks at least 1 % of the room between the bounds, multipliers on the central path of `mu`."""
    stages, n = a.shape
    for kind in range(4):
        p = power(kind, h)
        for k in range(1 if kind < 2 else 0, stages):
            for i in range(n):
                value = expression(kind, k, i, q, w, a)
                least = 0.01 * (bounds[kind, i, 1] - bounds[kind, i, 0]) * p
                for side in range(2):
                    slack = (1.0 - 2.0 * side) * (value - bounds[kind, i, side] * p)
                    s[kind, k, i, side] = max(slack, least)
                    z[kind, k, i, side] = mu / s[kind, k, i, side]


@compiled
def slack_merit(
    q: Matrix, w: Matrix, a: Matrix, h: float, bounds: Matrix, s: Slacks, ds: Slacks, alpha: float, out: Slacks
) -> tuple[float, float]:
    """Σ log s and Σ|c − s| at the trial point; `out` becomes its slacks, s + α ds or the constraint itself where that is larger."""
    stages, n = a.shape
    logs = 0.0
    residual = 0.0
    for kind in range(4):
        p = power(kind, h)
        for k in range(1 if kind < 2 else 0, stages):
            product = 1.0
            for i in range(n):
                value = expression(kind, k, i, q, w, a)
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    c = sign * (value - bounds[kind, i, side] * p)
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
def condense(
    q: Matrix, w: Matrix, a: Matrix, h: float, bounds: Matrix, mu: float, s: Slacks, z: Slacks,
    diagonal: Matrix, Qm: Matrix, Qw: Matrix, R: Matrix, gq: Matrix, gw: Matrix, ga: Matrix, cw: Matrix, ca: Matrix,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Adds the slacks' share to the Newton system, (N−1, n) each; returns (gradient, curvature) in h, greatest residual and gap."""
    stages, n = a.shape
    gh, chh, residual, gap = 0.0, 0.0, 0.0, 0.0
    for kind in range(4):
        p = power(kind, h)
        for k in range(1 if kind < 2 else 0, stages):
            for i in range(n):
                e = expression(kind, k, i, q, w, a)
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    bound = bounds[kind, i, side]
                    db = bound_rate(kind, bound, h)
                    slack, force = s[kind, k, i, side], z[kind, k, i, side]
                    r = sign * (e - bound * p) - slack
                    ratio = force / slack
                    t = mu / slack - ratio * r
                    residual = max(residual, abs(r))
                    gap = max(gap, abs(slack * force - mu))
                    if kind == 0:
                        diagonal[k, i] += ratio
                        gq[k, i] -= sign * t
                    elif kind == 1:
                        Qw[k, i] += ratio
                        gw[k, i] -= sign * t
                        cw[k, i] -= db * ratio
                    elif kind == 2:
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
    return gh, chh, residual, gap


@compiled
def slack_steps(
    q: Matrix, w: Matrix, a: Matrix, h: float, dq: Matrix, dw: Matrix, da: Matrix, dh: float, bounds: Matrix, mu: float,
    s: Slacks, z: Slacks, ds: Slacks, dz: Slacks,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Fills `ds`, `dz`; returns how far slacks and multipliers may go, Σ|residual|, and what the barrier changes to first order."""
    stages, n = a.shape
    alpha, alpha_z, off, down = 1.0, 1.0, 0.0, 0.0
    most = max(0.99, 1.0 - mu)
    for kind in range(4):
        p = power(kind, h)
        for k in range(1 if kind < 2 else 0, stages):
            for i in range(n):
                e = expression(kind, k, i, q, w, a)
                de = expression(kind, k, i, dq, dw, da)
                for side in range(2):
                    sign = 1.0 - 2.0 * side
                    bound = bounds[kind, i, side]
                    slack, force = s[kind, k, i, side], z[kind, k, i, side]
                    r = sign * (e - bound * p) - slack
                    step = sign * (de - bound_rate(kind, bound, h) * dh) + r
                    push = mu / slack - force - force / slack * step
                    ds[kind, k, i, side] = step
                    dz[kind, k, i, side] = push
                    off += abs(r)
                    down -= mu * step / slack
                    if step < 0.0:
                        alpha = min(alpha, -most * slack / step)
                    if push < 0.0:
                        alpha_z = min(alpha_z, -most * force / push)
    return alpha, alpha_z, off, down


@compiled
def advance(s: Slacks, z: Slacks, dz: Slacks, s_new: Slacks, alpha_z: float, mu: float) -> None:
    """Takes the slacks of the accepted point and moves the multipliers; never far from the central path, so that the
    primal-dual Hessian stays a barrier's."""
    stages, n = s.shape[1], s.shape[2]
    for kind in range(4):
        for k in range(1 if kind < 2 else 0, stages):
            for i in range(n):
                for side in range(2):
                    slack = s_new[kind, k, i, side]
                    force = z[kind, k, i, side] + alpha_z * dz[kind, k, i, side]
                    s[kind, k, i, side] = slack
                    z[kind, k, i, side] = min(max(force, mu / slack * 1e-6), mu / slack * 1e6)
