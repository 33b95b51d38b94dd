"""The fence of a guided hand: where it stands, whom it pulls back, and that who turns round is free."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stack.messages import PlannerPhase, PlannerState, Restriction
from stack.strategic.fence import Fence, FencePost, freedom, moved_post, pull_back
from stack.strategic.force_guidance import Admittance
from stack.strategic.guide import Guide, GuideState
from stack.strategic.motion import CYCLE_S, MotionInputs

FENCE = Fence(margin=0.35, stiffness=2000.0, force=100.0)
Array = NDArray[np.float64]


def planner(path_scale: float = 1.0, restrictions: Restriction = Restriction.NONE) -> PlannerState:
    return PlannerState(PlannerPhase.EXECUTING, 0, restrictions, path_scale, 0)


def test_freedom_is_the_lesser_of_margin_and_path() -> None:
    assert freedom(FENCE, None, planner()) == 1.0
    assert freedom(FENCE, 0.9, planner()) == 1.0
    assert freedom(FENCE, 0.07, planner()) == pytest.approx(0.2)
    assert freedom(FENCE, 0.07, planner(0.1)) == pytest.approx(0.1)
    assert freedom(Fence(margin=0.0), 0.0, planner()) == 1.0


def test_a_path_that_is_slow_because_joints_are_fast_is_free() -> None:
    assert freedom(FENCE, 0.9, planner(0.4, Restriction.VELOCITY)) == 1.0
    assert freedom(FENCE, 0.9, planner(0.4, Restriction.DEGRADED)) == pytest.approx(0.4)


def test_the_post_stays_where_it_only_got_worse_and_goes_along_where_it_gets_better() -> None:
    a, b, c = np.zeros(3), np.array([0.01, 0.0, 0.0]), np.array([0.02, 0.0, 0.0])
    assert moved_post(None, a, 1.0) is None
    post = moved_post(None, a, 0.8)
    assert moved_post(post, b, 0.5) is post
    along = moved_post(post, c, 0.8)
    assert along is not None
    np.testing.assert_array_equal(along.place, c)
    assert moved_post(post, b, 1.0) is None


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3).map(np.array))
def test_the_spring_pulls_to_the_post_and_no_harder_than_it_may(place: Array) -> None:
    force = pull_back(FENCE, FencePost(np.zeros(3), 0.5), place)
    assert np.linalg.norm(force) <= 100.0 + 1e-9
    assert force @ place <= 0.0
    assert not pull_back(FENCE, None, place).any()


def pushed(force: float, cycles: int, state: GuideState, x: float) -> tuple[GuideState, float]:
    """A hand that pushes along x where the margin falls from 0.5 to nothing over 50 mm; the TCP does what it is told."""
    motion = Guide(Admittance(), 1e9, FENCE)
    for cycle in range(cycles):
        X_RE = np.eye(4)
        X_RE[0, 3] = x
        margin = max(0.5 - 10.0 * x, 0.0)
        wrench = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
        inputs = MotionInputs(cycle * CYCLE_S, planner(), np.eye(3), X_RE, wrench, singularity_margin=margin)
        state, outputs = motion.step(state, inputs)
        x += outputs.twist[0] * CYCLE_S
    return state, x


def begun() -> GuideState:
    return Guide(Admittance(), 1.0).begin(MotionInputs(0.0, planner(), np.eye(3)))


def test_a_hand_that_pushes_on_is_held_before_the_singularity_and_one_that_turns_round_is_not() -> None:
    state, x = pushed(20.0, 300, begun(), 0.0)
    assert 0.015 < x < 0.03  # the fence begins at 15 mm; 20 N press it in by 10
    _, back = pushed(-20.0, 50, state, x)
    assert back < x - 0.1


def test_without_the_fence_the_hand_goes_on() -> None:
    motion = Guide(Admittance(), 1e9, Fence(margin=0.0))
    state, x = begun(), 0.0
    for cycle in range(100):
        wrench = np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        inputs = MotionInputs(cycle * CYCLE_S, planner(), np.eye(3), np.eye(4), wrench, singularity_margin=0.0)
        state, outputs = motion.step(state, inputs)
        x += outputs.twist[0] * CYCLE_S
    assert x > 0.3
