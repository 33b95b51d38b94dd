"""The compiled pose arithmetic of the arm cycle against the plain one of stack.kinematics.se3."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics.se3 import pose_exp, pose_log
from stack.planner.tracking import arm_in_odometry, body_twist, desired_in_arm, moved

numbers = st.floats(-2.0, 2.0)
twists = st.tuples(*[numbers] * 6).map(np.array)
poses = twists.map(pose_exp)


@given(poses, twists, st.floats(1e-3, 0.5))
def test_moved_is_the_exponential(T: np.ndarray, twist: np.ndarray, dt: float) -> None:
    np.testing.assert_allclose(moved(T, twist, dt), T @ pose_exp(twist * dt), atol=1e-12)


@given(poses, poses)
def test_body_twist_takes_one_pose_to_the_other(T_from: np.ndarray, T_to: np.ndarray) -> None:
    twist = body_twist(T_from, T_to)
    np.testing.assert_allclose(T_from @ pose_exp(twist), T_to, atol=1e-9)
    assert np.linalg.norm(twist[3:]) <= np.pi + 1e-9


def test_body_twist_at_half_a_turn() -> None:
    for axis in np.eye(3):
        turned = pose_exp(np.concatenate((np.zeros(3), np.pi * axis)))
        twist = body_twist(np.eye(4), turned)
        np.testing.assert_allclose(np.abs(twist[3:]), np.pi * axis, atol=1e-7)


@given(twists.filter(lambda t: np.linalg.norm(t[3:]) < 3.0))
def test_body_twist_agrees_with_the_plain_logarithm(twist: np.ndarray) -> None:
    pose = pose_exp(twist)
    np.testing.assert_allclose(body_twist(np.eye(4), pose), pose_log(pose), atol=1e-9)


@given(poses, numbers, numbers, st.floats(-4.0, 4.0), st.tuples(numbers, numbers, numbers).map(np.array), poses)
def test_seen_from_the_arm_and_back(T_RO, x, y, heading, base, X_RE) -> None:
    T_AE = desired_in_arm(T_RO, x, y, heading, base, X_RE)
    np.testing.assert_allclose(T_RO @ arm_in_odometry(x, y, heading, base, T_AE), X_RE, atol=1e-12)


def test_many_small_steps_stay_a_rotation() -> None:
    T, twist = np.eye(4), np.array([0.1, 0.0, 0.0, 0.3, -0.2, 0.1])
    for _ in range(20_000):
        T = moved(T, twist, 0.01)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-14)
