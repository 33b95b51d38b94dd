"""What a drive watches in every tick, for a whole bank at once: encoders, following error, speed, position, SYNC.

The kernels set bits of `Alarm` per axis and say whether there are any, so that the usual tick has no Python per axis.
"""

from __future__ import annotations

import math
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.servo.limiter import STANDSTILL
from stack.servo.state import AxisMode

IntVector = NDArray[np.int64]

NO_DEADLINE = np.iinfo(np.int64).max
SPEED_MARGIN = 1.5
"""An axis is too fast beyond this multiple of its velocity limit …"""
SPEED_TIME_S = 0.05
"""… for longer than this."""
STILL = 0.01
"""An axis stands below this fraction of its velocity limit."""
JUMP = 6.0
"""A reading that takes a change of speed by more than this multiple of the velocity limit within a tick cannot be true."""
FROZEN = 0.02
"""An encoder that has not changed at all while its set point went this fraction of the following error window is frozen …"""
FROZEN_LEAST_S = 0.01
"""… and has not for longer than this …"""
FLICKERING_LEAST_S = 0.0015
"""… or than this where its last digits are never still: in motion two readings that are the same to the last bit are proof enough, and a
loop that is told that a joint stands makes it half as fast again within 10 ms."""
FLICKER_S = 0.05
"""The last digits of an encoder of high resolution are never still, not even at rest: unchanged for longer than this it is frozen."""
RATE_MARGIN = 0.15
"""A velocity-controlled axis does not follow when it is off its command by this fraction of its velocity limit …"""
RATE_TIME_S = 0.4
"""… for longer than this."""
SETTLING_S = 0.25
"""A stop counts as completed this long after the set point stands, even if the axis swings on."""


class Alarm(IntFlag):
    """What the Python side of a drive has to hear of."""

    SENSOR = 1
    """An encoder reading that is no number, jumps, or stands still while the axis is led."""
    FOLLOWING_ERROR = 2
    OVERSPEED = 4
    POSITION_LIMIT = 8
    """Beyond a position limit and on its way further; in torque mode: could not stop before it any more."""
    SYNC_LOST = 16
    STOPPED = 32
    """A stop that somebody waits for is completed."""
    RATE_ERROR = 64
    """A velocity-controlled axis does not turn as it is told."""


# Rows of the watch table, one column per axis.
WINDOW, WINDOW_TIME_S, OUTSIDE_S = range(3)
SPEED_LIMIT, TOO_FAST_S = range(3, 5)
LOWER, UPPER, DECELERATION = range(5, 8)
AWAITS_STOP, STANDING_S = range(8, 10)
SEEN, LAST_SET_POINT, UNSEEN_WAY, UNSEEN_S = range(10, 14)
RATE_WINDOW, RATE_S = range(14, 16)
UNSEEN_LIMIT_S = 16
WATCH_ROWS = 17

_OFF, _POSITION, _TORQUE, _STOP = (
    int(mode) for mode in (AxisMode.OFF, AxisMode.POSITION, AxisMode.TORQUE, AxisMode.STOP)
)
_STANDSTILL, _NO_DEADLINE = STANDSTILL, int(NO_DEADLINE)
_SENSOR, _FOLLOWING, _OVERSPEED = int(Alarm.SENSOR), int(Alarm.FOLLOWING_ERROR), int(Alarm.OVERSPEED)
_POSITION_LIMIT, _SYNC_LOST, _STOPPED = int(Alarm.POSITION_LIMIT), int(Alarm.SYNC_LOST), int(Alarm.STOPPED)
_RATE_ERROR = int(Alarm.RATE_ERROR)


def watch_table(count: int) -> Matrix:
    """Nothing watched yet: (WATCH_ROWS, count)."""
    table = np.zeros((WATCH_ROWS, count))
    table[[WINDOW, SPEED_LIMIT, UPPER, RATE_WINDOW, UNSEEN_LIMIT_S]] = np.inf
    table[LOWER] = -np.inf
    table[DECELERATION] = 1.0
    return table


@compiled
def sense(
    raw_position: Vector,
    raw_velocity: Vector,
    zero: Vector,
    position: Vector,
    velocity: Vector,
    alarms: IntVector,
    mode: IntVector,
    watch: Matrix,
    dt_s: float,
) -> bool:
    """Encoders into `position` (less the home offset `zero`) and `velocity`. Clears `alarms`.

    An axis whose reading is not finite, or (under power) cannot be true after the last one, keeps its last position, velocity 0, and
    gets SENSOR: it must not get into the loops, not for one tick.
    """
    found = False
    for axis in range(position.shape[0]):
        alarms[axis] = 0
        good = math.isfinite(raw_position[axis]) and math.isfinite(raw_velocity[axis])
        if good and mode[axis] != _OFF:
            change = JUMP * watch[SPEED_LIMIT, axis]
            expected = position[axis] + velocity[axis] * dt_s
            good = abs(raw_position[axis] - zero[axis] - expected) <= change * dt_s
            good = good and abs(raw_velocity[axis] - velocity[axis]) <= change
        if good:
            position[axis] = raw_position[axis] - zero[axis]
            velocity[axis] = raw_velocity[axis]
        else:
            velocity[axis] = 0.0
            alarms[axis] = _SENSOR
            found = True
    return found


