"""The tracked feature: the pose of exactly `latency` ago, at its rate, with its noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.rotation import pose_of, quaternion_of, rotation_of, rotation_vector_of
from sim.tracker import Tracker, TrackerParameters

MS = 1_000_000
EXACT = TrackerParameters(rate_hz=50.0, latency_s=0.033, noise_m=0.0, noise_rad=0.0)
vectors = st.tuples(*[st.floats(-2.5, 2.5)] * 3)


def pose_at(t_ns: int) -> np.ndarray:
    t = t_ns * 1e-9
    pose = np.eye(4)
    pose[:3, :3] = rotation_of((0.1 * t, -0.2 * t, 0.3))
    pose[:3, 3] = 0.4 * t, np.sin(t), 1.0
    return pose


def watch(tracker: Tracker, until_ns: int) -> list[tuple[int, object]]:
    seen = []
    for t_ns in range(0, until_ns, MS):
        if t_ns % tracker.period_ns == 0:
            tracker.expose(t_ns, pose_at(t_ns))
        message = tracker.deliver(t_ns)
        if message is not None:
            seen.append((t_ns, message))
    return seen


def test_it_delivers_the_pose_of_exactly_the_latency_ago() -> None:
    seen = watch(Tracker(EXACT, seed=1), 500 * MS)
    assert [t for t, _ in seen] == list(range(33 * MS, 500 * MS, 20 * MS))
    for t, message in seen:
        assert message.age_ns == 33 * MS
        assert np.array_equal(message.position, pose_at(t - 33 * MS)[:3, 3])
        assert rotation_of(message.rotation_vector) == pytest.approx(pose_at(t - 33 * MS)[:3, :3], abs=1e-12)


def test_polled_late_it_gives_the_newest_and_tells_its_age() -> None:
    tracker = Tracker(EXACT, seed=1)
    for t in (0, 20, 40):
        tracker.expose(t * MS, pose_at(t * MS))
    message = tracker.deliver(60 * MS)
    assert message is not None
    assert message.age_ns == 40 * MS
    assert tracker.deliver(60 * MS) is None


def test_the_camera_does_not_follow_what_moves_after_the_exposure() -> None:
    tracker, pose = Tracker(EXACT, seed=1), np.eye(4)
    tracker.expose(0, pose)
    pose[0, 3] = 5.0
    message = tracker.deliver(40 * MS)
    assert message is not None
    assert message.position[0] == 0.0


def test_period_is_in_whole_ticks() -> None:
    assert Tracker(TrackerParameters(rate_hz=30.0), 1).period_ns == 33 * MS


def test_noise_is_of_the_size_asked_for_and_seeded() -> None:
    parameters = TrackerParameters(rate_hz=1000.0, latency_s=0.0, noise_m=0.002, noise_rad=0.01)

    def record(seed: int) -> np.ndarray:
        messages = watch(Tracker(parameters, seed), 2000 * MS)
        return np.array(
            [
                [*(m.position - pose_at(t)[:3, 3]), *rotation_vector_of(rotation_of(m.rotation_vector) @ pose_at(t)[:3, :3].T)]
                for t, m in messages
            ]
        )  # fmt: skip

    first = record(1)
    assert first[:, :3].std() == pytest.approx(0.002, rel=0.05)
    assert first[:, 3:].std() == pytest.approx(0.01, rel=0.05)
    assert np.array_equal(first, record(1))
    assert not np.array_equal(first, record(2))


@pytest.mark.parametrize("name", ["rate_hz", "latency_s", "noise_m", "noise_rad"])
def test_bad_parameters_are_named(name: str) -> None:
    with pytest.raises(ValueError, match=f"feedback.{name}"):
        TrackerParameters(**{name: -1.0})


@given(vectors)
def test_rotations_agree_with_scipy(vector: tuple[float, float, float]) -> None:
    rotation = rotation_of(vector)
    reference = Rotation.from_rotvec(vector)
    assert rotation == pytest.approx(reference.as_matrix(), abs=1e-12)
    assert Rotation.from_quat(quaternion_of(rotation)).as_matrix() == pytest.approx(rotation, abs=1e-12)
    assert rotation_of(rotation_vector_of(rotation)) == pytest.approx(rotation, abs=1e-9)
    assert pose_of((1.0, 2.0, 3.0), quaternion_of(rotation))[:3, :3] == pytest.approx(rotation, abs=1e-12)
