"""The unicycle: its columns, exact arcs, wheels, and paths that bind it."""

import numpy as np
import pytest

from stack.kinematics import ArmModel, extended_jacobian
from stack.kinematics.platform import (
    extended_in_platform,
    extended_wrist_jacobian,
    integrate_unicycle,
    path_column,
    platform_columns,
    platform_of,
    platform_twist,
    wheel_speeds,
)
from stack.kinematics.se3 import pose_inverse, pose_log, pose_matrix, rotation_exp


def world_pose(arm: ArmModel, posture: np.ndarray, q: np.ndarray) -> np.ndarray:
    base = pose_matrix(rotation_exp((0, 0, posture[2])), (*posture[:2], 0.0))
    mount = pose_matrix(np.eye(3), platform_of(arm).arm_base)
    return base @ mount @ arm.pose(q)


def test_extended_jacobian_predicts_the_body_twist_of_the_driving_robot(moma8: ArmModel) -> None:
    """Drive and move all joints for a microsecond, anywhere in the world: the TCP's twist in its own frame follows."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, posture = rng.uniform(moma8.q_min, moma8.q_max), rng.uniform(-3, 3, 3)
        dq, v, omega, dt = rng.normal(size=8), *rng.normal(size=2), 1e-6
        start = world_pose(moma8, integrate_unicycle(posture, v, omega, -dt), q - dq * dt)
        end = world_pose(moma8, integrate_unicycle(posture, v, omega, dt), q + dq * dt)
        twist = pose_log(pose_inverse(start) @ end) / (2 * dt)
        np.testing.assert_allclose(extended_jacobian(moma8, q) @ [*dq, v, omega], twist, rtol=0, atol=1e-7)


def test_wrist_columns_of_the_platform(moma8: ArmModel) -> None:
    q = moma8.home
    x, y, _ = moma8.points(q)["D"] + [0.15, 0.0, 0.35]
    np.testing.assert_allclose(extended_wrist_jacobian(moma8, q)[:, 5:], [[1, -y], [0, x], [0, 0]], atol=1e-12)


def test_standing_on_the_floor_is_said() -> None:
    with pytest.raises(ValueError, match="robot iiwa14 has no platform"):
        extended_jacobian(ArmModel.load("iiwa14"), np.zeros(7))


def test_yaw_turns_the_arm_base_about_the_wheel_axis(moma8: ArmModel) -> None:
    """Were the tower on the wheel axis, yaw would double the tower joint; 0.15 m ahead it adds a sideways motion."""
    columns = extended_in_platform(moma8, moma8.state(moma8.home))
    np.testing.assert_allclose(columns[:, 9] - columns[:, 0], [0, 0.15, 0, 0, 0, 0], atol=1e-12)


def test_arc_of_a_quarter_turn() -> None:
    posture = integrate_unicycle((0, 0, 0), np.pi / 2, np.pi / 2, 1.0)
    np.testing.assert_allclose(posture, (1, 1, np.pi / 2), atol=1e-12)


def test_straight_line_is_the_limit_of_the_arc() -> None:
    straight = integrate_unicycle((1, 2, 0.5), 0.6, 0.0, 2.0)
    np.testing.assert_allclose(straight, (1 + 1.2 * np.cos(0.5), 2 + 1.2 * np.sin(0.5), 0.5), atol=1e-12)
    np.testing.assert_allclose(integrate_unicycle((1, 2, 0.5), 0.6, 1e-12, 2.0), straight, atol=1e-11)


def test_left_turn_needs_the_faster_right_wheel(moma8: ArmModel) -> None:
    platform = platform_of(moma8)
    left, right = wheel_speeds(platform, 0.2, 0.5)
    assert (left, right) == pytest.approx((0.875, 3.125))
    assert platform_twist(platform, left, right) == pytest.approx((0.2, 0.5))


def test_path_column_moves_the_point_as_the_path_does() -> None:
    """Bound to a circle to the left (κ = 1/0.6), any point of the platform turns about the circle's centre."""
    point, kappa = np.array([0.4, -0.2, 0.9]), 1 / 0.6
    column = path_column(platform_columns(point), 1.0, kappa)
    radius = point - [0.0, 0.6, 0.9]
    np.testing.assert_allclose(column[:3], np.cross([0, 0, kappa], radius), atol=1e-12)
    np.testing.assert_allclose(column[3:], [0, 0, kappa], atol=1e-12)
    np.testing.assert_allclose(path_column(platform_columns(point), 2.0, kappa), 2 * column, atol=1e-12)


def test_bound_to_a_straight_path_only_driving_is_left() -> None:
    columns = platform_columns((0.4, -0.2, 0.9))
    np.testing.assert_array_equal(path_column(columns, 1.0, 0.0), columns[:, 0])
