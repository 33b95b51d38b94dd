"""The slip observer: right on average, as sure as it says, undisturbed by latency and outliers, bounded whatever it is told."""

import math
from itertools import islice, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stack.kinematics.se3 import rotation_log
from stack.messages import TrackedPose
from stack.planner.drift import Belief, DriftEstimate, DriftLaw
from stack.planner.observer import Estimate, SlipModel, slipping
from stack.planner.observer_kernels import SLIP_LIMIT, arc_between
from stack.planner.odometry import PlatformPose, advance
from tests.unit.planner.slipping_platform import (
    ON_PLATFORM,
    PERIOD,
    PERIOD_NS,
    TRACK,
    Moment,
    constant,
    driving,
    far_off,
    follow,
    noisy,
    planar,
    seen,
    wandering,
)

QUIET = SlipModel(position_noise_m=0.0, rotation_noise_rad=0.0)
NOISY = SlipModel()


def tcp_error(drift: DriftEstimate, moment: Moment) -> float:
    """m, of where the TCP is believed to be."""
    return float(np.linalg.norm((drift.T_RO @ moment.belief.T_OE - moment.TCP)[:3, 3]))


@pytest.mark.parametrize(("left", "right"), [(0.03, 0.03), (0.02, -0.01), (-0.1, 0.05)])
def test_constant_slip_is_found_without_bias(left: float, right: float) -> None:
    """By a model that lets slip last; one that expects it to die away within half a second stays a little behind."""
    largest = max(abs(left), abs(right))
    drift, moment = follow(driving(200, constant(left, right)), SlipModel(0.0, 0.0, 0.05, 100.0, 0.0))
    np.testing.assert_allclose(drift.slip, (left, right), atol=0.003 * largest)
    assert tcp_error(drift, moment) < 1e-5
    drift, moment = follow(driving(200, constant(left, right)), QUIET)
    np.testing.assert_allclose(drift.slip, (left, right), atol=0.08 * largest)
    assert tcp_error(drift, moment) < 1e-5 + 1e-4 * largest


def test_with_noise_constant_slip_is_right_on_average() -> None:
    """A model that expects slip to last takes in all of a long run."""
    model, random = SlipModel(tau_s=100.0, sigma=0.05, learning_s=0.0), np.random.default_rng(5)
    found = [
        follow(driving(300, constant(0.02, -0.01)), model, lambda _, m: noisy(m.TCP, model, random))[0].slip
        for _ in range(12)
    ]
    spread = np.std(found, axis=0) / math.sqrt(len(found))
    assert np.all(np.abs(np.mean(found, axis=0) - (0.02, -0.01)) < 4.0 * spread + 2e-4)


def error_states(drift: DriftEstimate, moment: Moment) -> np.ndarray:
    """(8,) true minus estimated, as the filter orders them."""
    point = np.array([moment.belief.pose.x, moment.belief.pose.y, 0.0, 1.0])
    shift = ((moment.T_RO - drift.T_RO) @ point)[:3]
    return np.concatenate(
        (shift, rotation_log((moment.T_RO @ np.linalg.inv(drift.T_RO))[:3, :3]), moment.slip - drift.slip)
    )


@pytest.mark.slow
def test_it_is_as_sure_as_it_says() -> None:
    """Normalised estimation error squared (Bar-Shalom, Li, Kirubarajan 2001, 5.4) over independent runs: 8 and 2 on average."""
    whole, of_slip = [], []
    for seed in range(60):
        random = np.random.default_rng(seed)
        slip = wandering(NOISY, random, 1500, PERIOD / 10)
        drift, moment = follow(
            driving(120, slip), NOISY, lambda k, m, r=random: noisy(m.TCP, NOISY, r) if k % 2 else None
        )
        error, covariance = error_states(drift, moment), drift.now.covariance
        whole.append(error @ np.linalg.solve(covariance, error))
        of_slip.append(error[6:] @ np.linalg.solve(covariance[6:, 6:], error[6:]))
    # 1.5 and 0.8: four standard deviations of a mean of 60 chi-square variables
    assert np.mean(whole) == pytest.approx(8.0, abs=2.1)
    assert np.mean(of_slip) == pytest.approx(2.0, abs=1.05)


