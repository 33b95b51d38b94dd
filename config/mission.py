"""A scenario's steps and preferences as the strategic layer's Mission: the only place that knows both."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from config.door import LEAF_OBJECTS, grip_writes, leaf_writes
from config.errors import ConfigError
from config.guidance import GuidanceTable, guide, pull_door
from config.platform_path import path_writes
from config.reaching import point_to_point, reach
from config.scenario import PreferenceTable, Scenario, StepTable
from config.surroundings import FurnitureTable, WallTable
from drivers.tables import planner as table
from drivers.tables import slip as slip_table
from stack.kinematics.arm import ArmModel
from stack.kinematics.posture import best_posture
from stack.messages import Gripper, Matrix, Mode, Vector
from stack.planner.parameters import Coordination, Method
from stack.strategic.door import LeafObjects
from stack.strategic.mission import Mission, Step
from stack.strategic.motion import Motion, ParameterWrite
from stack.strategic.point_to_point import Choose
from stack.strategic.profile import RampProfile
from stack.strategic.profiled import Drive, Grip, Line, Turn, Wait

_ARRAYS = (
    ("preferred", table.PREFERRED_CONFIGURATION),
    ("heights", table.HEIGHTS),
    ("widths", table.WIDTHS),
    ("weights", table.WEIGHTS),
)
_PLATFORM = (
    ("platform_angle_rad", table.PLATFORM_ANGLE),
    ("platform_gain", table.PLATFORM_GAIN),
    ("platform_max_rate", table.PLATFORM_MAX_RATE),
    ("platform_feed_forward", table.PLATFORM_FEED_FORWARD),
    ("platform_speed_m_s", table.PLATFORM_SPEED),
)


def build_mission(scenario: Scenario, arm: ArmModel, choose: Choose | None = None) -> Mission:
    """The mission of `scenario` for an arm; `choose`: which configuration it takes for a pose (default: a plain search).

    Raises ConfigError for arrays of the wrong length and for goals outside the arm's limits.
    """
    joints = arm.n
    planner = scenario.planner
    choices = (
        ParameterWrite(table.METHOD, 0, Method.named(planner.method)),
        ParameterWrite(table.COORDINATION, 0, Coordination.named(planner.coordination)),
        ParameterWrite(table.NULL_SPACE_MOTION, 0, int(planner.null_space_motion)),
        ParameterWrite(table.JOINT_LIMIT_RULES, 0, int(planner.joint_limit_rules)),
        ParameterWrite(table.REPULSION, 0, int(planner.repulsion)),
        ParameterWrite(table.CIRCUMVENTION, 0, int(planner.circumvention)),
        ParameterWrite(table.COLLISION_AVOIDANCE, 0, int(planner.collision_avoidance)),
        *_slip_writes(scenario),
    )
    where = "cases" if str(planner.case) in scenario.cases else "preferences"
    preferences = tuple(_writes(scenario.case_preferences(), joints, f"{scenario.name}: {where}"))
    steps = tuple(_step(scenario, i, arm, choose) for i in range(len(scenario.step)))
    if not steps:
        raise ConfigError(f"{scenario.name}: step is empty; a scenario needs at least one [[step]]")
    around = (*_obstacles(scenario), *leaf_writes(scenario)) if planner.collision_avoidance else ()
    writes = choices + preferences + around + tuple(path_writes(scenario.platform_path))
    return Mission(steps, writes, None if scenario.recovery is None else scenario.recovery.build())


def _obstacles(scenario: Scenario) -> Iterator[ParameterWrite]:
    """Tables and walls as boxes for the planner to keep clear of. Raises ConfigError for more than it has room for."""
    standing: Sequence[FurnitureTable | WallTable] = (*scenario.table, *scenario.wall)
    if len(standing) > len(table.OBSTACLES):
        raise ConfigError(
            f"{scenario.name}: {len(standing)} tables and walls, the planner keeps clear of at most {len(table.OBSTACLES)}; "
            "leave some out, or set planner.collision_avoidance = false"
        )
    for index, thing in zip(table.OBSTACLES, standing, strict=False):
        x, y = thing.position_m
        length, width, height = thing.size_m
        for i, value in enumerate((x, y, 0.5 * height, length, width, height, thing.heading_rad), start=1):
            yield ParameterWrite(index, i, value)


def _slip_writes(scenario: Scenario) -> Iterator[ParameterWrite]:
    planner, feedback = scenario.planner, scenario.feedback
    yield ParameterWrite(slip_table.SLIP_OBSERVER, 0, int(planner.slip_observer))
    model = (feedback.noise_m, feedback.noise_rad, planner.slip_sigma, planner.slip_tau_s, planner.slip_learning_s)
    for i, value in enumerate(model, start=1):
        yield ParameterWrite(slip_table.SLIP_MODEL, i, value)


def _step(scenario: Scenario, i: int, arm: ArmModel, choose: Choose | None) -> Step:
    step, where = scenario.step[i], f"{scenario.name}: step {i}"
    clear = scenario.planner.collision_avoidance
    wishes = () if step.preferences is None else tuple(_writes(step.preferences, arm.n, where))
    return Step(
        name=step.name,
        mode=Mode[step.mode.upper()],
        motion=_motion(step, arm, choose or plain_choice(arm), where, LEAF_OBJECTS if clear else None),
        writes=(*wishes, *(grip_writes(scenario, step) if clear else ())),
        reads_joints=step.kind == "joints",
    )


def plain_choice(arm: ArmModel) -> Choose:
    """The best posture for a pose by a search without a map."""

    def choose(T: Matrix) -> Vector | None:
        posture = best_posture(arm, T)
        return None if posture is None else posture.q

    return choose


def _motion(step: StepTable, arm: ArmModel, choose: Choose, where: str, leaf: LeafObjects | None) -> Motion:
    """What the step does; its table has been checked for what its kind needs."""
    match step.kind:
        case "wait":
            assert step.duration_s is not None
            return Wait(step.duration_s)
        case "line":
            assert step.direction is not None
            direction = np.array(step.direction) / np.linalg.norm(step.direction)
            direction.setflags(write=False)
            return Line(_profile(step.length_m, step.speed_m_s, step.ramp_s), direction)
        case "drive":
            return Drive(_profile(step.length_m, step.speed_m_s, step.ramp_s))
        case "turn":
            return Turn(_profile(step.angle_rad, step.rate_rad_s, step.ramp_s))
        case "reach":
            assert step.pose is not None and step.speed_m_s is not None
            return reach(step.pose, step.speed_m_s, step.rate_rad_s, step.ramp_s)
        case "joints":
            return point_to_point(step.goal, step.objective, arm, choose, where)
        case "grip":
            assert step.gripper is not None
            return Grip(Gripper[step.gripper.upper()])
        case "guide":
            assert step.duration_s is not None
            return guide(step.guidance or GuidanceTable(), step.duration_s)
        case "door":
            assert step.pull is not None
            return pull_door(step.pull, leaf)


def _profile(length: float | None, speed: float | None, ramp_s: float) -> RampProfile:
    assert length is not None and speed is not None
    return RampProfile(length, speed, ramp_s)


def _writes(preferences: PreferenceTable, joints: int, where: str) -> Iterator[ParameterWrite]:
    for key, index in _ARRAYS:
        values = getattr(preferences, key)
        if values is None:
            continue
        expected = joints + 2 if key == "weights" else joints
        if len(values) != expected:
            raise ConfigError(f"{where}: {key} has {len(values)} values, must have {expected}")
        for i, value in enumerate(values, start=1):
            yield ParameterWrite(index, i, value)
    for key, subindex in _PLATFORM:
        value = getattr(preferences, key)
        if value is not None:
            yield ParameterWrite(table.PLATFORM, subindex, value)
