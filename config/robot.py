"""What a robot's files mean to the layers: the drives on the bus, the planner's limits and its first preferences."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.errors import ConfigError
from config.scenario import Scenario
from drivers.catalogue import JOINT_IDS, WHEEL_IDS, DriveParameters, devices
from drivers.objects import DeviceDef
from drivers.tables.drive import DriveLimits
from stack.kinematics.arm import ArmModel
from stack.kinematics.platform import platform_of
from stack.planner.observer import SlipModel
from stack.planner.parameters import Coordination, Limits, Method, PlannerParameters, Preferences
from stack.servo import ServoParameters, load_servo_parameters

PLANNER_MARGIN = 0.9
"""The planner's share of a joint's velocity limit: the rest is for tracking, so that the drive never sees its own limit."""
PREFERENCE_HEIGHT = 0.3
"""Default height of a preference, as a share of the joint's velocity limit."""
PREFERENCE_WIDTH = 0.1
"""Default width of a preference, as a share of the joint's range."""


@dataclass(frozen=True, slots=True)
class Robot:
    """A mobile manipulator as the composition needs it. `devices`: every node of its bus by id."""

    arm: ArmModel
    servo: ServoParameters
    devices: dict[int, DeviceDef]
    limits: Limits


def load_robot(name: str) -> Robot:
    """Raises ConfigError for a robot that does not exist, is broken, or has no platform and drives."""
    try:
        arm = ArmModel.load(name)
        platform_of(arm)
        servo = load_servo_parameters(name)
        return Robot(arm, servo, devices(_drives(arm, servo)), _limits(arm))
    except OSError as error:
        raise ConfigError(f"{error.filename}: {error.strerror}") from None
    except (ValueError, ArithmeticError, TypeError, LookupError, AttributeError) as error:
        raise ConfigError(f"robot {name}: its files cannot be used: {error}") from None


def planner_parameters(robot: Robot, scenario: Scenario) -> PlannerParameters:
    """The planner as the scenario wants it; preferences are the robot's until the strategic node writes its own."""
    table = scenario.planner
    arm = robot.arm
    span = arm.q_max - arm.q_min
    return PlannerParameters(
        arm_period_ns=round(1e9 / table.arm_cycle_hz),
        platform_cycles_per_arm_cycle=table.platform_cycle_hz / table.arm_cycle_hz,
        preferences=Preferences(
            preferred=arm.preferred,
            heights=PREFERENCE_HEIGHT * arm.dq_max,
            widths=PREFERENCE_WIDTH * span,
            weights=np.ones(arm.n + 2),
        ),
        limits=robot.limits,
        method=Method.named(table.method),
        coordination=Coordination.named(table.coordination),
        slip_observer=table.slip_observer,
        slip_model=SlipModel(
            position_noise_m=scenario.feedback.noise_m,
            rotation_noise_rad=scenario.feedback.noise_rad,
            sigma=table.slip_sigma,
            tau_s=table.slip_tau_s,
            learning_s=table.slip_learning_s,
        ),
        null_space_motion=table.null_space_motion,
        joint_limit_rules=table.joint_limit_rules,
        repulsion=table.repulsion,
        circumvention=table.circumvention,
        collision_avoidance=table.collision_avoidance,
    )


def _limits(arm: ArmModel) -> Limits:
    platform = platform_of(arm)
    return Limits(
        q_min=arm.q_min,
        q_max=arm.q_max,
        padding=arm.padding,
        dq_max=PLANNER_MARGIN * arm.dq_max,
        ddq_max=arm.ddq_max,
        v_max=platform.velocity,
        omega_max=platform.yaw_rate,
        dv_max=platform.acceleration,
        domega_max=platform.yaw_acceleration,
    )


def _drives(arm: ArmModel, servo: ServoParameters) -> dict[int, DriveParameters]:
    """The ten drives with the robot's limits: what they enforce, whatever the planner says."""
    platform = platform_of(arm)
    drives = {
        node_id: DriveParameters(
            f"wheel_{side}", round(1e3 * platform.wheel_rated_effort), _drive_limits(servo, axis, 2.0)
        )
        for axis, (node_id, side) in enumerate(zip(WHEEL_IDS, ("left", "right"), strict=True))
    }
    for i, node_id in enumerate(JOINT_IDS):
        linear = not arm.description.joints[i].revolute
        ratio = float(arm.effort_max[i] / arm.effort_rated[i])
        drives[node_id] = DriveParameters(
            arm.joint_names[i],
            round(1e3 * float(arm.effort_rated[i])),
            _drive_limits(servo, len(WHEEL_IDS) + i, ratio),
            linear=linear,
        )
    return drives


def _drive_limits(servo: ServoParameters, axis: int, torque_ratio: float) -> DriveLimits:
    lower, upper = float(servo.lower[axis]), float(servo.upper[axis])
    speed = float(servo.velocity_limit[axis])
    return DriveLimits(
        position_min=lower if math.isfinite(lower) else None,
        position_max=upper if math.isfinite(upper) else None,
        velocity=speed,
        acceleration=float(servo.acceleration_limit[axis]),
        quick_stop_deceleration=float(servo.stop_deceleration[axis]),
        following_error=None if servo.outputs_velocity[axis] else FOLLOWING_ERROR_S * speed,
        torque_ratio=torque_ratio,
    )


FOLLOWING_ERROR_S = 0.07
"""Following-error window as the way at full speed in this time."""