def test_it_does_better_than_moving_by_a_share() -> None:
    errors = {}
    for name in ("observer", "share"):
        random = np.random.default_rng(11)
        slip = wandering(NOISY, random, 5000, PERIOD / 10)
        law = DriftLaw(TRACK, NOISY if name == "observer" else None, 0.25)
        drift, squares = DriftEstimate(), []
        for k, moment in enumerate(driving(500, slip, 0.25, 0.4)):
            drift = drift.believing(moment.belief, law)
            if k > 50:
                squares.append(tcp_error(drift, moment) ** 2)
            if k % 2:
                drift = drift.measured_by(noisy(moment.TCP, NOISY, random), moment.belief.t_ns, law)
        errors[name] = math.sqrt(np.mean(squares))
    assert errors["observer"] < 0.6 * errors["share"]


@given(st.lists(st.integers(0, 6), min_size=30, max_size=30), st.integers(0, 9))
@settings(max_examples=20)
def test_late_measurements_end_in_the_same_estimate(delays: list[int], fraction: int) -> None:
    """Whatever the delay, in whole cycles and in order, and wherever between two cycles they were taken."""
    law, random = DriftLaw(TRACK, NOISY), np.random.default_rng(1)
    moments = list(driving(40, constant(0.02, -0.02)))
    early = fraction * PERIOD_NS // 10
    taken = [(k * PERIOD_NS - early, noisy(moments[k].TCP, NOISY, random)) for k in range(1, 31)]
    last, due = 0, []
    for (t_ns, message), delay in zip(taken, delays, strict=True):
        last = max(last + PERIOD_NS, t_ns + early + delay * PERIOD_NS)  # one message a cycle
        due.append((min(last, 39 * PERIOD_NS), t_ns, message))

    def run(late: bool) -> DriftEstimate:
        drift = DriftEstimate()
        for moment in moments:
            now_ns = moment.belief.t_ns
            drift = drift.believing(moment.belief, law)
            for at_ns, t_ns, message in due:
                if now_ns == (at_ns if late else t_ns + early):
                    aged = TrackedPose(message.position, message.rotation_vector, now_ns - t_ns, 0)
                    drift = drift.measured_by(aged, now_ns, law)
        return drift

    on_time, late = run(False), run(True)
    assert late.count == on_time.count == 30
    np.testing.assert_allclose(late.T_RO, on_time.T_RO, atol=1e-10)
    np.testing.assert_allclose(late.slip, on_time.slip, atol=1e-8)


def test_latency_costs_only_what_has_changed_since() -> None:
    def late(k: int, _: Moment) -> TrackedPose | None:
        return seen(moments[k - 3].TCP, 3 * PERIOD_NS) if k >= 3 else None

    moments = list(driving(200, constant(0.03, 0.01)))
    drift, moment = follow(iter(moments), QUIET, late)
    assert tcp_error(drift, moment) < 5e-5, "without prediction 30 ms of slip are 0.2 mm"


def test_a_measurement_between_two_cycles_is_compared_with_what_was_then() -> None:
    law, fine = DriftLaw(TRACK, QUIET), list(driving(2000, constant(0.0, 0.0)))
    coarse = DriftEstimate()
    for k in range(0, 1990, 10):  # cycles ten times as long as those of `fine`
        coarse = coarse.believing(fine[k].belief, law)
        if k >= 10:
            coarse = coarse.measured_by(seen(fine[k - 7].TCP, 7 * PERIOD_NS), fine[k].belief.t_ns, law)
    assert abs(coarse.slip).max() < 1e-4
    assert coarse.rejected == 0


def test_an_outlier_is_rejected_and_leaves_no_trace() -> None:
    def with_outliers(k: int, moment: Moment) -> TrackedPose:
        return far_off(seen(moment.TCP), 0.05 * (k - 97)) if k in (100, 101, 102, 150) else seen(moment.TCP)

    clean, _ = follow(driving(200, constant(0.01, 0.0)), NOISY)
    dirty, _ = follow(driving(200, constant(0.01, 0.0)), NOISY, with_outliers)
    assert (dirty.rejected, dirty.count, dirty.placements) == (4, 196, 1)
    np.testing.assert_allclose(dirty.T_RO, clean.T_RO, atol=2e-5)


