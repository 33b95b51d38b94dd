"""Before the wire is real: the planner's compiled code is loaded and run through once, so that no cycle has to wait for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from config.robot import Robot, planner_parameters
from config.scenario import Scenario
from stack.messages import Mode, TrackedPose
from stack.planner.drift import DriftEstimate
from stack.planner.monitor import monitor_arm
from stack.planner.planner import Planner, PlannerInputs, PlannerState
from stack.planner.tracking import rotation_vector

CYCLES = 12


def warm_up(robot: Robot, scenario: Scenario) -> None:
    """Some cycles of every mode with a planner that is thrown away; takes about a tenth of a second."""
    planner, parameters = Planner(robot.arm, robot.limits), planner_parameters(robot, scenario)
    if scenario.platform_path is not None:
        parameters = replace(parameters, platform_path=scenario.platform_path.build())
    period_ns = parameters.arm_period_ns
    home = np.array(robot.arm.home)
    for mode in (Mode.OFF, Mode.HOLD, Mode.ARM_ONLY, Mode.PLATFORM_ONLY, Mode.COORDINATED):
        state = PlannerState(DriftEstimate())
        seen = TrackedPose(np.zeros(3), np.zeros(3), period_ns, 0)
        for cycle in range(CYCLES):
            q = home if state.q_next is None else state.q_next
            twist = np.array([0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3])
            inputs = PlannerInputs(cycle * period_ns, mode, q, (0.0, 0.0), twist, seen if cycle % 2 else None)
            state, outputs = planner.step(state, inputs, parameters)
            monitor_arm(robot.arm, outputs.q)
            rotation_vector(outputs.T_RE)