@compiled
def watch_axis(
    watch: Matrix,
    axis: int,
    mode: int,
    position: float,
    velocity: float,
    set_point: float,
    command: float,
    flags: int,
    dt_s: float,
) -> int:
    """Alarm bits of one powered axis. `command`: what goes to the plant, a velocity where RATE_WINDOW is finite."""
    bits = 0
    if position == watch[SEEN, axis]:
        watch[UNSEEN_WAY, axis] += abs(set_point - watch[LAST_SET_POINT, axis])
        watch[UNSEEN_S, axis] += dt_s
    else:
        watch[SEEN, axis] = position
        watch[UNSEEN_WAY, axis] = 0.0
        watch[UNSEEN_S, axis] = 0.0
    watch[LAST_SET_POINT, axis] = set_point
    least = FLICKERING_LEAST_S if watch[UNSEEN_LIMIT_S, axis] < math.inf else FROZEN_LEAST_S
    if watch[UNSEEN_S, axis] > least and watch[UNSEEN_WAY, axis] > FROZEN * watch[WINDOW, axis]:
        bits |= _SENSOR
    if watch[UNSEEN_S, axis] > watch[UNSEEN_LIMIT_S, axis]:
        bits |= _SENSOR
    off = abs(command - velocity) > watch[RATE_WINDOW, axis]
    watch[RATE_S, axis] = watch[RATE_S, axis] + dt_s if off else 0.0
    if watch[RATE_S, axis] > RATE_TIME_S:
        bits |= _RATE_ERROR
    limit = watch[SPEED_LIMIT, axis]
    error = abs(set_point - position)
    outside = mode in (_POSITION, _STOP) and error > watch[WINDOW, axis]
    watch[OUTSIDE_S, axis] = watch[OUTSIDE_S, axis] + dt_s if outside else 0.0
    if outside and watch[OUTSIDE_S, axis] > watch[WINDOW_TIME_S, axis]:
        bits |= _FOLLOWING
    fast = abs(velocity) > SPEED_MARGIN * limit
    watch[TOO_FAST_S, axis] = watch[TOO_FAST_S, axis] + dt_s if fast else 0.0
    if watch[TOO_FAST_S, axis] > SPEED_TIME_S:
        bits |= _OVERSPEED
    if abs(velocity) > STILL * limit:
        room = watch[UPPER, axis] - position if velocity > 0.0 else position - watch[LOWER, axis]
        needed = -watch[WINDOW, axis]
        if mode == _TORQUE:
            needed = velocity * velocity / (2.0 * watch[DECELERATION, axis])
        if room < needed:
            bits |= _POSITION_LIMIT
    if mode == _STOP and flags & _STANDSTILL:
        watch[STANDING_S, axis] += dt_s
        still = abs(velocity) <= STILL * limit or watch[STANDING_S, axis] > SETTLING_S
        if watch[AWAITS_STOP, axis] != 0.0 and still:
            watch[AWAITS_STOP, axis] = 0.0
            bits |= _STOPPED
    else:
        watch[STANDING_S, axis] = 0.0
    return bits


@compiled
def supervise(
    watch: Matrix,
    deadline_ns: IntVector,
    t_ns: int,
    mode: IntVector,
    position: Vector,
    velocity: Vector,
    set_point: Vector,
    command: Vector,
    flags: IntVector,
    limited: IntVector,
    alarms: IntVector,
    dt_s: float,
) -> bool:
    """Sets `alarms` per axis and adds the tick's flags to `limited`; True if there is any alarm.

    A SYNC deadline that has passed is reported once. Unpowered axes have no alarms but that.
    """
    found = False
    for axis in range(position.shape[0]):
        bits = 0
        if mode[axis] == _OFF:
            watch[OUTSIDE_S, axis] = 0.0
            watch[TOO_FAST_S, axis] = 0.0
            watch[RATE_S, axis] = 0.0
            watch[UNSEEN_WAY, axis] = 0.0
            watch[UNSEEN_S, axis] = 0.0
            watch[LAST_SET_POINT, axis] = set_point[axis]
        else:
            bits = watch_axis(
                watch,
                axis,
                mode[axis],
                position[axis],
                velocity[axis],
                set_point[axis],
                command[axis],
                flags[axis],
                dt_s,
            )
            limited[axis] |= flags[axis]
        if t_ns > deadline_ns[axis]:
            deadline_ns[axis] = _NO_DEADLINE
            bits |= _SYNC_LOST
        alarms[axis] = bits
        if bits != 0:
            found = True
    return found
