"""Point to point: references that reach the goal inside the limits, goals that change on the way, and failures in one line."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.messages import PlannerPhase, PlannerState, Restriction
from stack.strategic.motion import CYCLE_S, MotionInputs
from stack.strategic.point_to_point import Goal, PointToPoint
from stack.strategic.straight import StraightPath, straight_path

DQ_MAX, DDQ_MAX = np.array([1.5, 0.25]), np.array([6.0, 1.0])
PLANNER = PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, 1.0, 0)
PLAN = partial(straight_path, dq_max=DQ_MAX, ddq_max=DDQ_MAX)


def forward(q: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, 3] = q
    return pose


def choose(pose: np.ndarray) -> np.ndarray | None:
    return pose[:2, 3] if np.abs(pose[:2, 3]).max() < 1.0 else None


def run(motion: PointToPoint, q0, X_RE=None, seconds: float = 60.0):
    sent, state = [], None
    for k in range(round(seconds / CYCLE_S)):
        inputs = MotionInputs(k * CYCLE_S, PLANNER, np.eye(3), X_RE=X_RE, q=np.array(q0))
        state = motion.begin(inputs) if k == 0 else state
        state, outputs = motion.step(state, inputs)
        if outputs.done or outputs.failure is not None:
            return np.array(sent), outputs
        sent.append(outputs.joints)
    raise AssertionError("never ends")


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
def test_the_references_go_from_here_to_there_within_the_limits(values) -> None:
    start, goal = np.array(values[:2]), np.array(values[2:])
    sent, outputs = run(PointToPoint((Goal(q=goal),), PLAN, choose, forward), start)
    assert outputs.done
    np.testing.assert_allclose(sent[-1], goal, atol=1e-12)
    path = np.vstack((start, sent))
    velocity = np.diff(path, axis=0) / CYCLE_S
    assert (np.abs(velocity) <= DQ_MAX * 1.0001).all()
    assert (np.abs(np.diff(velocity, axis=0)) / CYCLE_S <= DDQ_MAX * 1.001).all()


def test_a_pose_is_reached_from_wherever_the_arm_stands() -> None:
    """The base stands at (2, 1) in the reference frame: found from the first reference pose and the joints."""
    at = np.eye(4)
    at[:2, 3] = 2.1, 1.2
    goal = np.eye(4)
    goal[:2, 3] = 2.5, 0.7
    sent, outputs = run(PointToPoint((Goal(pose=goal),), PLAN, choose, forward), [0.1, 0.2], at)
    assert outputs.done
    np.testing.assert_allclose(sent[-1], [0.5, -0.3], atol=1e-12)


class Carried:
    """A planner for a moving start: a cubic that keeps the initial velocity."""

    def __call__(self, q, dq, goal):
        self.started = (q, dq)
        path = StraightPath(q, goal, 2.0)
        return Cubic(q, dq, goal) if np.abs(dq).max() > 1e-6 else path


class Cubic:
    duration_s = 2.0

    def __init__(self, q, dq, goal) -> None:
        self.q, self.dq, self.goal = q, dq, goal

    def at(self, t_s):
        u = min(t_s / self.duration_s, 1.0)
        h00, h10, h01 = 2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, 3 * u**2 - 2 * u**3
        d00, d10 = 6 * u**2 - 6 * u, 3 * u**2 - 4 * u + 1
        T = self.duration_s
        return h00 * self.q + h10 * T * self.dq + h01 * self.goal, (d00 * (self.q - self.goal)) / T + d10 * self.dq


def test_a_goal_that_changes_on_the_way_is_planned_to_from_the_moving_state_without_a_jump() -> None:
    plan = Carried()
    goals = (Goal(q=np.array([0.8, 0.0])), Goal(q=np.array([0.0, 0.2]), at_s=1.0))
    sent, outputs = run(PointToPoint(goals, plan, choose, forward), [0.0, 0.0])
    assert outputs.done
    assert plan.started[1][0] > 0.3  # it was moving
    np.testing.assert_allclose(sent[-1], [0.0, 0.2], atol=1e-12)
    velocity = np.diff(np.vstack(([0.0, 0.0], sent)), axis=0) / CYCLE_S
    assert (
        np.abs(np.diff(velocity, axis=0)).max() < 0.05
    )  # rad/s from cycle to cycle; the motion's own accelerations give 0.03


@pytest.mark.parametrize(
    ("goal", "X_RE", "reason"),
    [
        (
            Goal(pose=np.diag([1.0, 1.0, 1.0, 1.0]) + np.array([[0, 0, 0, 9.0]] + [[0.0] * 4] * 3)),
            np.eye(4),
            "goal 1 is out of reach",
        ),
        (Goal(pose=np.eye(4)), None, "where the arm stands is not known"),
    ],
)
def test_failures_say_why(goal: Goal, X_RE, reason: str) -> None:
    _, outputs = run(PointToPoint((goal,), PLAN, choose, forward), [0.0, 0.0], X_RE)
    assert outputs.failure is not None
    assert reason in outputs.failure


def test_a_plan_that_fails_ends_the_motion_with_its_reason() -> None:
    motion = PointToPoint((Goal(q=np.zeros(2)),), lambda *_: "no way found in 100 iterations", choose, forward)
    _, outputs = run(motion, [0.0, 0.0])
    assert outputs.failure == "no trajectory to goal 1: no way found in 100 iterations"
