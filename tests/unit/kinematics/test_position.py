"""Position solution with lift and elbow angle: against the thesis's numbers, at the edges, and the rules of choice."""

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.kinematics.position import (
    elbow_angle,
    elbow_circle,
    most_central,
    nearest,
    of_handedness,
    solve_position,
    within_limits,
)
from tests.unit.kinematics.conftest import VECTORS


def turns_apart(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two configurations, whole turns of the revolute joints aside."""
    difference = np.asarray(a) - b
    lift = abs(difference[1])
    return float(max(lift, np.abs((difference + np.pi) % (2 * np.pi) - np.pi)[[0, 2, 3, 4, 5, 6, 7]].max()))


@pytest.mark.parametrize("case", VECTORS["ik"], ids=range(len(VECTORS["ik"])))
def test_the_eight_known_solutions(moma8: ArmModel, case: dict) -> None:
    solutions = solve_position(moma8, case["T"], case["TL"], case["phi"])
    assert len(solutions) == len(case["solutions_8"]) == 8
    for known in case["solutions_8"]:
        assert min(turns_apart(known, q) for q in solutions) < 1e-9
    circle = elbow_circle(moma8, case["T"], case["TL"])
    assert (circle.low, circle.high) == pytest.approx(tuple(case["phi_limits"]), abs=1e-9)
    assert elbow_angle(moma8, case["q_source"]) == pytest.approx(case["phi"], abs=1e-9)


@pytest.mark.parametrize("case", VECTORS["ik_clip"], ids=range(len(VECTORS["ik_clip"])))
def test_out_of_the_shoulders_reach_whatever_the_elbow_angle(moma8: ArmModel, case: dict) -> None:
    assert case["q"] is None
    assert solve_position(moma8, case["T"], case["TL"], case["phi"]) == []
    assert elbow_circle(moma8, case["T"], case["TL"]) is None


def clipping_case(arm: ArmModel) -> tuple[np.ndarray, float]:
    """A pose and a lift at which the shoulder cuts the elbow's circle at both ends."""
    rng = np.random.default_rng(8)
    while True:
        q = rng.uniform(arm.q_min, arm.q_max)
        circle = elbow_circle(arm, arm.pose(q), q[1])
        if circle is not None and circle.low > 0.2 and circle.high < 2.8:
            return arm.pose(q), float(q[1])


@pytest.mark.parametrize("phi", [0.0, 0.01, -0.01, 3.1, -3.1, np.pi, 100.0])
def test_elbow_angle_is_clipped_to_the_nearest_of_the_same_side(moma8: ArmModel, phi: float) -> None:
    pose, lift = clipping_case(moma8)
    circle = elbow_circle(moma8, pose, lift)
    wrapped = np.arctan2(np.sin(phi), np.cos(phi))
    used = circle.clipped(phi)
    assert circle.low <= abs(used) <= circle.high
    assert abs(used) == pytest.approx(np.clip(abs(wrapped), circle.low, circle.high))
    if abs(np.sin(phi)) > 1e-9:
        assert np.sign(used) == np.sign(wrapped)
    solutions = solve_position(moma8, pose, lift, phi)
    assert solutions
    for q in solutions:
        np.testing.assert_allclose(moma8.pose(q), pose, rtol=0, atol=1e-8)
    assert elbow_angle(moma8, solutions[0]) == pytest.approx(used, abs=1e-6)


def test_no_elbow_angle_reaches_beyond_the_clip(moma8: ArmModel) -> None:
    """At the limits of φ the shoulder hangs straight down or up (sin SH = 0): there is no more to give."""
    pose, lift = clipping_case(moma8)
    circle = elbow_circle(moma8, pose, lift)
    for phi in (circle.low, circle.high):
        for q in solve_position(moma8, pose, lift, phi):
            assert abs(np.sin(q[2])) < 1e-6


@pytest.mark.parametrize("distance", [0.1, 5.0])
def test_too_near_and_too_far_have_no_solution(moma8: ArmModel, distance: float) -> None:
    pose = np.eye(4)
    pose[:3, 3] = (distance, 0.0, 0.75 - 0.33)  # the wrist centre at the height of A
    assert solve_position(moma8, pose, 0.75, 0.5) == []


@pytest.mark.parametrize("height", [0.2, 0.32, 0.5])
def test_wrist_centre_on_the_tower_axis_is_out_of_reach(moma8: ArmModel, height: float) -> None:
    """The forearm is shorter than the offset AB, so D stays at least 43 mm off the axis."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.75 - 0.33 + height
    assert solve_position(moma8, pose, 0.75, 0.7) == []


def test_coinciding_branches_come_once(moma8: ArmModel) -> None:
    """A straight wrist (WT = 0) leaves one way to turn the hand for each elbow: four solutions instead of eight."""
    q = np.array([0.3, 0.8, -0.9, 0.4, -1.1, 0.5, 0.0, 0.2])
    solutions = solve_position(moma8, moma8.pose(q), 0.8, elbow_angle(moma8, q))
    for solution in solutions:
        np.testing.assert_allclose(moma8.pose(solution), moma8.pose(q), rtol=0, atol=1e-7)
    tilted = [s for s in solutions if abs(np.sin(s[6])) < 1e-6]
    assert tilted
    assert len({tuple(np.round(s, 9)) for s in solutions}) == len(solutions)


def test_bad_input_is_named(moma8: ArmModel) -> None:
    with pytest.raises(ValueError, match=r"T has shape \(3, 3\), expected \(4, 4\)"):
        solve_position(moma8, np.eye(3), 0.8, 0.0)
    with pytest.raises(ValueError, match="lift is nan"):
        solve_position(moma8, np.eye(4), np.nan, 0.0)
    with pytest.raises(ValueError, match="robot iiwa14 has no tower lift"):
        solve_position(ArmModel.load("iiwa14"), np.eye(4), 0.0, 0.0)
    with pytest.raises(ValueError, match="no elbow angle"):
        elbow_angle(moma8, stretched(moma8))


def stretched(arm: ArmModel) -> np.ndarray:
    """A, C and D on one line: the lower arm points along AC."""
    q = np.array([0.0, 0.8, -0.9, 0.0, 0.0, 0.0, 0.5, 0.0])
    points = arm.points(q)
    line = points["C"] - points["A"]
    q[4] = 0.0
    forearm = -np.linalg.inv(_ry(q[2])) @ line / np.linalg.norm(line)
    q[3], q[4] = np.arctan2(forearm[1], forearm[0]), np.arccos(forearm[2])
    return q


def _ry(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_nearest_finds_the_way_back_from_a_disturbed_configuration(moma8: ArmModel) -> None:
    rng = np.random.default_rng(9)
    for _ in range(30):
        q = rng.uniform(moma8.q_min + 0.1, moma8.q_max - 0.1)
        if min(abs(np.sin(q[[2, 4, 6]]))) < 0.1:
            continue  # two branches meet there: either may be the nearer
        solutions = solve_position(moma8, moma8.pose(q), q[1], elbow_angle(moma8, q))
        np.testing.assert_allclose(nearest(moma8, solutions, q + rng.normal(0, 0.01, 8)), q, rtol=0, atol=1e-6)


def test_a_solution_a_whole_turn_outside_the_limits_is_turned_back(moma8: ArmModel) -> None:
    q = moma8.home.copy()
    q[2] = -3.3  # inside the shoulder's −200°…20°, but written as +2.98 by the position solution
    solutions = solve_position(moma8, moma8.pose(q), q[1], elbow_angle(moma8, q))
    assert all(abs(s[2]) <= np.pi for s in solutions)
    assert min(np.abs(s - q).max() for s in within_limits(moma8, solutions)) < 1e-9


def test_limits_drop_what_no_turn_brings_inside(moma8: ArmModel) -> None:
    right_handed = moma8.home.copy()
    right_handed[2] = 1.0
    too_high = moma8.home.copy()
    too_high[1] = 1.2
    assert within_limits(moma8, [right_handed, too_high]) == []
    assert nearest(moma8, [right_handed], moma8.home) is None
    assert most_central(moma8, []) is None


def test_most_central_stays_furthest_from_the_limits(moma8: ArmModel) -> None:
    middle = 0.5 * (moma8.q_min + moma8.q_max)
    near, far = middle + 0.1, middle + 0.3
    np.testing.assert_array_equal(most_central(moma8, [far, near]), near)


def test_handedness_goes_with_the_sign_of_the_elbow_angle(moma8: ArmModel) -> None:
    case = VECTORS["ik"][0]
    solutions = solve_position(moma8, case["T"], case["TL"], case["phi"])
    left, right = of_handedness(solutions, 0.5), of_handedness(solutions, -0.5)
    assert len(left) == len(right) == 4
    assert all(np.sin(q[2]) <= 0 for q in left)
    assert all(np.sin(q[2]) > 0 for q in right)
