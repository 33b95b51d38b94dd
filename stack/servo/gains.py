"""Servo settings of a robot: servo.toml beside its robot.toml, with the limits of the robot itself."""

from __future__ import annotations

import math
import tomllib

import numpy as np

from stack.kinematics.arm import ArmModel
from stack.kinematics.robot_file import PlatformParameters, robot_directory
from stack.messages import Vector
from stack.servo.state import ServoParameters

_NUMBERS = (
    "position_gain",
    "velocity_gain",
    "integral_gain",
    "integral_limit",
    "velocity_feed_forward",
    "velocity_headroom",
    "acceleration_headroom",
    "stop_deceleration",
)


def load_servo_parameters(robot: str) -> ServoParameters:
    """Parameters of all axes of `robot`: the wheels, if it has a platform, then the joints.

    Position limits and torque limits are the robot's, velocity and acceleration limits the robot's times the headroom
    of servo.toml. ValueError names file and field of what is missing, unknown or of the wrong length.
    """
    path = robot_directory(robot) / "servo.toml"
    if not path.is_file():
        raise ValueError(f"robot {robot} has no servo settings: {path} is missing")
    settings = tomllib.loads(path.read_text(encoding="utf-8"))
    arm = ArmModel.load(robot)
    platform = arm.description.platform
    names = [*(("wheel_left", "wheel_right") if platform else ()), *arm.joint_names]
    unknown = set(settings) - {*_NUMBERS, "axes", "outputs_velocity"}
    if unknown:
        raise ValueError(f"{path}: unknown {', '.join(sorted(unknown))}")
    if settings.get("axes") != names:
        raise ValueError(f"{path}: axes = {settings.get('axes')} must be {names}")
    for name in (*_NUMBERS, "outputs_velocity"):
        entries, kind = settings.get(name), bool if name == "outputs_velocity" else (int, float)
        count = len(entries) if isinstance(entries, list) else "none, it is no list"
        if count != len(names):
            raise ValueError(f"{path}: {name} must have {len(names)} entries, has {count}")
        if not all(isinstance(entry, kind) for entry in entries or ()):
            wanted = "true or false" if kind is bool else "a number"
            raise ValueError(f"{path}: {name}: every entry must be {wanted}")
    column = {name: np.array(settings[name], dtype=np.float64) for name in _NUMBERS}
    velocity, acceleration = wheel_limits(platform) if platform else (np.empty(0), np.empty(0))
    wheels = len(velocity)
    return ServoParameters(
        position_gain=column["position_gain"],
        velocity_gain=column["velocity_gain"],
        integral_gain=column["integral_gain"],
        integral_limit=column["integral_limit"],
        velocity_feed_forward=column["velocity_feed_forward"],
        lower=np.concatenate([np.full(wheels, -math.inf), arm.q_min]),
        upper=np.concatenate([np.full(wheels, math.inf), arm.q_max]),
        velocity_limit=np.concatenate([velocity, arm.dq_max]) * column["velocity_headroom"],
        acceleration_limit=np.concatenate([acceleration, arm.ddq_max]) * column["acceleration_headroom"],
        stop_deceleration=column["stop_deceleration"],
        torque_limit=np.concatenate([np.full(wheels, math.inf), arm.effort_max]),
        outputs_velocity=np.array(settings["outputs_velocity"], dtype=np.bool_),
    )


def wheel_limits(platform: PlatformParameters) -> tuple[Vector, Vector]:
    """Wheel velocity (rad/s) and acceleration (rad/s²) that the platform's limits together ask for, each (2,)."""
    half = platform.track / 2
    velocity = (platform.velocity + platform.yaw_rate * half) / platform.wheel_radius
    acceleration = (platform.acceleration + platform.yaw_acceleration * half) / platform.wheel_radius
    return np.full(2, velocity), np.full(2, acceleration)
