"""Maps: every entry is a posture that exists, has that manipulability and lies where the map says; the choice of TL and φ by them."""

from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.kinematics.manipulability import manipulability
from stack.kinematics.manipulability_map import PoseMap, _lengths, cell_of, hand_jacobian, pose_map, radius_map
from stack.kinematics.posture import best_posture
from stack.kinematics.proximity import BodyDistances

ARM = ArmModel.load("moma8")


@cache
def hand_map() -> PoseMap:
    """Computed once, by the first test that needs it."""
    return pose_map(ARM, samples=300_000, cells=(10, 6, 12))


SHARES = st.lists(st.floats(0.1, 0.9), min_size=8, max_size=8)


def test_the_wrist_centre_is_never_better_than_the_known_maximum_and_comes_close() -> None:
    best = np.nanmax(radius_map(ARM, samples=200_000, cells=30).manipulability)
    assert 0.264 < best <= 0.2660 + 1e-4


@given(SHARES)
def test_the_closed_form_is_the_arms_jacobian_in_the_towers_frame(shares: list[float]) -> None:
    q = ARM.q_min + np.array(shares) * (ARM.q_max - ARM.q_min)
    q[[0, 1, 7]] = 0.0
    J, p, axis = hand_jacobian(*q[2:7], _lengths(ARM), True)
    pose = ARM.pose(q)
    np.testing.assert_allclose(J, ARM.jacobian(q), atol=1e-12)
    np.testing.assert_allclose(p, pose[:3, 3], atol=1e-12)
    np.testing.assert_allclose(axis, pose[:3, 2], atol=1e-12)


def test_every_entry_of_the_hands_map_is_a_posture_that_lies_in_its_cell() -> None:
    cells = np.argwhere(np.isfinite(hand_map().manipulability))
    for cell in cells[:: max(1, len(cells) // 200)]:
        q = np.concatenate(([0.0, 0.5], hand_map().posture[tuple(cell)], [0.0]))
        assert manipulability(ARM.jacobian(q)) == pytest.approx(hand_map().manipulability[tuple(cell)], abs=1e-9)
        assert cell_of(ARM.pose(q), hand_map().radius, hand_map().elevation, hand_map().azimuth) == tuple(cell)
        assert (q[2:7] >= ARM.q_min[2:7]).all()
        assert (q[2:7] <= ARM.q_max[2:7]).all()


@given(SHARES, st.floats(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_turning_about_the_tower_moving_along_it_and_panning_change_nothing(shares, turn, shift) -> None:
    q = ARM.q_min + np.array(shares) * (ARM.q_max - ARM.q_min)
    moved = q + np.array([turn, shift, 0, 0, 0, 0, 0, turn])
    assert manipulability(ARM.jacobian(moved)) == pytest.approx(manipulability(ARM.jacobian(q)), abs=1e-9)
    here, there = (
        cell_of(ARM.pose(x), hand_map().radius, hand_map().elevation, hand_map().azimuth) for x in (q, moved)
    )
    assert here == there or _at_an_edge(q)


def _at_an_edge(q: np.ndarray) -> bool:
    p, z = ARM.pose(q)[:3, 3], ARM.pose(q)[:3, 2]
    values = (np.hypot(p[0], p[1]), np.arcsin(z[2]), np.arctan2(z[1], z[0]) - np.arctan2(p[1], p[0]))
    edges = (hand_map().radius, hand_map().elevation, hand_map().azimuth)
    return any(
        np.abs(np.remainder(v - e + np.pi, 2 * np.pi) - np.pi).min() < 1e-9 for v, e in zip(values, edges, strict=True)
    )


@settings(max_examples=15, deadline=None)
@given(SHARES)
def test_the_choice_reaches_the_pose_inside_the_limits_and_is_no_worse_than_where_it_came_from(shares) -> None:
    q = ARM.q_min + np.array(shares) * (ARM.q_max - ARM.q_min)
    pose = ARM.pose(q)
    chosen = best_posture(ARM, pose, hand_map())
    assume(chosen is not None)
    np.testing.assert_allclose(ARM.pose(chosen.q), pose, atol=1e-9)
    assert (chosen.q >= ARM.q_min - 1e-12).all()
    assert (chosen.q <= ARM.q_max + 1e-12).all()
    assert chosen.manipulability == pytest.approx(manipulability(ARM.jacobian(chosen.q)))


def test_at_home_the_choice_is_better_than_home_and_clear_of_collisions() -> None:
    bodies = BodyDistances(ARM)
    chosen = best_posture(ARM, ARM.pose(ARM.home), hand_map(), bodies)
    assert chosen is not None
    assert chosen.manipulability > 1.5 * manipulability(ARM.jacobian(ARM.home))
    assert not bodies.near(chosen.q, 0.03)


def test_a_pose_out_of_reach_has_no_posture() -> None:
    far = np.eye(4)
    far[0, 3] = 3.0
    assert best_posture(ARM, far, hand_map()) is None
