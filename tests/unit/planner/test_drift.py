"""The drift estimate: what the TCP's own sensor knows and odometry does not."""

import numpy as np
import pytest

from stack.kinematics.se3 import pose_exp, pose_inverse, rotation_log
from stack.messages import TrackedPose
from stack.planner.drift import DriftEstimate

PERIOD_NS = 10_000_000


def seen(pose: np.ndarray, age_ns: int = 0) -> TrackedPose:
    return TrackedPose(pose[:3, 3], rotation_log(pose[:3, :3]), age_ns, 0)


def test_the_first_measurement_is_taken_whole() -> None:
    belief = pose_exp(np.array([0.5, 0.2, 0.7, 0.1, 0.2, 0.3]))
    true = pose_exp(np.array([1.5, -0.2, 0.7, 0.1, 0.2, 0.9]))
    drift = DriftEstimate().believing(0, belief).measured_by(seen(true), 0, gain=0.2)
    np.testing.assert_allclose(drift.T_RO @ belief, true, atol=1e-12)


def test_a_constant_offset_is_learned_geometrically() -> None:
    belief, offset = np.eye(4), pose_exp(np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.05]))
    drift = DriftEstimate(count=100)
    errors = []
    for k in range(30):
        drift = drift.believing(k * PERIOD_NS, belief).measured_by(seen(offset @ belief), k * PERIOD_NS, gain=0.25)
        errors.append(np.linalg.norm((drift.T_RO @ belief - offset @ belief)[:3, 3]))
    assert errors[4] == pytest.approx(errors[3] * 0.75, rel=1e-9)
    assert errors[-1] < 1e-5


def test_latency_is_no_error() -> None:
    """A moving TCP and a late sensor: compared at the time of the measurement, nothing is left to correct."""
    drift = DriftEstimate(count=100)
    for k in range(20):
        pose = np.eye(4)
        pose[0, 3] = 0.002 * k
        drift = drift.believing(k * PERIOD_NS, pose)
    late = np.eye(4)
    late[0, 3] = 0.002 * 16.5
    drift = drift.measured_by(seen(late, age_ns=25_000_000), 19 * PERIOD_NS, gain=0.5)
    np.testing.assert_allclose(drift.T_RO, np.eye(4), atol=1e-12)


def test_a_measurement_older_than_memory_changes_nothing() -> None:
    drift = DriftEstimate().believing(10**9, np.eye(4))
    assert drift.measured_by(seen(pose_exp(np.ones(6)), age_ns=10**9), 10**9, gain=0.5) is drift


def test_orientation_noise_does_not_move_the_tcp() -> None:
    far = np.eye(4)
    far[0, 3] = 4.0
    noisy = far.copy()
    noisy[:3, :3] = pose_exp(np.array([0, 0, 0, 0, 0, 0.01]))[:3, :3]
    drift = DriftEstimate(count=100).believing(0, far).measured_by(seen(noisy), 0, gain=0.5)
    np.testing.assert_allclose((drift.T_RO @ far)[:3, 3], far[:3, 3], atol=1e-12)
    assert pose_inverse(drift.T_RO)[1, 0] != 0.0
