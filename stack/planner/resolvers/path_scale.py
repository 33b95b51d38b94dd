"""Slowing down on the path: the largest share of the commanded twist, and of the preferred motion, that the velocity bounds allow."""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Vector

NULL_COST = 0.01
"""What giving up preferred motion costs, relative to slowing down: small, so that the null-space part goes first."""

_SLACK = 1e-12


@compiled
def path_and_null_scale(
    fixed: Vector, path: Vector, null: Vector, lower: Vector, upper: Vector
) -> tuple[float, float, int, float]:
    """(s, τ) in [0, 1]² that minimises (1 − s)² + NULL_COST (1 − τ)² under lower ≤ fixed + s·path + τ·null ≤ upper.

    The optimum of a strictly convex problem, so it is unique and moves without jumps as the arguments do; exact, by adding one
    half-plane at a time. Returns (s, τ, index of the last half-plane that shaped it, shortfall): index 2i for the lower and 2i + 1 for the
    upper bound of joint i, -1 for none; shortfall > 0 says that no (s, τ) keeps the bounds, and by how much the worst is missed.
    """
    n = fixed.shape[0]
    count = 4 + 2 * n
    root = math.sqrt(NULL_COST)
    # half-planes a·(s, y) <= c in the metric of the cost: y = sqrt(NULL_COST) tau
    a = np.zeros((count, 2))
    c = np.full(count, np.inf)
    a[0, 0], c[0] = -1.0, 0.0
    a[1, 0], c[1] = 1.0, 1.0
    a[2, 1], c[2] = -1.0, 0.0
    a[3, 1], c[3] = 1.0, root
    for i in range(n):
        a[4 + 2 * i, 0], a[4 + 2 * i, 1], c[4 + 2 * i] = -path[i], -null[i] / root, fixed[i] - lower[i]
        a[5 + 2 * i, 0], a[5 + 2 * i, 1], c[5 + 2 * i] = path[i], null[i] / root, upper[i] - fixed[i]
    s, y = 1.0, root
    last = -1
    for k in range(4, count):
        if c[k] == np.inf:
            continue
        length = math.sqrt(a[k, 0] ** 2 + a[k, 1] ** 2)
        excess = a[k, 0] * s + a[k, 1] * y - c[k]
        if excess <= _SLACK * max(1.0, abs(c[k])):
            continue
        last = k - 4
        if length <= 1e-300:
            return 0.0, 0.0, last, excess
        # the optimum now lies on this line: point + t·direction, nearest to (1, root)
        dx, dy = -a[k, 1] / length, a[k, 0] / length
        px, py = a[k, 0] * c[k] / length**2, a[k, 1] * c[k] / length**2
        low, high = -np.inf, np.inf
        for other in range(k):
            if c[other] == np.inf:
                continue
            slope = a[other, 0] * dx + a[other, 1] * dy
            room = c[other] - a[other, 0] * px - a[other, 1] * py
            size = math.sqrt(a[other, 0] ** 2 + a[other, 1] ** 2)
            if abs(slope) <= 1e-14 * size:
                if room < -_SLACK * max(1.0, abs(c[other])):
                    high = -np.inf
            elif slope > 0.0:
                high = min(high, room / slope)
            else:
                low = max(low, room / slope)
        if low > high:
            if low - high > 1e-9:
                return 0.0, 0.0, last, _shortfall(fixed, lower, upper)
            high = low
        t = min(max((1.0 - px) * dx + (root - py) * dy, low), high)
        s, y = px + t * dx, py + t * dy
    return min(max(s, 0.0), 1.0), min(max(y / root, 0.0), 1.0), last, 0.0


@compiled
def into_bounds(dq: Vector, lower: Vector, upper: Vector) -> Vector:
    """dq (n,) moved straight towards the middle of its bounds until it keeps them all: for ± bounds that slows every joint alike,
    for bounds around the last velocity (acceleration) it changes all joints in step. Infinite bounds stay out of it;
    where lower > upper the joint goes to the middle."""
    n = dq.shape[0]
    middle = dq.copy()
    share = 1.0
    for i in range(n):
        if lower[i] > -np.inf and upper[i] < np.inf:
            middle[i] = 0.5 * (lower[i] + upper[i])
        else:
            middle[i] = min(max(dq[i], lower[i]), upper[i])
        room = max(0.5 * (upper[i] - lower[i]), 0.0)
        away = abs(dq[i] - middle[i])
        if middle[i] != dq[i] and away > room and room < np.inf:
            share = min(share, room / away)
    result = np.empty(n)
    for i in range(n):
        result[i] = middle[i] + share * (dq[i] - middle[i])
        if lower[i] <= upper[i]:
            result[i] = min(max(result[i], lower[i]), upper[i])
    return result


@compiled
def _shortfall(fixed: Vector, lower: Vector, upper: Vector) -> float:
    """By how much the motion that cannot be scaled leaves the bounds, at the worst joint; at least a rounding error."""
    worst = 1e-300
    for i in range(fixed.shape[0]):
        worst = max(worst, lower[i] - fixed[i], fixed[i] - upper[i])
    return worst
