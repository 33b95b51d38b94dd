"""Laws of rotations, rigid motions and the unicycle, for any of them."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from stack.kinematics.platform import integrate_unicycle
from stack.kinematics.se3 import (
    pose_difference,
    pose_exp,
    pose_inverse,
    pose_log,
    pose_matrix,
    quaternion_from_rotation,
    rotation_exp,
    rotation_from_quaternion,
    rotation_log,
)

lengths = st.floats(-10, 10).map(lambda x: float(np.round(x, 12)))
vectors = st.tuples(lengths, lengths, lengths).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))
# From nothing at all over the last digits below a half turn to the half turn itself.
angles = st.one_of(
    st.floats(0, np.pi),
    st.floats(-14, -1).map(lambda e: 10.0**e),
    st.floats(-14, -1).map(lambda e: np.pi - 10.0**e),
    st.sampled_from([0.0, np.pi]),
)


@given(directions, angles)
@example(np.array([0.0, 0.0, 1.0]), np.pi)
@example(np.array([1.0, 0.0, 0.0]), np.pi - 1e-9)
def test_logarithm_undoes_the_exponential(axis: np.ndarray, angle: float) -> None:
    vector = axis * angle
    rotation = rotation_exp(vector)
    back = rotation_log(rotation)
    assert np.linalg.norm(back) <= np.pi + 1e-12
    np.testing.assert_allclose(rotation_exp(back), rotation, rtol=0, atol=1e-14)
    if angle < np.pi - 1e-12:
        np.testing.assert_allclose(back, vector, rtol=0, atol=2e-14)


@given(directions, angles)
def test_quaternion_is_half_the_angle_about_the_axis(axis: np.ndarray, angle: float) -> None:
    rotation = rotation_exp(axis * angle)
    quaternion = quaternion_from_rotation(rotation)
    assert quaternion[3] >= 0
    np.testing.assert_allclose(np.linalg.norm(quaternion), 1.0, rtol=0, atol=1e-14)
    np.testing.assert_allclose(quaternion[3], np.cos(angle / 2), rtol=0, atol=1e-12)
    np.testing.assert_allclose(rotation_from_quaternion(-3.0 * quaternion), rotation, rtol=0, atol=1e-13)


@given(vectors, directions, angles)
def test_rigid_motions_come_back_from_their_logarithm(velocity: np.ndarray, axis: np.ndarray, angle: float) -> None:
    pose = pose_exp(np.concatenate((velocity, axis * angle)))
    np.testing.assert_allclose(pose_exp(pose_log(pose)), pose, rtol=0, atol=1e-11)


@given(vectors, directions, angles)
def test_a_motion_and_its_inverse_cancel(position: np.ndarray, axis: np.ndarray, angle: float) -> None:
    pose = pose_matrix(rotation_exp(axis * angle), position)
    np.testing.assert_allclose(pose_inverse(pose) @ pose, np.eye(4), rtol=0, atol=1e-13)


poses = st.builds(lambda p, axis, angle: pose_matrix(rotation_exp(axis * angle), p), vectors, directions, angles)


@given(poses, poses)
def test_difference_leads_from_the_actual_to_the_target_pose(target: np.ndarray, actual: np.ndarray) -> None:
    way = pose_difference(target, actual)
    np.testing.assert_allclose(actual[:3, 3] + way[:3], target[:3, 3], rtol=0, atol=1e-13)
    np.testing.assert_allclose(rotation_exp(way[3:]) @ actual[:3, :3], target[:3, :3], rtol=0, atol=1e-13)


@given(vectors, st.floats(-1, 1), st.floats(-2, 2), st.floats(0, 3), st.floats(0, 3))
def test_two_arcs_in_a_row_are_one(posture: np.ndarray, v: float, omega: float, first: float, second: float) -> None:
    halfway = integrate_unicycle(posture, v, omega, first)
    np.testing.assert_allclose(
        integrate_unicycle(halfway, v, omega, second),
        integrate_unicycle(posture, v, omega, first + second),
        rtol=0,
        atol=1e-12,
    )


@given(st.floats(-1, 1), st.floats(-2, 2), st.floats(0, 1))
def test_arc_is_the_exponential_on_se3(v: float, omega: float, dt: float) -> None:
    x, y, theta = integrate_unicycle((0, 0, 0), v, omega, dt)
    pose = pose_exp(np.array([v, 0, 0, 0, 0, omega]) * dt)
    np.testing.assert_allclose(pose, pose_matrix(rotation_exp((0, 0, theta)), (x, y, 0)), rtol=0, atol=1e-12)
