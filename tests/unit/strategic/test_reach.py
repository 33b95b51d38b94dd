"""Reaching: the twists lead to the goal and no faster than asked, whatever the planner lets through."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics.se3 import rotation_exp, rotation_log
from stack.messages import PlannerPhase, PlannerState, Restriction
from stack.strategic.motion import CYCLE_S, MotionInputs
from stack.strategic.reach import Reach

COORDINATES = st.floats(-0.8, 0.8)


def follow(motion: Reach, *, scale=lambda t: 1.0, seconds: float = 60.0):
    """A planner that does what it is told, at its path scale; the twists and the last pose."""
    pose, t, twists = np.eye(4), 0.0, []
    state = None
    while t < seconds:
        planner = PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, scale(t), 0)
        inputs = MotionInputs(t, planner, pose[:3, :3].copy(), pose.copy())
        state = motion.begin(inputs) if t == 0.0 else state
        state, outputs = motion.step(state, inputs)
        if outputs.done or outputs.failure:
            return pose, np.array(twists), outputs
        twists.append(outputs.twist)
        pose[:3, 3] += pose[:3, :3] @ outputs.twist[:3] * CYCLE_S * scale(t)
        pose[:3, :3] = pose[:3, :3] @ rotation_exp(outputs.twist[3:] * CYCLE_S * scale(t))
        t += CYCLE_S
    raise AssertionError("never ends")


@given(st.tuples(COORDINATES, COORDINATES, COORDINATES), st.tuples(COORDINATES, COORDINATES, COORDINATES))
def test_it_ends_at_its_goal_and_keeps_speed_and_rate(position, turn) -> None:
    goal = rotation_exp(np.array(turn))
    motion = Reach(np.array(position), speed=0.2, rate=0.5, rotation=goal)
    pose, twists, outputs = follow(motion)
    assert outputs.done
    assert np.linalg.norm(pose[:3, 3] - position) <= motion.tolerance_m
    assert np.linalg.norm(rotation_log(goal @ pose[:3, :3].T)) <= motion.tolerance_rad
    if len(twists):
        assert np.linalg.norm(twists[:, :3], axis=1).max() <= 0.2 * 1.0001
        assert np.linalg.norm(twists[:, 3:], axis=1).max() <= 0.5 * 1.0001


def test_a_path_that_is_slowed_down_is_not_left_behind() -> None:
    motion = Reach(np.array([0.5, 0.0, 0.0]), speed=0.2)
    pose, twists, outputs = follow(motion, scale=lambda t: 0.3 if 1.0 < t < 2.0 else 1.0)
    assert outputs.done
    assert abs(pose[0, 3] - 0.5) <= motion.tolerance_m
    steps = np.diff(twists[:, 0])
    assert np.abs(steps).max() < 0.02  # m/s from cycle to cycle: no jump to catch up


def test_a_goal_that_is_not_reached_is_a_failure_that_says_how_far() -> None:
    """A planner whose reference has come to rest short of the goal, though it says that it follows."""
    motion, planner = (
        Reach(np.array([0.5, 0.0, 0.0]), speed=0.2),
        PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, 1.0, 0),
    )
    stuck = MotionInputs(0.0, planner, np.eye(3), np.eye(4))
    state = motion.begin(stuck)
    for _ in range(1000):
        state, outputs = motion.step(state, stuck)
        if outputs.failure is not None:
            break
    assert outputs.failure == "stops 500.0 mm and 0.0 mrad from its goal"


def test_without_a_reference_pose_it_says_so() -> None:
    planner = PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, 1.0, 0)
    motion = Reach(np.zeros(3), speed=0.1)
    inputs = MotionInputs(0.0, planner, np.eye(3))
    _, outputs = motion.step(motion.begin(inputs), inputs)
    assert outputs.failure is not None
    assert "not known" in outputs.failure
