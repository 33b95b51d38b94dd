"""Limits that a drive keeps by itself, whatever its master says.

The set point of an axis moves in ticks: `position += velocity * dt`. Its velocity stays within its limit, changes by at
most `acceleration * dt` per tick, and is never higher than what can still be braked away before a position limit.
Every limiter says whether it had to act.
"""

from __future__ import annotations

import math

from stack.compiled import compiled

LIMITED_POSITION = 1
LIMITED_VELOCITY = 2
LIMITED_ACCELERATION = 4
LIMITED_TORQUE = 8
STANDSTILL = 16
OVERDUE = 32

_ROUNDING = 1e-9
"""Relative excess up to which a limit does not count as exceeded: what rounding in the interpolation amounts to."""


@compiled
def clamp(value: float, lower: float, upper: float) -> tuple[float, bool]:
    """`value` inside [`lower`, `upper`], and whether it had been outside."""
    if value > upper:
        return upper, True
    if value < lower:
        return lower, True
    return value, False


@compiled
def braking_velocity(distance: float, acceleration: float, dt_s: float) -> float:
    """Highest velocity of the coming tick from which the axis still stops within `distance` (>= 0).

    Exact for motion in ticks: `n` ticks that each lose `acceleration * dt` cover `distance`, the first one included
    (the discrete time-optimal curve, which goes to sqrt(2 a d) for small ticks).
    """
    if distance <= 0.0:
        return 0.0
    loss = acceleration * dt_s * dt_s
    ticks = math.ceil((math.sqrt(1.0 + 8.0 * distance / loss) - 1.0) / 2.0)
    if ticks < 1:
        ticks = 1
    return (distance / ticks + (ticks - 1) * loss / 2.0) / dt_s


@compiled
def limit_velocity(
    wanted: float,
    position: float,
    velocity: float,
    lower: float,
    upper: float,
    velocity_limit: float,
    acceleration_limit: float,
    dt_s: float,
) -> tuple[float, int]:
    """Velocity for the coming tick, as near to `wanted` as the limits allow, and the LIMITED_* bits.

    `position` and `velocity` are the set point's own, before the tick. The acceleration limit has the last word:
    an axis that starts beyond a limit is braked and brought back, not torn back. Started inside, it stays inside.
    """
    flags = 0
    allowed, limited = clamp(wanted, -velocity_limit, velocity_limit)
    if limited and abs(wanted) > velocity_limit * (1.0 + _ROUNDING):
        flags |= LIMITED_VELOCITY
    if math.isfinite(upper) and allowed > 0.0:
        ceiling = braking_velocity(upper - position, acceleration_limit, dt_s)
        if allowed > ceiling:
            if allowed > ceiling * (1.0 + _ROUNDING) + _ROUNDING:
                flags |= LIMITED_POSITION
            allowed = ceiling
    if math.isfinite(lower) and allowed < 0.0:
        ceiling = braking_velocity(position - lower, acceleration_limit, dt_s)
        if -allowed > ceiling:
            if -allowed > ceiling * (1.0 + _ROUNDING) + _ROUNDING:
                flags |= LIMITED_POSITION
            allowed = -ceiling
    change = acceleration_limit * dt_s
    result, limited = clamp(allowed, velocity - change, velocity + change)
    if limited and abs(allowed - velocity) > change * (1.0 + _ROUNDING) + _ROUNDING:
        flags |= LIMITED_ACCELERATION
    return result, flags


@compiled
def catch_up_velocity(error: float, acceleration: float, dt_s: float) -> float:
    """Velocity that closes `error` as fast as `acceleration` allows, without running past it."""
    if error >= 0.0:
        return min(error / dt_s, braking_velocity(error, acceleration, dt_s))
    return -min(-error / dt_s, braking_velocity(-error, acceleration, dt_s))
