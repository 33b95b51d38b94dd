"""Joint references of the strategic layer as set points: through every reference, late by the fixed delay, without steps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stack.messages import JointReference
from stack.planner.joint_following import DELAY_NS, STRATEGIC_PERIOD_NS, JointFollower, velocity_to

ARM_PERIOD_NS = 10_000_000


def fed(path, count: int, *, jitter=None, lost: frozenset[int] = frozenset(), first_counter: int = 0) -> JointFollower:
    follower = JointFollower()
    for i in range(count):
        if i in lost:
            continue
        t_ns = i * STRATEGIC_PERIOD_NS
        late = 0 if jitter is None else jitter[i % len(jitter)]
        follower = follower.hearing(JointReference(path(t_ns * 1e-9), (first_counter + i) % 256), t_ns + late)
    return follower


def smooth(t: float) -> np.ndarray:
    return np.array([0.4 * np.sin(3.0 * t), 0.75 + 0.1 * np.cos(2.0 * t)])


def test_a_smooth_motion_is_followed_with_the_stated_delay() -> None:
    follower, worst = JointFollower(), 0.0
    for i in range(150):
        follower = follower.hearing(JointReference(smooth(0.02 * i), i % 256), i * STRATEGIC_PERIOD_NS)
        for k in range(2):  # two arm cycles of each strategic cycle, each asks for two periods ahead
            t_ns = i * STRATEGIC_PERIOD_NS + (k + 2) * ARM_PERIOD_NS
            if i > 5:
                worst = max(worst, np.abs(follower.at(t_ns) - smooth((t_ns - DELAY_NS) * 1e-9)).max())
    assert worst < 2e-5  # rad: the spline through samples 20 ms apart of a motion of 3.6 rad/s²


@given(st.lists(st.integers(0, 5_000_000), min_size=3, max_size=9), st.integers(0, 255))
def test_jitter_of_the_bus_and_the_turn_of_the_counter_change_nothing(jitter: list[int], counter: int) -> None:
    jitter[0] = 0
    jitter = [0, *jitter]
    t_ns = 19 * STRATEGIC_PERIOD_NS + ARM_PERIOD_NS
    late = JointFollower()
    for i in range(20):
        message = JointReference(smooth(0.02 * i), (counter + i) % 256)
        late = late.hearing(message, i * STRATEGIC_PERIOD_NS + (jitter[i % len(jitter)] if i else 0))
    np.testing.assert_array_equal(late.at(t_ns), fed(smooth, 20, first_counter=counter).at(t_ns))


def test_a_lost_reference_is_bridged() -> None:
    t_ns = 14 * STRATEGIC_PERIOD_NS + DELAY_NS
    np.testing.assert_allclose(fed(smooth, 20, lost=frozenset({14})).at(t_ns), smooth(0.28), atol=1e-3)


def test_it_stays_at_the_last_reference_and_says_nothing_before_the_first() -> None:
    assert JointFollower().at(0) is None
    follower = fed(smooth, 20)
    np.testing.assert_array_equal(follower.at(10**10), smooth(0.02 * 19))


def test_a_pause_begins_anew_where_it_is_told() -> None:
    follower = fed(smooth, 20).hearing(JointReference(np.array([1.0, 1.0]), 20), 10**10)
    np.testing.assert_array_equal(follower.at(10**10), [1.0, 1.0])


def test_the_velocity_reaches_its_target_unless_the_bounds_cut_it() -> None:
    q = np.array([0.0, 0.5])
    bounds = (np.array([-1.0, -0.2]), np.array([1.0, 0.2]))
    dq, limited = velocity_to(np.array([0.005, 0.501]), q, bounds, 0.01)
    np.testing.assert_allclose(q + dq * 0.01, [0.005, 0.501])
    assert not limited
    dq, limited = velocity_to(np.array([0.5, 0.501]), q, bounds, 0.01)
    np.testing.assert_allclose(dq, [1.0, 0.1])
    assert limited
