"""What a run is judged by: its own metrics, what has to fit before it starts, and a bus that cannot carry what is asked of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from canipulator.outcome import expectations, flat, revision
from canipulator.surroundings import around
from config.errors import ConfigError
from config.robot import Robot
from config.scenario import Scenario
from logs.metrics import RunFacts, evaluate
from logs.recorder import RunInfo
from logs.signals import SignalTable

OWN_METRICS = (
    "mission_finished",
    "path_progress",
    "incomplete_cycles",
    "platform_return_error_m",
    "faults_injected",
    "frames_dropped_by_faults",
    "set_points_refused",
    "collisions",
    "object_goal_error_max_m",
    "door_radius_found_m",
    "door_axis_tilt_found_rad",
)
"""Metrics of lockstep runs beside those of `logs.metrics`: share of the commanded way that was let through, cycles without
feedback from every drive, distance of the platform at the end from where it began, 1 for a mission that came to its end; ticks of the
physics (1 ms) with an unwanted contact of the robot: two of its own parts, or one of them and the floor, a table, a door."""


def run_info(scenario: Scenario) -> RunInfo:
    """What a recording says about itself."""
    return RunInfo(
        scenario.name,
        scenario.seed,
        scenario.planner.method,
        scenario.planner.coordination,
        revision(),
        flat(scenario.model_dump(mode="json", exclude_none=True)),
        around(scenario),
    )


def check_scenario(scenario: Scenario, robot: Robot) -> None:
    """What only scenario and robot together can say."""
    start, arm = scenario.start.configuration, robot.arm
    if start is None:
        return
    if len(start) != arm.n:
        raise ConfigError(f"{scenario.name}: start.configuration has {len(start)} values, must have {arm.n}")
    for i, q in enumerate(start):
        if not arm.q_min[i] <= q <= arm.q_max[i]:
            span = f"{arm.q_min[i]:.4g} to {arm.q_max[i]:.4g}"
            raise ConfigError(
                f"{scenario.name}: start.configuration.{i} = {q:g} ({arm.joint_names[i]}): must be within {span}"
            )


def check_expectations(scenario: Scenario, robot: Robot) -> None:
    """Whether every metric that is expected exists: better now than at the end of the run."""
    facts = RunFacts(scenario.name, scenario.seed, "", "", 0.0, 0.0, extra=dict.fromkeys(OWN_METRICS, 0.0))
    nothing = evaluate(SignalTable(), robot.arm, facts)
    joints = dict.fromkeys(robot.arm.joint_names, 0.0)
    try:
        replace(nothing, joint_travel=joints, joint_acceleration_step_max=joints).judged(expectations(scenario.expect))
    except ValueError as error:
        raise ConfigError(f"{scenario.name}: {error}") from None


def overload(table: SignalTable, frames_lost: int) -> tuple[str, ...]:
    """A bus that cannot carry what is asked of it is a fault of its own, before all that follows from it."""
    load = table.get("bus/load")
    full = 0 if load is None else _longest(load.values[:, 0] >= FULL)
    if full < OVERLOAD_WINDOWS and not frames_lost:
        return ()
    return (f"bus: overloaded, full for {0.1 * full:.1f} s on end, {frames_lost} frames lost",)


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    best = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        best = max(best, run)
    return best


FULL = 0.97
OVERLOAD_WINDOWS = 3
"""So many windows of 100 ms on end: heartbeats, which have the lowest priority, are lost by then."""
