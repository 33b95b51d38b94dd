"""What a bank of servo axes knows and is set to: named rows of two tables, one column per axis.

Tables rather than many small arrays, since every array that crosses into a compiled kernel costs a fifth of a
microsecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stack.messages import Matrix, Vector

BoolVector = NDArray[np.bool_]


class AxisMode(IntEnum):
    """What the loop of one axis does."""

    OFF = 0
    """No torque; the set point follows the encoder, so that switching on is free of jumps."""
    POSITION = 1
    """Cyclic synchronous position: cubic through the targets, position, velocity and torque loop."""
    VELOCITY = 2
    """Cyclic synchronous velocity: straight line between the targets, velocity loop."""
    TORQUE = 3
    """Cyclic synchronous torque: the target itself, held, inside the torque and velocity limits."""
    STOP = 4
    """Brake the set point at `stop_deceleration`, then hold the position reached."""


# Rows of the parameter table, in the order of the fields of ServoParameters.
POSITION_GAIN, VELOCITY_GAIN, INTEGRAL_GAIN, INTEGRAL_LIMIT, VELOCITY_FEED_FORWARD = range(5)
LOWER, UPPER, VELOCITY_LIMIT, ACCELERATION_LIMIT, STOP_DECELERATION, TORQUE_LIMIT = range(5, 11)
OUTPUTS_VELOCITY, PARAMETER_ROWS = 11, 12

# Rows of the state table.
SET_POINT, SET_VELOCITY, NOMINAL = range(3)
START, START_VELOCITY, END, END_VELOCITY, OLDER = range(3, 8)
ELAPSED_S, PERIOD_S, OFFSET_START, OFFSET_END = range(8, 12)
INTEGRAL, ACTIVE_MODE, STATE_ROWS = 12, 13, 14


@dataclass(frozen=True)
class ServoParameters:
    """Settings of the servo axes, each an (n,) array; "rad" reads as m for a lift, "N·m" as N.

    An axis with `outputs_velocity` drives a plant that is itself velocity-controlled: its output is the limited
    velocity in rad/s, its torque fields are not used.
    """

    position_gain: Vector
    """1/s"""
    velocity_gain: Vector
    """N·m·s/rad"""
    integral_gain: Vector
    """N·m/rad, on the velocity error"""
    integral_limit: Vector
    """N·m, the most that the integral may contribute"""
    velocity_feed_forward: Vector
    """share of the set point's velocity that bypasses the position loop, 0..1"""
    lower: Vector
    """rad, may be -inf"""
    upper: Vector
    """rad, may be +inf"""
    velocity_limit: Vector
    """rad/s, of the set point"""
    acceleration_limit: Vector
    """rad/s², of the set point"""
    stop_deceleration: Vector
    """rad/s², of the quick stop and of the stop when targets stay away"""
    torque_limit: Vector
    """N·m"""
    outputs_velocity: BoolVector

    def __post_init__(self) -> None:
        count = np.shape(self.position_gain)
        for name, value in vars(self).items():
            if np.shape(value) != count or len(count) != 1:
                raise ValueError(f"servo {name} has shape {np.shape(value)}; every field must be ({count[0]},)")
            if np.any(np.isnan(value)):
                raise ValueError(f"servo {name} = {value}: must not contain NaN")
        positive = ("velocity_limit", "acceleration_limit", "stop_deceleration", "torque_limit")
        for name in positive:
            if np.any(getattr(self, name) <= 0.0):
                raise ValueError(f"servo {name} = {getattr(self, name)}: must be positive")
        for name in ("position_gain", "velocity_gain", "integral_gain", "integral_limit", "velocity_feed_forward"):
            if np.any(getattr(self, name) < 0.0):
                raise ValueError(f"servo {name} = {getattr(self, name)}: must not be negative")
        if np.any(self.lower >= self.upper):
            raise ValueError(f"servo lower = {self.lower} must be below upper = {self.upper}")

    @property
    def count(self) -> int:
        return len(self.position_gain)

    def table(self) -> Matrix:
        """(PARAMETER_ROWS, n) in the order of the row constants."""
        return np.ascontiguousarray([np.asarray(value, dtype=np.float64) for value in vars(self).values()])


class ServoState:
    """Set points, segments and integrals of n axes: a (STATE_ROWS, n) table and named views into it."""

    def __init__(self, count: int) -> None:
        self.table: Matrix = np.zeros((STATE_ROWS, count))
        self.table[PERIOD_S] = 1.0

    def _row(self, row: int) -> Vector:
        view: Vector = self.table[row]
        return view

    @property
    def set_point(self) -> Vector:
        """Position set point at the end of the last tick, after the limits (n,); view."""
        return self._row(SET_POINT)

    @property
    def set_velocity(self) -> Vector:
        """Velocity set point over the last tick, after the limits (n,); view."""
        return self._row(SET_VELOCITY)

    @property
    def nominal(self) -> Vector:
        """Position set point at the end of the last tick as the master wants it, before the limits (n,); view."""
        return self._row(NOMINAL)

    @property
    def integral(self) -> Vector:
        """Integral part of the torque, N·m (n,); view."""
        return self._row(INTEGRAL)
