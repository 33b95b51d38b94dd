"""Laws of the position solution: what it returns is right, complete and repeatable."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np

from stack.kinematics import ArmModel
from stack.kinematics.position import elbow_angle, elbow_circle, solve_position, within_limits
from stack.kinematics.se3 import pose_exp

ARM = ArmModel.load("moma8")
fractions = st_np.arrays(np.float64, 8, elements=st.floats(0.001, 0.999))
configurations = fractions.map(lambda f: ARM.q_min + f * (ARM.q_max - ARM.q_min))


def generic(q: np.ndarray) -> bool:
    """Away from the stretched arm, the straight elbow and the straight wrist, where a solution is a whole curve."""
    circle = elbow_circle(ARM, ARM.pose(q), q[1])
    bends = min(abs(np.sin(q[2])), abs(np.sin(q[4])), abs(np.sin(q[6])))
    return circle is not None and circle.radius > 0.01 and bends > 0.01


@given(configurations)
def test_every_configuration_is_among_the_solutions_of_its_own_pose(q: np.ndarray) -> None:
    assume(generic(q))
    solutions = solve_position(ARM, ARM.pose(q), q[1], elbow_angle(ARM, q))
    assert len(solutions) == 8
    assert min(np.abs(s - q).max() for s in within_limits(ARM, solutions, near=q)) < 1e-7


@given(configurations, st.floats(-3.5, 3.5), st.floats(0.35, 1.15))
def test_every_solution_reaches_the_pose_at_any_lift_and_elbow_angle(q: np.ndarray, phi: float, lift: float) -> None:
    pose = ARM.pose(q)
    for solution in solve_position(ARM, pose, lift, phi):
        assert solution[1] == lift
        np.testing.assert_allclose(ARM.pose(solution), pose, rtol=0, atol=1e-6)


@given(configurations, st.floats(-3.1, 3.1))
def test_the_elbow_ends_where_phi_says(q: np.ndarray, phi: float) -> None:
    circle = elbow_circle(ARM, ARM.pose(q), q[1])
    assume(circle is not None and circle.radius > 0.01 and circle.high > circle.low)
    used = circle.clipped(phi)
    for solution in solve_position(ARM, ARM.pose(q), q[1], phi):
        points = ARM.points(solution)
        np.testing.assert_allclose(points["C"] - points["A"], circle.elbow(used), rtol=0, atol=1e-7)


@given(configurations, st.floats(-3.1, 3.1))
def test_turning_about_the_tower_turns_the_solutions(q: np.ndarray, turn: float) -> None:
    """Nothing but TR knows where x is: the map of manipulability needs one radius only."""
    assume(generic(q))
    pose, phi = ARM.pose(q), elbow_angle(ARM, q)
    wrist = ARM.points(q)["D"]
    assume(np.hypot(wrist[0], wrist[1]) > 0.01)
    turned = pose_exp([0, 0, 0, 0, 0, turn])
    first = solve_position(ARM, pose, q[1], phi)
    second = solve_position(ARM, turned @ pose, q[1], phi)
    for a, b in zip(first, second, strict=True):
        difference = b - a
        assert abs(np.angle(np.exp(1j * (difference[0] - turn)))) < 1e-7
        np.testing.assert_allclose(np.exp(1j * difference[2:]), 1.0, rtol=0, atol=1e-7)
