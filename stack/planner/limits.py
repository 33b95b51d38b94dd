"""Joint limits: padding zones and their rule base, and what position, velocity and acceleration limits leave for one cycle.

Kernels, pure and compiled; arrays float64 and C-contiguous. The rule base takes whatever resolver's unconstrained solution: it only
needs the whitened null-space base (see `resolvers/nullspace.py`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.resolvers.nullspace import restrict

Flags = NDArray[np.bool_]

_STEPS_AT_ONCE = 4
_NOTHING = 1e-13


@compiled
def limit_scale(q: float, lower: float, lower_threshold: float, upper_threshold: float, upper: float) -> float:
    """s(q) of one joint: 1 between the thresholds, `1 − ((q − q_th)/(q_lim − q_th))²` inside a zone, 0 at a limit and outside it."""
    if q > upper_threshold:
        return 0.0 if q >= upper else 1.0 - ((q - upper_threshold) / (upper - upper_threshold)) ** 2
    if q < lower_threshold:
        return 0.0 if q <= lower else 1.0 - ((q - lower_threshold) / (lower - lower_threshold)) ** 2
    return 1.0


@compiled
def zones(
    q: Vector,
    lower: Vector,
    lower_threshold: Vector,
    upper_threshold: Vector,
    upper: Vector,
    recovery_rate: float,
    recovery_velocity: Vector,
) -> tuple[Vector, Vector, Vector]:
    """Where each joint stands: direction (n,) of the limit whose zone it is in (+1 upper, −1 lower, 0 none), s(q) (n,), floor (n,).

    `floor` is the velocity that a joint outside its limit must at least have towards the inside:
    `recovery_rate` (1/s) times how far it is outside, at most `recovery_velocity` (n,). It is 0 inside the limits.
    """
    n = q.shape[0]
    direction = np.zeros(n)
    softness = np.ones(n)
    floor = np.zeros(n)
    for i in range(n):
        softness[i] = limit_scale(q[i], lower[i], lower_threshold[i], upper_threshold[i], upper[i])
        if q[i] > upper_threshold[i]:
            direction[i] = 1.0
            floor[i] = -min(max(0.0, recovery_rate * (q[i] - upper[i])), recovery_velocity[i])
        elif q[i] < lower_threshold[i]:
            direction[i] = -1.0
            floor[i] = min(max(0.0, recovery_rate * (lower[i] - q[i])), recovery_velocity[i])
    return direction, softness, floor


@compiled
def restrict_active(
    white: Matrix,
    weight: Matrix,
    unconstrained: Vector,
    rows: Matrix,
    values: Vector,
    active: Flags,
    softness: Vector,
    floor: Vector,
    epsilon: float,
) -> tuple[Vector, Vector, bool]:
    """Hard rows plus the limits of the joints that `active` (n,) marks, enforced together: q̇ (n,), η (n,), damped."""
    k = rows.shape[0]
    n = unconstrained.shape[0]
    total = k
    for i in range(n):
        if active[i]:
            total += 1
    pull = np.zeros(n)
    if total == 0:
        return unconstrained.copy(), pull, False
    all_rows = np.zeros((total, n))
    all_floor = np.zeros(total)
    all_softness = np.zeros(total)
    for i in range(k):
        all_floor[i] = values[i]
        for j in range(n):
            all_rows[i, j] = rows[i, j]
    at = k
    for i in range(n):
        if active[i]:
            all_rows[at, i] = 1.0
            all_floor[at] = floor[i]
            all_softness[at] = softness[i]
            at += 1
    dq, eta, damped = restrict(white, weight, unconstrained, all_rows, all_floor, all_softness, epsilon)
    at = k
    for i in range(n):
        if active[i]:
            pull[i] = eta[at]
            at += 1
    return dq, pull, damped


@compiled
def hold_limits(
    white: Matrix,
    weight: Matrix,
    unconstrained: Vector,
    rows: Matrix,
    values: Vector,
    direction: Vector,
    softness: Vector,
    floor: Vector,
    epsilon: float,
) -> tuple[Vector, Flags, bool]:
    """The joint-limit rule base on top of hard rows: q̇ (n,), which joints it restricted (n,) bool, damped.

    A joint inside a zone that would move further towards its limit is slowed to s(q) times the rate that it would have without its own
    restriction (2.160 ff.: for one joint that is `s·q̇_u`, the rule as printed). With several joints at once each of them counts the
    others' restrictions in: the answer is then the unique optimum of a convex problem, so it neither depends on an order nor jumps when
    a second joint enters its zone, where taking q̇_u for all of them would. Iterated until no joint enters or leaves; singly after
    a few rounds, lowest index first (Murty's rule), so it terminates. More restrictions than the null space has dimensions:
    the limits hold, the task gives way (damped).
    """
    n = unconstrained.shape[0]
    active = np.zeros(n, np.bool_)
    for i in range(n):
        active[i] = direction[i] * (unconstrained[i] - floor[i]) > 0.0
    dq = unconstrained
    damped = False
    for step in range(_STEPS_AT_ONCE + 4 * n):
        dq, pull, damped = restrict_active(white, weight, unconstrained, rows, values, active, softness, floor, epsilon)
        changed = False
        for i in range(n):
            if direction[i] == 0.0:
                continue
            wrong = direction[i] * (pull[i] if active[i] else dq[i] - floor[i])
            if wrong > _NOTHING:
                active[i] = not active[i]
                changed = True
                if step >= _STEPS_AT_ONCE:
                    break
        if not changed:
            break
    return dq, active, damped


@compiled
def velocity_bounds(
    q: Vector,
    dq_previous: Vector,
    lower: Vector,
    upper: Vector,
    dq_max: Vector,
    ddq_max: Vector,
    recovery_rate: float,
    dt: float,
) -> tuple[Vector, Vector]:
    """Position, velocity and acceleration limits (all (n,)) together as velocity bounds for the next cycle of length dt: lower, upper.

    Position enters as the speed from which the joint can still stop at its limit with ddq_max (braking distance), so no later cycle finds
    itself in a dead end; a joint outside its limit must come back, at `recovery_rate` (1/s) times the overshoot and at most a fifth of
    dq_max. The bounds never cross: where acceleration cannot meet the others, it wins and the joint brakes as hard as it may.
    """
    n = q.shape[0]
    low = np.empty(n)
    high = np.empty(n)
    for i in range(n):
        slow = 0.2 * dq_max[i]
        ahead = upper[i] - q[i]
        behind = q[i] - lower[i]
        step = ddq_max[i] * dt
        if ahead >= 0.0:
            top = min(dq_max[i], math.sqrt(step * step + 2.0 * ddq_max[i] * ahead) - step)
        else:
            top = -min(slow, -recovery_rate * ahead)
        if behind >= 0.0:
            bottom = -min(dq_max[i], math.sqrt(step * step + 2.0 * ddq_max[i] * behind) - step)
        else:
            bottom = min(slow, -recovery_rate * behind)
        high[i] = min(max(top, dq_previous[i] - step), dq_previous[i] + step)
        low[i] = min(max(bottom, dq_previous[i] - step), dq_previous[i] + step)
    return low, high


@compiled
def limit_velocity(dq: Vector, dq_max: Vector) -> tuple[Vector, bool]:
    """dq (n,) scaled as a whole so that no joint exceeds dq_max, and whether it had to be: a robot that slows down on its path."""
    worst = 1.0
    for i in range(dq.shape[0]):
        worst = max(worst, abs(dq[i]) / dq_max[i])
    return dq / worst, worst > 1.0


@compiled
def limit_acceleration(dq: Vector, dq_previous: Vector, ddq_max: Vector, dt: float) -> tuple[Vector, bool]:
    """dq (n,) moved back towards dq_previous, along the straight line between them, until no joint accelerates by more than
    ddq_max; and whether it had to be."""
    worst = 1.0
    for i in range(dq.shape[0]):
        worst = max(worst, abs(dq[i] - dq_previous[i]) / (ddq_max[i] * dt))
    if worst == 1.0:
        return dq.copy(), False
    return dq_previous + (dq - dq_previous) / worst, True


@compiled
def acceleration_scale(dq: Vector, dq_previous: Vector, ddq_max: Vector, dt: float) -> tuple[float, bool]:
    """The share of dq in [0, 1], nearest to 1, for which no joint accelerates by more than ddq_max, and whether there is one.

    Where there is none, the share that exceeds the limits least: the caller follows with `limit_acceleration` and leaves the path.
    """
    low = 0.0
    high = 1.0
    for i in range(dq.shape[0]):
        step = ddq_max[i] * dt
        if dq[i] > 0.0:
            low = max(low, (dq_previous[i] - step) / dq[i])
            high = min(high, (dq_previous[i] + step) / dq[i])
        elif dq[i] < 0.0:
            low = max(low, (dq_previous[i] + step) / dq[i])
            high = min(high, (dq_previous[i] - step) / dq[i])
        elif abs(dq_previous[i]) > step:
            low = 2.0
    if low <= high:
        return high, True
    low = 0.0
    high = 1.0
    for _bisection in range(60):
        left = low + (high - low) / 3.0
        right = high - (high - low) / 3.0
        if _excess(left, dq, dq_previous, ddq_max) > _excess(right, dq, dq_previous, ddq_max):
            low = left
        else:
            high = right
    return 0.5 * (low + high), False


@compiled
def _excess(share: float, dq: Vector, dq_previous: Vector, ddq_max: Vector) -> float:
    worst = 0.0
    for i in range(dq.shape[0]):
        worst = max(worst, abs(share * dq[i] - dq_previous[i]) / ddq_max[i])
    return worst
