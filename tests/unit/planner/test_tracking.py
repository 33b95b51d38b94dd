"""The compiled pose arithmetic of the arm cycle against the plain one of stack.kinematics.se3."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics.se3 import pose_exp, pose_log, rotation_log
from stack.planner.tracking import arm_in_odometry, body_twist, desired_in_arm, follow_path, moved, rotation_vector

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


@given(poses)
def test_rotation_vector_agrees_with_the_plain_logarithm(T: np.ndarray) -> None:
    np.testing.assert_allclose(rotation_vector(T), rotation_log(T[:3, :3]), atol=1e-9)


@given(poses, poses, poses, st.tuples(*[numbers] * 6), twists, st.floats(1e-3, 0.1))
def test_following_the_path_is_the_motion_between_what_is_desired_now_and_then(
    T_RO, T_AE, X_RE, way, twist, dt
) -> None:
    base = np.array([0.15, 0.0, 0.35])
    wanted, deviation, patience = follow_path(T_RO, T_AE, X_RE, *way, base, twist, 20.0, 0.005, 0.01, dt)
    now = desired_in_arm(T_RO, *way[:3], base, X_RE)
    then = desired_in_arm(T_RO, *way[3:], base, moved(X_RE, patience * twist, dt))
    off = body_twist(T_AE, now)
    np.testing.assert_allclose(deviation, 20.0 * off)
    np.testing.assert_allclose(wanted - deviation, body_twist(now, then) / dt, atol=1e-9)
    worst = max(np.linalg.norm(off[:3]) / 0.005, np.linalg.norm(off[3:]) / 0.01)
    comes_back = off[:3] @ twist[:3] / 0.005**2 + off[3:] @ twist[3:] / 0.01**2 < 0.0
    assert patience == pytest.approx(1.0 if comes_back else min(1.0, max(0.0, 2.0 - worst)))


def test_patience_ends_between_one_and_two_tolerances() -> None:
    def patience(off_m: float) -> float:
        off = pose_exp(np.array([off_m, 0.0, 0.0, 0.0, 0.0, 0.0]))
        still = (0.0,) * 6
        return follow_path(np.eye(4), np.eye(4), off, *still, np.zeros(3), np.zeros(6), 20.0, 0.005, 0.01, 0.01)[2]

    assert [patience(off_m) for off_m in (0.0, 0.005, 0.0075, 0.01, 1.0)] == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])


def test_a_path_that_has_stopped_ahead_of_the_arm_comes_back_at_full_speed() -> None:
    ahead = pose_exp(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]))
    still = (0.0,) * 6

    def patience(speed: float) -> float:
        twist = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
        return follow_path(np.eye(4), np.eye(4), ahead, *still, np.zeros(3), twist, 20.0, 0.005, 0.01, 0.01)[2]

    assert patience(0.1) == 0.0
    assert patience(-0.1) == 1.0
