"""The servo law of all axes in one compiled call: set point, limits, position, velocity and torque loop.

    set point   p*, v*   from the cyclic targets (interpolation.py), limited (limiter.py)
    position    v_c = k_ff v* + k_p (p* - p)       all three at the start of the tick, when the encoder was read
    velocity    e   = v_c - v,   integral += k_i e dt   (frozen while the torque saturates in its direction, 0 where it
                would drive the axis on beyond its velocity limit)
    torque      tau = k_v e + integral + offset,  clamped

A drive knows its own joint only: gravity and inertia come from the master as the torque offset (CiA 402, 60B2h), which
runs in a straight line from one target to the next, as the set point does.

Kernels change the state table in place and depend on nothing but their arguments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.servo.interpolation import hermite, linear, node_velocity
from stack.servo.limiter import (
    LIMITED_POSITION,
    LIMITED_TORQUE,
    LIMITED_VELOCITY,
    OVERDUE,
    STANDSTILL,
    catch_up_velocity,
    clamp,
    limit_velocity,
)
from stack.servo.state import (
    ACCELERATION_LIMIT,
    ACTIVE_MODE,
    ELAPSED_S,
    END,
    END_VELOCITY,
    INTEGRAL,
    INTEGRAL_GAIN,
    INTEGRAL_LIMIT,
    LOWER,
    NOMINAL,
    OFFSET_END,
    OFFSET_START,
    OLDER,
    OUTPUTS_VELOCITY,
    PERIOD_S,
    POSITION_GAIN,
    SET_POINT,
    SET_VELOCITY,
    START,
    START_VELOCITY,
    STOP_DECELERATION,
    TORQUE_LIMIT,
    UPPER,
    VELOCITY_FEED_FORWARD,
    VELOCITY_GAIN,
    VELOCITY_LIMIT,
    AxisMode,
    BoolVector,
)

_OFF, _POSITION, _VELOCITY, _TORQUE, _STOP = (int(mode) for mode in AxisMode)
_LOOP_ROOM = 1.05
"""The loop may ask for this share of the velocity limit: what brings an axis that is behind its set point back to it at full speed."""
_NEVER = -1.0
"""ACTIVE_MODE of an axis that has not seen a target since it was switched on."""


@compiled
def accept(
    state: Matrix, axis: int, mode: int, target: float, offset: float, period_s: float, elapsed_s: float
) -> None:
    """Start the segment to `target` on one axis (see Servo.accept); a stopped axis takes the offset only."""
    if mode == _OFF:
        return
    state[OFFSET_START, axis] = offset if state[ACTIVE_MODE, axis] == _NEVER else state[OFFSET_END, axis]
    state[OFFSET_END, axis] = offset
    late = state[ELAPSED_S, axis] > 1.5 * state[PERIOD_S, axis]
    first = state[ACTIVE_MODE, axis] != mode
    if mode == _POSITION:
        if first:  # from where the set point is, at the velocity it has
            previous, velocity = state[SET_POINT, axis], state[SET_VELOCITY, axis]
            older = previous - velocity * period_s
        elif late:  # from where the extrapolation has got to
            previous, velocity = state[NOMINAL, axis], state[SET_VELOCITY, axis]
            older = previous - velocity * period_s
        else:
            previous, velocity = state[END, axis], state[END_VELOCITY, axis]
            older = state[OLDER, axis]
        state[START, axis] = previous
        state[START_VELOCITY, axis] = velocity
        state[OLDER, axis] = previous
        state[END_VELOCITY, axis] = node_velocity(target, previous, older, period_s)
        if first:
            state[NOMINAL, axis] = previous
    elif mode == _VELOCITY:
        state[START, axis] = state[SET_VELOCITY, axis] if first or late else state[END, axis]
    state[END, axis] = target
    state[ELAPSED_S, axis] = elapsed_s
    state[PERIOD_S, axis] = period_s
    state[ACTIVE_MODE, axis] = mode


@compiled
def accept_all(
    state: Matrix,
    mode: NDArray[np.int64],
    received: BoolVector,
    target: Vector,
    offset: Vector,
    period_s: float,
    elapsed_s: float,
) -> None:
    """`accept` on every axis where `received`."""
    for axis in range(state.shape[1]):
        if received[axis]:
            accept(state, axis, mode[axis], target[axis], offset[axis], period_s, elapsed_s)


@compiled
def advance_set_point(state: Matrix, parameters: Matrix, axis: int, mode: int, position: float, dt_s: float) -> int:
    """Move the set point of one axis over one tick (POSITION, VELOCITY, STOP); returns its flag bits."""
    flags = 0
    velocity = state[SET_VELOCITY, axis]
    acceleration = parameters[ACCELERATION_LIMIT, axis]
    lower, upper = parameters[LOWER, axis], parameters[UPPER, axis]
    period = state[PERIOD_S, axis]
    elapsed = state[ELAPSED_S, axis] + dt_s
    state[ELAPSED_S, axis] = elapsed
    waiting = state[ACTIVE_MODE, axis] != mode
    overdue = waiting or elapsed > 2.0 * period + 0.5 * dt_s
    if mode == _STOP or overdue:
        if mode == _STOP:
            state[ACTIVE_MODE, axis] = _STOP  # whatever comes next starts from here
        if mode != _STOP and not waiting:
            flags |= OVERDUE
        deceleration = parameters[STOP_DECELERATION, axis]
        acceleration = max(acceleration, deceleration)
        loss = deceleration * dt_s
        wanted = velocity - loss if velocity > loss else (velocity + loss if velocity < -loss else 0.0)
    elif mode == _POSITION:
        start, end = state[START, axis], state[END, axis]
        nominal, _ = hermite(start, state[START_VELOCITY, axis], end, state[END_VELOCITY, axis], elapsed, period)
        nominal, outside = clamp(nominal, lower, upper)
        if outside:
            flags |= LIMITED_POSITION
        error = state[NOMINAL, axis] - state[SET_POINT, axis]
        if error == 0.0:
            wanted = (nominal - state[SET_POINT, axis]) / dt_s
        else:
            wanted = (nominal - state[NOMINAL, axis]) / dt_s + catch_up_velocity(error, acceleration, dt_s)
        state[NOMINAL, axis] = nominal
    else:
        wanted = linear(state[START, axis], state[END, axis], elapsed, period)
    if mode == _VELOCITY:
        state[SET_POINT, axis] = position  # the velocity loop lets the position go: its limits are about the real one
    limited, bits = limit_velocity(
        wanted, state[SET_POINT, axis], velocity, lower, upper, parameters[VELOCITY_LIMIT, axis], acceleration, dt_s
    )
    flags |= bits
    state[SET_VELOCITY, axis] = limited
    reached = state[SET_POINT, axis] + limited * dt_s
    if mode == _POSITION and not overdue and abs(reached - state[NOMINAL, axis]) < 1e-12:
        reached = state[NOMINAL, axis]  # no drift from rounding: unlimited, the set point is the interpolation
    state[SET_POINT, axis] = reached
    if mode != _POSITION or overdue:
        state[NOMINAL, axis] = reached
    if limited == 0.0:
        flags |= STANDSTILL
    return flags


@compiled
def torque_loop(
    state: Matrix,
    parameters: Matrix,
    axis: int,
    mode: int,
    position_error: float,
    velocity_before: float,
    velocity: float,
    dt_s: float,
) -> tuple[float, int]:
    """Torque of one axis (its velocity, with `outputs_velocity`) for the tick that its set point has advanced over.

    `position_error` and `velocity_before` are the set point's at the start of the tick. Returns the flag bits too.
    """
    flags = 0
    ceiling = parameters[VELOCITY_LIMIT, axis]
    correction = parameters[POSITION_GAIN, axis] * position_error if mode != _VELOCITY else 0.0
    if parameters[OUTPUTS_VELOCITY, axis] != 0.0:
        command = state[SET_VELOCITY, axis] + (correction if mode == _POSITION else 0.0)
        command, limited = clamp(command, -ceiling, ceiling)
        return command, LIMITED_VELOCITY if limited else 0
    # SET_VELOCITY is the mean over a tick, hence the velocity at a tick's start is the mean of two of them.
    share = parameters[VELOCITY_FEED_FORWARD, axis] if mode != _VELOCITY else 1.0
    command = share * 0.5 * (velocity_before + state[SET_VELOCITY, axis]) + correction
    command, limited = clamp(command, -_LOOP_ROOM * ceiling, _LOOP_ROOM * ceiling)
    if limited:
        flags |= LIMITED_VELOCITY
    error = command - velocity
    middle = state[ELAPSED_S, axis] - 0.5 * dt_s
    offset = linear(state[OFFSET_START, axis], state[OFFSET_END, axis], middle, state[PERIOD_S, axis])
    limit = parameters[TORQUE_LIMIT, axis]
    before = state[INTEGRAL, axis]
    bound = parameters[INTEGRAL_LIMIT, axis]
    integral, _ = clamp(before + parameters[INTEGRAL_GAIN, axis] * error * dt_s, -bound, bound)
    if abs(velocity) > _LOOP_ROOM * ceiling and integral * velocity > 0.0:
        integral = 0.0  # what a joint that was held has wound up must not drive it on beyond its limit
    wanted = parameters[VELOCITY_GAIN, axis] * error + offset
    torque, limited = clamp(wanted + integral, -limit, limit)
    if limited:
        flags |= LIMITED_TORQUE
        if (integral - before) * torque > 0.0:
            integral = before
    state[INTEGRAL, axis] = integral
    return torque, flags


@compiled
def follow(state: Matrix, axis: int, mode: int, position: float, velocity: float, dt_s: float) -> None:
    """Keep the set point of an axis that is not position-controlled on its encoder."""
    state[SET_POINT, axis] = position
    state[SET_VELOCITY, axis] = velocity
    state[NOMINAL, axis] = position
    state[INTEGRAL, axis] = 0.0
    state[ELAPSED_S, axis] += dt_s
    if mode == _OFF:
        state[ACTIVE_MODE, axis] = _NEVER
        state[OFFSET_START, axis] = 0.0
        state[OFFSET_END, axis] = 0.0


@compiled
def free_torque(state: Matrix, parameters: Matrix, axis: int, velocity: float) -> tuple[float, int]:
    """Torque of an axis in TORQUE mode: target and offset, held inside the torque and the velocity limit."""
    flags = 0
    torque = 0.0
    if state[ACTIVE_MODE, axis] == _TORQUE and state[ELAPSED_S, axis] <= 2.5 * state[PERIOD_S, axis]:
        torque = state[END, axis] + state[OFFSET_END, axis]
    elif state[ACTIVE_MODE, axis] == _TORQUE:
        flags |= OVERDUE
    ceiling = parameters[VELOCITY_LIMIT, axis]
    excess = velocity - ceiling if velocity > ceiling else (velocity + ceiling if velocity < -ceiling else 0.0)
    if excess != 0.0:
        torque -= parameters[VELOCITY_GAIN, axis] * excess
        flags |= LIMITED_VELOCITY
    torque, limited = clamp(torque, -parameters[TORQUE_LIMIT, axis], parameters[TORQUE_LIMIT, axis])
    if limited:
        flags |= LIMITED_TORQUE
    return torque, flags


@compiled
def tick_all(
    state: Matrix,
    parameters: Matrix,
    mode: NDArray[np.int64],
    position: Vector,
    velocity: Vector,
    dt_s: float,
    output: Vector,
    flags: NDArray[np.int64],
) -> None:
    """One servo tick of every axis (see Servo.tick)."""
    for axis in range(state.shape[1]):
        if mode[axis] == _OFF:
            follow(state, axis, _OFF, position[axis], velocity[axis], dt_s)
            output[axis], flags[axis] = 0.0, 0
        elif mode[axis] == _TORQUE:
            follow(state, axis, _TORQUE, position[axis], velocity[axis], dt_s)
            output[axis], flags[axis] = free_torque(state, parameters, axis, velocity[axis])
        else:
            error = state[SET_POINT, axis] - position[axis]
            before = state[SET_VELOCITY, axis]
            bits = advance_set_point(state, parameters, axis, mode[axis], position[axis], dt_s)
            torque, more = torque_loop(state, parameters, axis, mode[axis], error, before, velocity[axis], dt_s)
            output[axis], flags[axis] = torque, bits | more
