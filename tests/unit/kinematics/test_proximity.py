"""Distances between links and to boxes: known geometry, finite differences, and who is never compared."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.kinematics.platform import platform_of
from stack.kinematics.proximity import BodyDistances, Box, Proximity
from stack.kinematics.se3 import pose_inverse, rotation_exp

ARM = ArmModel.load("moma8")
BODIES = BodyDistances(ARM)
BASE = np.array(platform_of(ARM).arm_base)
SHARES = st.lists(st.floats(0.02, 0.98), min_size=8, max_size=8)
STEP = 1e-5


def configuration(shares: list[float]) -> np.ndarray:
    return ARM.q_min + np.array(shares) * (ARM.q_max - ARM.q_min)


def test_a_wall_in_front_of_the_gripper_is_as_far_as_the_drawing_says() -> None:
    tip = ARM.pose(ARM.home)
    wall = Box(*(tip[:3, 3] + [0.5, 0.0, 0.0]), 0.2, 4.0, 4.0)
    nearest = min(pair.distance for pair in BODIES.near(ARM.home, 1.0, [wall], np.eye(4)) if "gripper" in pair.name)
    assert 0.35 < nearest < 0.45  # the wall's face is 0.4 m ahead of the TCP, about where the gripper ends


def test_neighbours_and_wheels_are_not_compared() -> None:
    assert "lower_arm - wrist_tilt" not in BODIES.pairs
    assert not [pair for pair in BODIES.pairs if "wheel" in pair or "castor" in pair]
    assert "tower - gripper" in BODIES.pairs


def test_the_home_posture_is_clear_of_everything() -> None:
    assert min(pair.distance for pair in BODIES.near(ARM.home, 1.0)) > 0.1


def one_sided(pair: Proximity, before: list[Proximity], after: list[Proximity]) -> tuple[float, float] | None:
    found = [[other.distance for other in others if other.name == pair.name] for others in (before, after)]
    if not found[0] or not found[1]:
        return None
    return (pair.distance - found[0][0]) / STEP, (found[1][0] - pair.distance) / STEP


@given(SHARES, st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8))
def test_the_gradient_is_the_derivative_by_the_joints(shares: list[float], direction: list[float]) -> None:
    q, d = configuration(shares), np.array(direction)
    table = [Box(0.6, 0.1, 0.2, 0.3, 0.4, 0.1, 0.4)]
    pairs = BODIES.near(q, 0.4, table, np.eye(4))
    before, after = (BODIES.near(q + sign * STEP * d, 0.5, table, np.eye(4)) for sign in (-1, 1))
    for pair in pairs:
        slopes = one_sided(pair, before, after)
        # Where the nearest point jumps from one edge to another the distance has a kink; near contact GJK hands over to EPA.
        if slopes is None or abs(slopes[0] - slopes[1]) > 1e-3 or pair.distance < 1e-3:
            continue
        assert pair.gradient @ d == pytest.approx(0.5 * sum(slopes), abs=2e-3), pair.name


@given(SHARES, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_platform_columns_are_the_derivative_by_v_and_omega(shares: list[float], v: float, omega: float) -> None:
    q = configuration(shares)
    boxes = [Box(0.9, 0.2, 0.6, 0.5, 0.8, 0.1, 0.3)]

    def seen(sign: float) -> list[Proximity]:
        T_RB = np.eye(4)
        T_RB[:3, :3] = rotation_exp(np.array([0.0, 0.0, sign * STEP * omega]))
        T_RB[0, 3] = sign * STEP * v
        T_BA = np.eye(4)
        T_BA[:3, 3] = BASE
        return BODIES.near(q, 0.5, boxes, pose_inverse(T_RB @ T_BA))

    here = [pair for pair in seen(0.0) if "obstacle" in pair.name and pair.distance > 1e-3]
    assume(here)
    for pair in here:
        slopes = one_sided(pair, seen(-1.0), seen(1.0))
        if slopes is None or abs(slopes[0] - slopes[1]) > 1e-3:
            continue
        assert pair.platform @ [v, omega] == pytest.approx(0.5 * sum(slopes), abs=2e-3), pair.name


@given(SHARES)
def test_the_same_question_has_the_same_answer_bit_for_bit(shares: list[float]) -> None:
    q = configuration(shares)
    first = BODIES.near(q, 0.3)
    BODIES.near(ARM.home, 0.3)
    again = BODIES.near(q, 0.3)
    assert [pair.name for pair in first] == [pair.name for pair in again]
    for one, other in zip(first, again, strict=True):
        assert one.distance == other.distance
        np.testing.assert_array_equal(one.gradient, other.gradient)
