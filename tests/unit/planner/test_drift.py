"""The drift estimate without the observer: a share of each difference, for comparison and for a sensor that nobody knows."""

import numpy as np
import pytest

from stack.kinematics.se3 import pose_exp, pose_inverse
from stack.planner.drift import Belief, DriftEstimate, DriftLaw
from stack.planner.observer import SlipModel
from stack.planner.odometry import PlatformPose
from tests.unit.planner.slipping_platform import PERIOD_NS, TRACK, constant, driving, follow, seen

HERE = PlatformPose(0.0, 0.0, 0.0)


def law(gain: float) -> DriftLaw:
    return DriftLaw(TRACK, None, gain)


def belief(t_ns: int, T_OE: np.ndarray) -> Belief:
    return Belief(t_ns, HERE, T_OE)


@pytest.mark.parametrize("model", [None, SlipModel()])
def test_the_first_measurement_is_taken_whole(model: SlipModel | None) -> None:
    believed = pose_exp(np.array([0.5, 0.2, 0.7, 0.1, 0.2, 0.3]))
    true = pose_exp(np.array([1.5, -0.2, 0.7, 0.1, 0.2, 0.9]))
    either = DriftLaw(TRACK, model, 0.2)
    drift = DriftEstimate().believing(belief(0, believed), either).measured_by(seen(true), 0, either)
    np.testing.assert_allclose(drift.T_RO @ believed, true, atol=1e-12)
    assert drift.placements == 1


def test_a_constant_offset_is_learned_geometrically() -> None:
    believed, offset = np.eye(4), pose_exp(np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.05]))
    drift = DriftEstimate(count=100)
    errors = []
    for k in range(30):
        drift = drift.believing(belief(k * PERIOD_NS, believed), law(0.25))
        drift = drift.measured_by(seen(offset @ believed), k * PERIOD_NS, law(0.25))
        errors.append(np.linalg.norm((drift.T_RO @ believed - offset @ believed)[:3, 3]))
    assert errors[4] == pytest.approx(errors[3] * 0.75, rel=1e-9)
    assert errors[-1] < 1e-5


def test_latency_is_no_error() -> None:
    """A moving TCP and a late sensor: compared at the time of the measurement, nothing is left to correct."""
    drift = DriftEstimate(count=100)
    for k in range(20):
        pose = np.eye(4)
        pose[0, 3] = 0.002 * k
        drift = drift.believing(belief(k * PERIOD_NS, pose), law(0.5))
    late = np.eye(4)
    late[0, 3] = 0.002 * 16.5
    drift = drift.measured_by(seen(late, age_ns=25_000_000), 19 * PERIOD_NS, law(0.5))
    np.testing.assert_allclose(drift.T_RO, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("model", [None, SlipModel()])
def test_a_measurement_older_than_memory_changes_nothing(model: SlipModel | None) -> None:
    either = DriftLaw(TRACK, model, 0.5)
    drift = DriftEstimate().believing(belief(10**9, np.eye(4)), either)
    assert drift.measured_by(seen(pose_exp(np.ones(6)), age_ns=10**9), 10**9, either) is drift


def test_orientation_noise_does_not_move_the_tcp() -> None:
    far = np.eye(4)
    far[0, 3] = 4.0
    noisy = far.copy()
    noisy[:3, :3] = pose_exp(np.array([0, 0, 0, 0, 0, 0.01]))[:3, :3]
    drift = DriftEstimate(count=100).believing(belief(0, far), law(0.5)).measured_by(seen(noisy), 0, law(0.5))
    np.testing.assert_allclose((drift.T_RO @ far)[:3, 3], far[:3, 3], atol=1e-12)
    assert pose_inverse(drift.T_RO)[1, 0] != 0.0


def test_switching_the_observer_off_and_on_keeps_the_frame() -> None:
    drift, moment = follow(driving(100, constant(0.02, 0.0)), SlipModel(0.0, 0.0))
    off = drift.believing(moment.belief._replace(t_ns=100 * PERIOD_NS), law(0.25))
    np.testing.assert_array_equal(off.T_RO, drift.T_RO)
    assert not off.slip.any()
    on = DriftLaw(TRACK, SlipModel(0.0, 0.0))
    again = off.believing(moment.belief._replace(t_ns=101 * PERIOD_NS), on)
    again = again.measured_by(seen(moment.TCP), 101 * PERIOD_NS, on)
    np.testing.assert_allclose(again.T_RO, drift.T_RO, atol=1e-4)
    assert again.placements == 1
