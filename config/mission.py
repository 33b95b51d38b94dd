"""A scenario's steps and preferences as the strategic layer's Mission: the only place that knows both."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from config.errors import ConfigError
from config.scenario import PreferenceTable, Scenario, StepTable
from stack.messages import Mode
from stack.planner.parameters import Coordination, Method
from stack.strategic.mission import Mission, ParameterWrite, Step, StepKind
from stack.strategic.profile import RampProfile

_ARRAYS = (("preferred", 0x2010), ("heights", 0x2011), ("widths", 0x2012), ("weights", 0x2013))
_PLATFORM = (
    ("platform_angle_rad", 1),
    ("platform_gain", 2),
    ("platform_max_rate", 3),
    ("platform_feed_forward", 4),
)


def build_mission(scenario: Scenario, joints: int) -> Mission:
    """The mission of `scenario` for an arm of `joints` joints.

    Raises ConfigError for preference arrays of the wrong length.
    """
    planner = scenario.planner
    choices = (
        ParameterWrite(0x2001, 0, Method.named(planner.method)),
        ParameterWrite(0x2002, 0, Coordination.named(planner.coordination)),
        ParameterWrite(0x2005, 0, int(planner.null_space_motion)),
        ParameterWrite(0x2006, 0, int(planner.joint_limit_rules)),
    )
    where = "cases" if str(planner.case) in scenario.cases else "preferences"
    preferences = tuple(_writes(scenario.case_preferences(), joints, f"{scenario.name}: {where}"))
    steps = tuple(_step(step, joints, f"{scenario.name}: step {i}") for i, step in enumerate(scenario.step))
    if not steps:
        raise ConfigError(f"{scenario.name}: step is empty; a scenario needs at least one [[step]]")
    return Mission(steps, choices + preferences)


def _step(table: StepTable, joints: int, where: str) -> Step:
    profile = direction = None
    if table.kind == "line":
        assert table.direction is not None and table.length_m is not None and table.speed_m_s is not None
        profile = RampProfile(table.length_m, table.speed_m_s, table.ramp_s)
        direction = np.array(table.direction) / np.linalg.norm(table.direction)
        direction.setflags(write=False)
    elif table.kind == "drive":
        assert table.length_m is not None and table.speed_m_s is not None
        profile = RampProfile(table.length_m, table.speed_m_s, table.ramp_s)
    elif table.kind == "turn":
        assert table.angle_rad is not None and table.rate_rad_s is not None
        profile = RampProfile(table.angle_rad, table.rate_rad_s, table.ramp_s)
    return Step(
        name=table.name,
        kind=StepKind(table.kind),
        mode=Mode[table.mode.upper()],
        profile=profile,
        direction=direction,
        wait_s=table.duration_s or 0.0,
        writes=() if table.preferences is None else tuple(_writes(table.preferences, joints, where)),
    )


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
            yield ParameterWrite(0x2014, subindex, value)
