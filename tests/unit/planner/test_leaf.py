"""A door's leaf that goes with the hand: where it is, how it moves, and how that changes its distance from the robot."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.kinematics.platform import platform_of
from stack.kinematics.proximity import BodyDistances, Box, Proximity
from stack.kinematics.se3 import rotation_exp
from stack.planner.clearance import Clearance, Standing, nearest_pairs
from stack.planner.leaf import DoorLeaf, LeafHere, LeafMotion, LeafState

ARM = ArmModel.load("moma8")
BODIES = BodyDistances(ARM)
BASE = np.array(platform_of(ARM).arm_base)
SLIDING = DoorLeaf(Box(0.5, 1.0, 1.0, 0.9, 0.04, 2.0, 0.4), (0.2, 0.9), (0.0, 0.0), LeafMotion.SLIDES)
TURNING = DoorLeaf(Box(0.6, 1.0, 1.0, 0.8, 0.04, 2.0, 2.3), (0.9, 0.6), (0.4, 1.2), LeafMotion.TURNS)
SHARES = st.lists(st.floats(0.02, 0.98), min_size=8, max_size=8)
STEP = 1e-5


@pytest.mark.parametrize("leaf", [SLIDING, TURNING])
def test_with_the_hand_where_the_handle_was_the_door_is_shut(leaf: DoorLeaf) -> None:
    assert leaf.opening(np.array([*leaf.handle, 0.9])) == pytest.approx(0.0, abs=1e-12)
    assert leaf.at(0.0, leaf.motion) == pytest.approx(leaf.shut)


@given(st.floats(-1.2, 1.2))
def test_a_turning_leaf_keeps_its_handle_in_the_hand(angle: float) -> None:
    turn = rotation_exp(np.array([0.0, 0.0, angle]))
    hinge = np.array([*TURNING.hinge, 0.0])
    hand = hinge + turn @ (np.array([*TURNING.handle, 0.0]) - hinge)
    assert TURNING.opening(hand) == pytest.approx(angle, abs=1e-9)
    shut, opened = TURNING.shut.pose, TURNING.at(angle, LeafMotion.TURNS).pose
    # Seen from the leaf the handle is where it was.
    before = np.linalg.inv(shut) @ np.array([*TURNING.handle, 0.0, 1.0])
    after = np.linalg.inv(opened) @ np.array([*hand[:2], 0.0, 1.0])
    np.testing.assert_allclose(after, before, atol=1e-9)


@given(st.floats(-2.0, 2.0), st.floats(-0.3, 0.3))
def test_a_sliding_leaf_goes_along_itself_only(way: float, aside: float) -> None:
    along = SLIDING.shut.pose[:2, 0]
    across = SLIDING.shut.pose[:2, 1]
    hand = np.array(SLIDING.handle) + way * along + aside * across
    opening = SLIDING.opening(hand)
    assert opening == pytest.approx(way, abs=1e-9)
    box = SLIDING.at(opening, LeafMotion.SLIDES)
    np.testing.assert_allclose([box.x, box.y], SLIDING.shut.pose[:2, 3] + way * along, atol=1e-9)
    assert box.yaw == SLIDING.shut.yaw


@given(st.sampled_from([SLIDING, TURNING]), st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(0.3, 1.2))
def test_points_move_as_the_law_says(leaf: DoorLeaf, velocity: tuple[float, float, float], ahead: float) -> None:
    hand = np.array([*leaf.handle, 0.9]) + [0.1 * ahead, -0.1, 0.0]
    v = np.array(velocity)

    def point(hand_there: np.ndarray) -> np.ndarray:
        return (leaf.at(leaf.opening(hand_there), leaf.motion).pose @ [0.3, 0.02, 0.1, 1.0])[:3]

    moved = (point(hand + STEP * v) - point(hand - STEP * v)) / (2.0 * STEP)
    np.testing.assert_allclose(leaf.carried(point(hand), hand) @ v, moved, atol=1e-6)


def seen(leaf: DoorLeaf, q: np.ndarray, T_RB: np.ndarray) -> list[Proximity]:
    T_BA = np.eye(4)
    T_BA[:3, 3] = BASE
    T_RA, model = T_RB @ T_BA, ARM.state(q)
    _, here = LeafState().seen_from(leaf, (T_RA @ model.pose)[:3, 3])
    pairs = nearest_pairs(BODIES, model, Clearance(influence=0.5), (), Standing(T_RA, np.zeros(2), here))
    return [pair for pair in pairs if pair.name.endswith("- door")]


@given(
    st.sampled_from([SLIDING, TURNING]),
    SHARES,
    st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
)
def test_the_rate_is_the_derivative_with_a_leaf_that_comes_along(
    leaf: DoorLeaf, shares: list[float], direction: list[float], v: float, omega: float
) -> None:
    """Joints, platform, and what both do to the leaf by the hand, at once."""
    q, d = ARM.q_min + np.array(shares) * (ARM.q_max - ARM.q_min), np.array(direction)
    hand = (ARM.pose(q)[:3, 3] + BASE)[:2]
    assume(leaf.motion is LeafMotion.SLIDES or np.linalg.norm(hand - leaf.hinge) > 0.2)

    def at(sign: float) -> dict[str, float]:
        T_RB = np.eye(4)
        T_RB[:3, :3] = rotation_exp(np.array([0.0, 0.0, sign * STEP * omega]))
        T_RB[0, 3] = sign * STEP * v
        return {pair.name: pair.distance for pair in seen(leaf, q + sign * STEP * d, T_RB)}

    before, after = at(-1.0), at(1.0)
    pairs = [pair for pair in seen(leaf, q, np.eye(4)) if pair.distance > 1e-3]
    for pair in pairs:
        if pair.name not in before or pair.name not in after:
            continue
        slopes = (pair.distance - before[pair.name]) / STEP, (after[pair.name] - pair.distance) / STEP
        if abs(slopes[0] - slopes[1]) > 1e-3:
            continue  # a kink: the nearest point jumps from one edge to another
        rate = pair.gradient @ d + pair.platform @ [v, omega]
        assert rate == pytest.approx(0.5 * sum(slopes), abs=3e-3), pair.name


def test_the_hand_that_holds_the_handle_is_not_kept_from_it_and_the_platform_is() -> None:
    tip = ARM.pose(ARM.home)[:3, 3] + BASE
    leaf = replace(TURNING, shut=Box(*(tip + [0.05, 0.0, 0.0]), 0.04, 4.0, 4.0))
    names = [pair.name for pair in seen(leaf, ARM.home, np.eye(4))]
    assert not [name for name in names if "gripper" in name or "wrist_pan" in name or "sensor" in name]
    beside = replace(TURNING, shut=Box(0.0, 0.5, 1.0, 2.0, 0.04, 2.0), motion=LeafMotion.STANDS)
    assert "base_link - door" in [pair.name for pair in seen(beside, ARM.home, np.eye(4))]


def test_a_leaf_that_was_let_go_stays_where_it_is() -> None:
    hinge = np.array([*TURNING.hinge, 0.0])
    hand = hinge + rotation_exp(np.array([0.0, 0.0, 0.7])) @ (np.array([*TURNING.handle, 0.0]) - hinge)
    state, held = LeafState().seen_from(TURNING, hand)
    assert held is not None
    assert state.opening == pytest.approx(0.7)
    later, left = state.seen_from(replace(TURNING, motion=LeafMotion.STANDS), hand + [0.5, 0.5, 0.0])
    assert left is not None
    assert left.box == held.box
    assert later == state
    again, there = later.seen_from(None, hand)
    assert there is None
    assert again == LeafState(), "the next door begins shut"


def test_a_standing_leaf_does_not_move_with_the_hand() -> None:
    leaf = replace(TURNING, motion=LeafMotion.STANDS)
    assert not LeafHere(leaf, leaf.shut, np.zeros(3)).leaf.carried(np.ones(3), np.zeros(3)).any()
