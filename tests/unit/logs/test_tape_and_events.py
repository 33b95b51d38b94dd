"""What the loop pays for, and the lines of events.log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drivers.frame import Frame
from logs.dexterity import Dexterity
from logs.events import Event, EventLog, Level
from logs.signals import Decimation, Signal
from logs.tape import Block, Tape
from stack.kinematics import ArmModel, extended_jacobian
from stack.kinematics.manipulability import manipulability, velocity_ellipsoid
from tests.unit.logs.synthetic_run import Motion


def test_blocks_are_cut_at_syncs_and_lose_nothing() -> None:
    blocks: list[Block] = []
    tape = Tape(blocks.append, block_ns=30)
    frames = [Frame(0x080 if t % 10 == 0 else 0x181, b"", t) for t in range(95)]
    for frame in frames:
        tape.on_frame(frame)
    tape.cut()
    assert [frame for block in blocks for frame in block.frames] == frames
    assert [block.frames[-1].t_ns for block in blocks] == [30, 60, 90, 94]
    assert tape.frame_count == 95


def test_a_block_of_no_length_is_refused() -> None:
    with pytest.raises(ValueError, match="block_ns = 0"):
        Tape(lambda block: None, block_ns=0)


def test_an_event_is_one_line(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "events.log")
    log.write(Event(1_234_567_891, Level.WARN, "planner", "two\nlines"))
    log.close()
    assert (tmp_path / "events.log").read_text() == "    1.234567 WARN  planner        two lines\n"


def test_events_that_cannot_be_written_are_counted() -> None:
    log = EventLog(Path("/dev/full"))
    log.write(Event(0, Level.INFO, "planner", "x"))
    log.close()
    log.write(Event(0, Level.INFO, "planner", "x"))
    assert log.lost >= 2


def test_decimation_does_not_depend_on_where_blocks_end() -> None:
    t_ns = np.arange(0, 1_000_000_000, 10_000_000, dtype=np.int64)
    whole = t_ns[Decimation(20.0).due(t_ns)]
    decimation = Decimation(20.0)
    parts = [part[decimation.due(part)] for part in np.split(t_ns, [7, 8, 33])]
    assert np.concatenate(parts).tolist() == whole.tolist() == list(range(0, 1_000_000_000, 50_000_000))


def test_dexterity_is_that_of_the_kinematics(run: Motion) -> None:
    arm, truth = ArmModel.load("moma8"), run.truths[200]
    at = np.array([truth.t_ns])
    signals = Dexterity(arm).add(Signal(at, truth.q[None]), Signal(at, truth.pose_WE[None]))
    values = signals["manipulability"].values[0]
    assert values[0] == pytest.approx(manipulability(arm.jacobian(truth.q)))
    assert values[1] == pytest.approx(manipulability(extended_jacobian(arm, truth.q)))
    assert values[2] == pytest.approx(manipulability(arm.wrist_jacobian(truth.q)))
    in_world = truth.pose_WE[:3, :3] @ arm.end_point_jacobian(truth.q)[:3]
    expected = velocity_ellipsoid(in_world, truth.pose_WE[:3, 3])
    drawn = signals["ellipsoid/arm"].values[0]
    np.testing.assert_allclose(drawn[:6], np.append(expected.centre, expected.half_sizes))
    axes = _matrix(drawn[6:])
    np.testing.assert_allclose(axes @ np.diag(drawn[3:6] ** 2) @ axes.T, in_world @ in_world.T, atol=1e-9)


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(quaternion).as_matrix()
