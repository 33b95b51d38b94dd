"""Before the wire is real: the planner's compiled code is loaded and run through once, so that no cycle has to wait for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from config.robot import Robot, planner_parameters
from config.scenario import Scenario
from stack.messages import JointReference, Mode, TrackedPose
from stack.planner.drift import DriftEstimate
from stack.planner.monitor import monitor_arm
from stack.planner.parameters import PlannerParameters
from stack.planner.planner import Planner, PlannerInputs, PlannerState
from stack.planner.tracking import rotation_vector

CYCLES = 12
WHEEL_RATES = (1.0, 1.2)
"""rad/s: neither straight on nor on the spot."""
SLIPPING = 1.01
"""Of what the wheels have turned: the tracker saw the TCP a little further on, so that there is slip to be estimated."""


def warm_up(robot: Robot, scenario: Scenario) -> None:
    """Some cycles of every mode with a planner that is thrown away; takes some tenths of a second.

    A kernel is compiled for arrays that may be written and for those that may not: preferences once as the table has them, once as
    somebody sends them.
    """
    planner, given = Planner(robot.arm, robot.limits), planner_parameters(robot, scenario)
    if scenario.platform_path is not None:
        given = replace(given, platform_path=scenario.platform_path.build())
    wish = given.preferences
    sent = replace(
        wish, preferred=np.array(wish.preferred), heights=np.array(wish.heights), widths=np.array(wish.widths)
    )
    for parameters in (given, replace(given, preferences=sent)):
        for mode in Mode:
            _some_cycles(robot, planner, mode, parameters)


def _some_cycles(robot: Robot, planner: Planner, mode: Mode, parameters: PlannerParameters) -> None:
    state, period_ns = PlannerState(DriftEstimate()), parameters.arm_period_ns
    home = np.array(robot.arm.home)
    for cycle in range(CYCLES):
        q = home if state.q_next is None else state.q_next
        turned_s = 1e-9 * cycle * period_ns
        left, right = (rate * turned_s for rate in WHEEL_RATES)
        twist = np.array([0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3])
        seen = TrackedPose(np.array([1e-3 * SLIPPING * cycle, 0.0, 0.0]), np.zeros(3), period_ns * 3 // 2, cycle)
        joints = JointReference(q, cycle), cycle * period_ns
        inputs = PlannerInputs(cycle * period_ns, mode, q, (left, right), twist, seen if cycle % 2 else None, joints)
        state, outputs = planner.step(state, inputs, parameters)
        for posture in (outputs.q, robot.arm.home):
            monitor_arm(robot.arm, posture)
        rotation_vector(outputs.T_RE)
