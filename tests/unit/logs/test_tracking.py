"""TCP error: the number by which runs are judged."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from logs.signals import DecodedBlock, Signal, SignalTable
from logs.tracking import PathTracking

PERIOD_NS = 10_000_000


def _signals(
    commanded: np.ndarray, true: np.ndarray, segment: np.ndarray, R: Rotation | None = None
) -> tuple[Signal, Signal, Signal]:
    """References (n, 3) in a frame R turned against the world, truth (n, 3) in the world, same times."""
    n = len(commanded)
    t_ns = np.arange(n, dtype=np.int64) * PERIOD_NS
    R = R or Rotation.identity()
    turn = np.tile(R.inv().as_rotvec(), (n, 1))
    pose = np.hstack([R.inv().apply(commanded), turn])
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = true
    return Signal(t_ns + 52_000, pose), Signal(t_ns + 52_000, segment[:, None].astype(float)), Signal(t_ns, poses)


def _line(n: int) -> np.ndarray:
    return np.column_stack([np.linspace(0, 1, n), np.zeros(n), np.zeros(n)])


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5])
def test_error_along_and_across_a_line_wherever_the_reference_frame_lies(angle: float) -> None:
    commanded = _line(11)
    true = commanded + [5.0, -2.0, 0.5]
    true[4] += [0.003, 0.004, 0.0]  # 5 mm off, 4 mm of them across
    true[8] += [0.0, 0.0, -0.012]
    R = Rotation.from_rotvec([0.0, 0.2 * angle, angle])
    result = PathTracking(PERIOD_NS).add(*_signals(commanded, true, np.ones(11), R))
    error = result["tcp/error"].values
    np.testing.assert_allclose(error[4, :2], [0.005, 0.004], atol=1e-12)
    np.testing.assert_allclose(error[8, :2], [0.012, 0.012], atol=1e-12)
    np.testing.assert_allclose(np.delete(error, [4, 8], axis=0), 0.0, atol=1e-7)
    np.testing.assert_allclose(result["tcp/commanded"].values[:, :3], commanded + [5.0, -2.0, 0.5], atol=1e-12)


def test_orientation_error() -> None:
    pose, segment, truth = _signals(_line(5), _line(5), np.ones(5))
    truth.values[3, :3, :3] = Rotation.from_rotvec([0.0, 0.02, 0.0]).as_matrix()
    error = PathTracking(PERIOD_NS).add(pose, segment, truth)["tcp/error"].values
    np.testing.assert_allclose(error[:, 2], [0, 0, 0, 0.02, 0], atol=1e-9)


def test_a_new_segment_places_the_reference_frame_anew() -> None:
    commanded, true = _line(10), _line(10)
    true[5:] += [0.0, 1.0, 0.0]
    segment = np.repeat([1, 2], 5)
    error = PathTracking(PERIOD_NS).add(*_signals(commanded, true, segment))["tcp/error"].values
    np.testing.assert_allclose(error[:, 0], 0.0, atol=1e-12)


def test_blocks_may_be_cut_anywhere_and_truth_may_come_later() -> None:
    pose, segment, truth = _signals(_line(30), _line(30) * 1.01, np.ones(30))
    whole = PathTracking(PERIOD_NS).add(pose, segment, truth)["tcp/error"]
    tracking, table, begin = PathTracking(PERIOD_NS), SignalTable(), 0
    for start, end, until in ((0, 12, 9), (12, 14, 11), (14, 30, 30)):
        rows = slice(start, end)
        table.add(DecodedBlock(tracking.add(pose.at(rows), segment.at(rows), truth.at(slice(begin, until)))))
        begin = until
    np.testing.assert_array_equal(table["tcp/error"].t_ns, whole.t_ns)
    np.testing.assert_allclose(table["tcp/error"].values, whole.values, atol=1e-12)


def test_references_without_truth_at_their_time_are_not_judged() -> None:
    pose, segment, truth = _signals(_line(20), _line(20), np.ones(20))
    holes = np.r_[0:8, 12:20]
    error = PathTracking(PERIOD_NS).add(pose, segment, truth.at(holes))["tcp/error"]
    assert len(error) == 16


def test_a_whole_run_gives_the_error_that_was_put_in(table: SignalTable) -> None:
    error = table["tcp/error"]
    expected = 0.004 * (error.t_s - error.t_s[0])
    np.testing.assert_allclose(error.values[:, 0], expected, atol=5e-5)  # the wire rounds to 2 µm and 0.1 mrad
    moving = error.t_s > 2.0  # before that the path itself goes up as fast as it goes ahead
    np.testing.assert_allclose(error.values[moving, 1], expected[moving], atol=5e-5)


def test_a_reference_in_the_world_is_not_placed() -> None:
    """With TCP feedback the commanded path is in the world: being beside it from the start is an error."""
    commanded = _line(6)
    true = commanded + [0.0, 0.004, 0.0]
    tracking = PathTracking(PERIOD_NS, world_reference=True)
    error = tracking.add(*_signals(commanded, true, np.ones(6)))["tcp/error"].values
    np.testing.assert_allclose(error[:, 0], 0.004, atol=1e-12)