def test_a_suspicious_measurement_counts_less() -> None:
    """Two millimetres off a sensor of 0.1 mm: taken, since models are not perfect, but not at its word."""
    model = SlipModel(position_noise_m=1e-4, rotation_noise_rad=1e-4)
    drift, _ = follow(driving(100, constant(0.0, 0.0), 0.0, 0.0), model)
    law, moment = DriftLaw(TRACK, model), next(driving(1, constant(0.0, 0.0)))
    after = []
    for by in (0.0005, 0.0039):
        off = drift.measured_by(far_off(seen(moment.TCP), by), 99 * PERIOD_NS, law)
        after.append(tcp_error(off, moment) / by)
        assert off.rejected == 0
    assert after[1] < 0.3 * after[0]


def test_a_tracker_that_has_jumped_for_good_is_believed_in_the_end() -> None:
    def jumped(k: int, moment: Moment) -> TrackedPose:
        return far_off(seen(moment.TCP), 0.05) if k >= 100 else seen(moment.TCP)

    drift, moment = follow(driving(109, constant(0.0, 0.0)), NOISY, jumped)
    assert (drift.placements, drift.rejected) == (1, 9)
    assert tcp_error(drift, moment) < 1e-3
    drift, moment = follow(driving(130, constant(0.0, 0.0)), NOISY, jumped)
    assert (drift.placements, drift.rejected) == (2, 9)
    assert tcp_error(drift, moment) == pytest.approx(0.05, abs=1e-3)


def test_a_tracker_that_only_flickers_is_never_believed() -> None:
    def flickering(k: int, moment: Moment) -> TrackedPose:
        return far_off(seen(moment.TCP), 0.03 + 0.02 * (k % 3)) if k >= 100 else seen(moment.TCP)

    drift, moment = follow(driving(200, constant(0.0, 0.0)), NOISY, flickering)
    assert (drift.placements, drift.rejected) == (1, 100)
    assert tcp_error(drift, moment) < 2e-3


def test_without_feedback_the_slip_dies_away_as_the_model_has_it() -> None:
    def until(end: int) -> np.ndarray:
        return follow(driving(end, constant(0.03, 0.02)), QUIET, lambda k, m: seen(m.TCP) if k < 100 else None)[0].slip

    np.testing.assert_allclose(until(151), until(101) * math.exp(-1.0), rtol=1e-9)
    assert abs(until(600)).max() < 1e-5
    assert abs(until(1)).max() == 0.0


def test_feedback_that_comes_back_after_memory_is_taken_up_again() -> None:
    slip = constant(0.01, -0.005)
    drift, moment = follow(driving(500, slip), NOISY, lambda k, m: seen(m.TCP) if not 100 <= k < 300 else None)
    assert (drift.rejected, drift.placements) == (0, 1)
    assert tcp_error(drift, moment) < 2e-4


def test_out_of_order_and_too_old_measurements_change_nothing() -> None:
    moments = list(driving(100, constant(0.01, 0.0)))
    drift, moment = follow(iter(moments), NOISY)
    law = DriftLaw(TRACK, NOISY)
    for age in (1, 30, 70):
        assert drift.measured_by(seen(moments[99 - age].TCP, age * PERIOD_NS), moment.belief.t_ns, law) is drift


