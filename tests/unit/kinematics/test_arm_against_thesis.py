"""The eight-joint arm against numbers that were computed elsewhere from the thesis's DH table."""

import numpy as np
import pytest

from stack.kinematics import ArmModel, extended_jacobian
from stack.kinematics.arm import turned_rows
from stack.kinematics.manipulability import manipulability, singular_values
from stack.kinematics.platform import extended_in_platform, extended_wrist_jacobian
from tests.unit.kinematics.conftest import VECTORS

EXACT = {"rtol": 0, "atol": 1e-9}


@pytest.mark.parametrize("case", VECTORS["fk"], ids=range(len(VECTORS["fk"])))
class TestVectors:
    def test_pose_and_points(self, moma8: ArmModel, case: dict) -> None:
        np.testing.assert_allclose(moma8.pose(case["q"]), case["T"], **EXACT)
        points = moma8.points(case["q"])
        assert sorted(points) == ["A", "B", "C", "D", "E"]
        for name, point in points.items():
            np.testing.assert_allclose(point, case["points"][name], **EXACT)

    def test_jacobians(self, moma8: ArmModel, case: dict) -> None:
        np.testing.assert_allclose(moma8.jacobian(case["q"]), case["J_base"], **EXACT)
        np.testing.assert_allclose(moma8.end_point_jacobian(case["q"]), case["J_ee"], **EXACT)
        np.testing.assert_allclose(moma8.wrist_jacobian(case["q"]), case["J_D_3x5"], **EXACT)

    def test_one_forward_pass_gives_the_same(self, moma8: ArmModel, case: dict) -> None:
        state = moma8.state(case["q"])
        np.testing.assert_allclose(state.pose, case["T"], **EXACT)
        np.testing.assert_allclose(state.jacobian, case["J_base"], **EXACT)
        np.testing.assert_allclose(state.end_point_jacobian, case["J_ee"], **EXACT)

    def test_singular_values_and_manipulability(self, moma8: ArmModel, case: dict) -> None:
        jacobian = moma8.jacobian(case["q"])
        np.testing.assert_allclose(singular_values(jacobian), case["sv"], **EXACT)
        assert manipulability(jacobian) == pytest.approx(case["manip_E"], abs=1e-9)
        assert manipulability(moma8.wrist_jacobian(case["q"])) == pytest.approx(case["manip_D"], abs=1e-9)

    def test_extended_jacobian_in_both_frames(self, moma8: ArmModel, case: dict) -> None:
        np.testing.assert_allclose(extended_jacobian(moma8, case["q"]), case["Jext_ee"], **EXACT)
        c, s = np.cos(case["theta"]), np.sin(case["theta"])
        heading = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        in_world = turned_rows(heading, extended_in_platform(moma8, moma8.state(case["q"])))
        np.testing.assert_allclose(in_world, case["Jext_world"], **EXACT)

    def test_four_measures_of_freedom(self, moma8: ArmModel, case: dict) -> None:
        q = case["q"]
        four = [
            extended_jacobian(moma8, q),
            extended_wrist_jacobian(moma8, q),
            moma8.jacobian(q),
            moma8.wrist_jacobian(q),
        ]
        np.testing.assert_allclose([manipulability(j) for j in four], case["metrics_4"], **EXACT)


def test_smoke_test_of_the_definition(moma8: ArmModel) -> None:
    q = (0.1, 0.9, -0.4, 0.7, 0.8, 0.3, 0.6, -0.2)
    np.testing.assert_allclose(moma8.pose(q)[:3, 3], (-0.134530, -0.045343, 0.237407), rtol=0, atol=5e-7)
    assert manipulability(moma8.jacobian(q)) == pytest.approx(0.2457353106, abs=1e-10)
    assert manipulability(moma8.wrist_jacobian(q)) == pytest.approx(0.1462980926, abs=1e-10)


def test_at_zero_the_arm_hangs_straight_down_beside_the_tower(moma8: ArmModel) -> None:
    points = moma8.points(np.zeros(8))
    np.testing.assert_allclose(points["B"], (0, 0.365, 0), atol=1e-12)
    np.testing.assert_allclose(points["D"], (0, 0.365, -0.592), atol=1e-12)
    np.testing.assert_allclose(points["E"], (0, 0.365, -0.922), atol=1e-12)


def test_wrist_centre_never_exceeds_its_known_maximum(moma8: ArmModel) -> None:
    rng = np.random.default_rng(3)
    measured = [manipulability(moma8.wrist_jacobian(q)) for q in rng.uniform(-np.pi, np.pi, (3000, 8))]
    assert 0.24 < max(measured) <= 0.2660
