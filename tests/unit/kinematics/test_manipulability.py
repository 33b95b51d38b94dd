"""Manipulability: what it measures, and the known maxima of the reference robots."""

import numpy as np
import pytest
from scipy.optimize import minimize

from stack.kinematics import ArmModel
from stack.kinematics.manipulability import manipulability, singular_values, velocity_ellipsoid
from stack.kinematics.se3 import rotation_from_quaternion


def test_is_the_root_of_the_determinant(any_arm: ArmModel) -> None:
    j = any_arm.jacobian(any_arm.home)[: 2 if any_arm.name == "planar3" else 6]
    assert manipulability(j) == pytest.approx(np.sqrt(np.linalg.det(j @ j.T)), rel=1e-9)


def test_singular_values_descend_and_vanish_with_the_rank() -> None:
    values = singular_values([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    np.testing.assert_allclose(values, (4, 3, 0), atol=1e-12)
    assert manipulability(np.zeros((3, 5))) == 0.0


def test_ellipsoid_is_the_image_of_the_unit_ball(moma8: ArmModel) -> None:
    j, centre = moma8.wrist_jacobian(moma8.home), moma8.points(moma8.home)["D"]
    ellipsoid = velocity_ellipsoid(j, centre)
    axes = rotation_from_quaternion(ellipsoid.quaternion)
    np.testing.assert_allclose(axes @ np.diag(ellipsoid.half_sizes**2) @ axes.T, j @ j.T, atol=1e-12)
    np.testing.assert_array_equal(ellipsoid.centre, centre)


def test_flat_ellipsoid_of_a_singular_arm() -> None:
    ellipsoid = velocity_ellipsoid([[2.0], [0.0], [0.0]], (0, 0, 0))
    np.testing.assert_allclose(ellipsoid.half_sizes, (2, 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    ("jacobian", "message"),
    [
        (np.zeros(6), r"jacobian has shape \(6,\), expected \(m, n\)"),
        (np.full((3, 2), np.nan), "jacobian is not finite"),
    ],
)
def test_what_is_no_jacobian_is_refused(jacobian: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        manipulability(jacobian)


@pytest.mark.parametrize(
    ("name", "start", "maximum"),
    [
        ("comau_racer7", (0.0, 0.6, 0.2, 0.0, 1.4, 0.0), 0.46589),
        ("iiwa14", (0.0, -1.2, 0.1, -1.2, 0.1, -1.2, 0.0), 0.15979),
        ("panda", (0.0, 1.0, 0.1, -1.6, -1.5, 1.5, 0.0), 0.13170),
    ],
)
def test_known_maximum_inside_the_limits(name: str, start: tuple[float, ...], maximum: float) -> None:
    """From a start near the optimum a bounded search climbs to the published value and no higher."""
    arm = ArmModel.load(name)
    bounds = list(zip(arm.q_min, arm.q_max, strict=True))
    found = minimize(lambda q: -manipulability(arm.jacobian(q)), start, method="L-BFGS-B", bounds=bounds)
    assert manipulability(arm.jacobian(start)) < maximum - 1e-4
    assert -found.fun == pytest.approx(maximum, abs=1e-4)
    assert np.all((found.x >= arm.q_min) & (found.x <= arm.q_max))
