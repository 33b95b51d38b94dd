"""Position solution of a spherical wrist: it inverts the forward kinematics, stays near, and says what it cannot do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.kinematics.spherical_wrist import SphericalWrist

ARM = ArmModel.load("kr15")
WRIST = SphericalWrist(ARM)
ELBOW_BENT = (-1.2, 0.8)

wrist_angles = st.tuples(st.floats(-5.0, 5.0), st.floats(-2.2, 2.2), st.floats(-5.0, 5.0))
arm_angles = st.tuples(st.floats(-2.0, 2.0), st.floats(0.5, 2.0), st.floats(*ELBOW_BENT))


@given(arm_angles, wrist_angles)
def test_the_solution_has_the_pose(arm: tuple[float, ...], wrist: tuple[float, ...]) -> None:
    q = np.array([*arm, *wrist])
    found = WRIST.solve(ARM.pose(q), q + 0.01)
    np.testing.assert_allclose(ARM.pose(found), ARM.pose(q), atol=1e-9)


@given(arm_angles, wrist_angles.filter(lambda w: abs(w[1]) > 0.05))
def test_from_nearby_it_finds_the_same_joints(arm: tuple[float, ...], wrist: tuple[float, ...]) -> None:
    q = np.array([*arm, *wrist])
    np.testing.assert_allclose(WRIST.solve(ARM.pose(q), q + 0.01), q, atol=1e-7)


def test_at_the_pole_axis_4_stays() -> None:
    q = np.array([0.2, 1.5, -0.3, 0.7, 0.0, 0.4])
    np.testing.assert_allclose(
        WRIST.solve(ARM.pose(q), q + [0, 0, 0, 0.1, 0.0, 0.1]), q + [0, 0, 0, 0.1, 0, -0.1], atol=1e-9
    )


def test_out_of_reach_is_said() -> None:
    pose = ARM.pose(ARM.home)
    pose[0, 3] += 3.0
    with pytest.raises(ValueError, match="out of reach of kr15"):
        WRIST.solve(pose, ARM.home)


def test_another_kind_of_arm_is_refused() -> None:
    with pytest.raises(ValueError, match="panda is no six-joint arm"):
        SphericalWrist(ArmModel.load("panda"))