@given(st.floats(-0.6, 0.6), st.floats(-1.2, 1.2), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_slip_moves_the_frame_as_the_wheels_lose_their_way(v: float, omega: float, left: float, right: float) -> None:
    lasting = SlipModel(tau_s=1e9)
    moments = list(driving(20, constant(left, right), v, omega, fine=1))
    estimate = Estimate(moments[0].T_RO, np.array([left, right]), np.eye(8))
    for a, b in pairwise(moments):
        estimate = estimate.moved(a.belief.pose, b.belief.pose, PERIOD, TRACK, lasting)
    np.testing.assert_allclose(estimate.T_RO, moments[-1].T_RO, atol=1e-9)
    path = slipping([m.belief.pose for m in moments], np.array([left, right]), PERIOD, TRACK, 1e9)
    np.testing.assert_allclose(moments[0].T_RO @ planar(path[-1]) @ ON_PLATFORM, moments[-1].TCP, atol=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
def test_an_arc_is_found_again_from_its_ends(way: float, turn: float, heading: float) -> None:
    start = PlatformPose(0.3, -0.8, heading)
    assert arc_between(*start, *advance(start, way, turn)) == pytest.approx((way, turn), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("true", "begin"), [(0.04, 0.01), (0.01, 0.03)])
def test_how_much_the_wheels_slip_is_learned(true: float, begin: float) -> None:
    random, model = np.random.default_rng(2), SlipModel(sigma=begin, learning_s=5.0)
    slip = wandering(SlipModel(sigma=true), random, 40_010, PERIOD / 10)
    drift, _ = follow(driving(4000, slip), model, lambda k, m: noisy(m.TCP, model, random) if k % 2 else None)
    learned = math.sqrt(drift.now.variance)
    assert abs(learned - true) < 0.5 * abs(begin - true)


def test_what_was_learned_stays_while_the_robot_stands() -> None:
    model = SlipModel(sigma=0.03)
    drift, _ = follow(driving(1000, constant(0.0, 0.0), 0.0, 0.0), model)
    assert math.sqrt(drift.now.variance) == pytest.approx(0.03, rel=1e-3)


def test_what_is_learned_is_bounded_and_can_be_switched_off() -> None:
    calm = follow(driving(3000, constant(0.0, 0.0)), SlipModel(0.0, 0.0, learning_s=0.5))[0]
    wild = follow(driving(600, constant(0.3, -0.3)), SlipModel(0.0, 0.0, learning_s=0.5))[0]
    fixed = follow(driving(600, constant(0.3, -0.3)), SlipModel(0.0, 0.0, learning_s=0.0))[0]
    assert math.sqrt(calm.now.variance) == pytest.approx(0.002)
    assert math.sqrt(wild.now.variance) == pytest.approx(0.06)
    assert math.sqrt(fixed.now.variance) == pytest.approx(0.01)


ANYTHING = st.floats(allow_nan=True, allow_infinity=True, width=64)
POSES = st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-60.0, 60.0))


@given(
    st.lists(st.tuples(POSES, arrays(float, 6, elements=ANYTHING), st.integers(0, 10**9), st.booleans()), max_size=12),
    st.sampled_from([QUIET, NOISY, SlipModel(sigma=0.0), SlipModel(1.0, 1.0, 1.0, 1e-2, 1e-3)]),
)
@settings(max_examples=150)
def test_whatever_comes_the_estimate_is_finite_and_bounded(cycles: list, model: SlipModel) -> None:
    law, drift = DriftLaw(TRACK, model), DriftEstimate()
    for k, (xyz, numbers, age_ns, good) in enumerate(cycles):
        pose = PlatformPose(*xyz)
        T_OE = planar(pose) @ ON_PLATFORM
        drift = drift.believing(Belief(k * PERIOD_NS, pose, T_OE), law)
        tracked = seen(T_OE, 0) if good else TrackedPose(numbers[:3], numbers[3:], age_ns, 0)
        drift = drift.measured_by(tracked, k * PERIOD_NS, law)
        assert np.isfinite(drift.T_RO).all()
        assert abs(drift.slip).max() <= SLIP_LIMIT
        assert drift.T_RO[:3, :3] @ drift.T_RO[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
        if drift.now is not None:
            covariance = drift.now.covariance
            assert np.array_equal(covariance, covariance.T)
            assert np.linalg.eigvalsh(covariance)[0] >= -1e-9 * max(1.0, float(np.trace(covariance)))


def test_the_same_arguments_give_the_same_estimate() -> None:
    def once() -> DriftEstimate:
        random = np.random.default_rng(3)
        return follow(islice(driving(99, constant(0.02, 0.0)), 80), NOISY, lambda _, m: noisy(m.TCP, NOISY, random))[0]

    np.testing.assert_array_equal(once().T_RO, once().T_RO)
    np.testing.assert_array_equal(once().slip, once().slip)
