"""Servo law of the drives: interpolation of cyclic set points, limits, position-velocity-torque cascade."""

from stack.servo.gains import load_servo_parameters
from stack.servo.limiter import (
    LIMITED_ACCELERATION,
    LIMITED_POSITION,
    LIMITED_TORQUE,
    LIMITED_VELOCITY,
    OVERDUE,
    STANDSTILL,
)
from stack.servo.servo import Servo
from stack.servo.state import AxisMode, ServoParameters, ServoState

__all__ = [
    "LIMITED_ACCELERATION",
    "LIMITED_POSITION",
    "LIMITED_TORQUE",
    "LIMITED_VELOCITY",
    "OVERDUE",
    "STANDSTILL",
    "AxisMode",
    "Servo",
    "ServoParameters",
    "ServoState",
    "load_servo_parameters",
]
