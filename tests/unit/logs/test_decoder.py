"""Frames and truth in, signals out: the values that were sent come back, at the time that they mean."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.frame import Frame, bit_length
from logs.decoder import SignalDecoder
from logs.signals import SignalTable
from logs.tape import Block
from tests.unit.logs.synthetic_run import DEVICES, MOTION_STARTS, PERIOD_NS, Motion, Wire

T0 = 52_000  # the end of a SYNC frame on the wire


def _decoder() -> SignalDecoder:
    return SignalDecoder(DEVICES.values(), sync_period_ns=PERIOD_NS, wheel_radius=0.1, track=0.45)


def _frames(run: Motion, cycles: range) -> list[Frame]:
    wire = Wire(run)
    return [frame for k in cycles for frame in wire.cycle(k)]


def _table(frames: list[Frame], cuts: tuple[int, ...] = ()) -> SignalTable:
    decoder, table = _decoder(), SignalTable()
    edges = [0, *sorted(cuts), len(frames)]
    for i, (start, end) in enumerate(pairwise(edges)):
        table.add(decoder.decode(Block(frames[start:end], [], []), last=i == len(edges) - 2))
    return table


def test_joint_positions_are_those_of_the_truth_at_that_sync(run: Motion, table: SignalTable) -> None:
    actual = table["joints/position/actual"]
    assert actual.t_ns.tolist() == [k * PERIOD_NS + T0 for k in range(len(run.truths))]
    np.testing.assert_allclose(actual.values, [truth.q for truth in run.truths], atol=6e-7)


def test_targets_stand_at_the_time_at_which_they_are_reached(run: Motion, table: SignalTable) -> None:
    target = table["joints/position/target"]
    assert target.t_ns[0] == 2 * PERIOD_NS + T0
    np.testing.assert_allclose(target.values[200], run.truths[202].q, atol=6e-7)
    assert target.t_ns[200] == 202 * PERIOD_NS + T0


def test_efforts_are_newton_metres(run: Motion, table: SignalTable) -> None:
    counts = [DEVICES[node].object(0x6076).default * 1e-6 for node in range(21, 29)]  # N·m per per mille
    error = np.abs(table["joints/effort"].values[50] - run.truths[50].effort)
    assert np.all(error <= np.array(counts, float) * 0.51)


def test_platform_velocity_commanded_by_encoders_and_true_agree_without_slip(run: Motion, table: SignalTable) -> None:
    true = np.array([truth.base_twist for truth in run.truths])
    np.testing.assert_allclose(table["platform/velocity/commanded"].values[:-2], true[2:], atol=5e-6)
    np.testing.assert_allclose(table["platform/velocity/encoder"].values[1:], true[2:], atol=3e-4)


def test_cycles_that_were_late_together_have_no_velocity_between_them(run: Motion) -> None:
    """In real time two SYNCs can be heard at one time: a warning would fail this test. In one block and in two."""
    in_time = _frames(run, range(4))
    third = in_time.index(_frames(run, range(2, 3))[0])
    frames = [frame._replace(t_ns=min(frame.t_ns, in_time[third].t_ns)) for frame in in_time]
    for cuts in ((), (third + 1,)):
        velocity = _table(frames, cuts)["platform/velocity/encoder"]
        assert len(velocity) == 2
        assert np.all(np.isfinite(velocity.values))


def test_references_are_for_two_cycles_later_and_only_the_valid_ones(table: SignalTable) -> None:
    pose = table["reference/pose"]
    assert pose.t_ns[0] == (MOTION_STARTS + 2) * PERIOD_NS + T0
    assert np.allclose(pose.values[0], 0.0, atol=1e-4)  # R is where the motion starts
    assert set(table["reference/segment"].values.ravel()) == {1.0}


def test_plain_messages(run: Motion, table: SignalTable) -> None:
    np.testing.assert_allclose(table["twist/linear"].values[-1], [0.12, 0.0, 0.0])
    assert table["mission"].values[-1].tolist() == [4.0, 1.0]
    np.testing.assert_allclose(table["wrench/force"].values[200], run.truths[200].contact_wrench[:3], atol=0.006)
    tracker = table["tracker/position"]
    np.testing.assert_allclose(tracker.values[50], run.truths[100].pose_WE[:3, 3] + 4e-4, atol=1.1e-6)
    np.testing.assert_allclose(table["tracker/age"].values, 0.02)


def test_truth_is_kept_as_it_is(run: Motion, table: SignalTable) -> None:
    np.testing.assert_array_equal(table["truth/pose_WE"].values[7], run.truths[7].pose_WE)


def test_bus_load_is_the_sum_of_all_bits(run: Motion) -> None:
    frames = _frames(run, range(40))
    load = _table(frames)["bus/load"]
    in_window = [f for f in frames if f.t_ns < 100_000_000]
    assert load.t_ns[0] == 100_000_000
    assert load.values[0, 0] == pytest.approx(sum(bit_length(f.can_id, f.data) for f in in_window) / 100_000)


@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(0, 1200), max_size=4))
def test_it_does_not_matter_where_blocks_are_cut(run: Motion, cuts: list[int]) -> None:
    frames = _frames(run, range(MOTION_STARTS - 5, MOTION_STARTS + 30))
    whole = _table(frames)
    cut = _table(frames, tuple(min(c, len(frames)) for c in cuts))
    assert cut.names() == whole.names()
    for name in whole.names():
        np.testing.assert_array_equal(cut[name].t_ns, whole[name].t_ns, err_msg=name)
        np.testing.assert_array_equal(cut[name].values, whole[name].values, err_msg=name)
    assert (cut.states, cut.events, cut.counts) == (whole.states, whole.events, whole.counts)


def test_a_lost_feedback_is_missing_not_zero(run: Motion) -> None:
    frames = _frames(run, range(20))
    kept = [f for f in frames if not (f.can_id == 0x197 and 50_000_000 < f.t_ns < 60_000_000)]
    values = _table(kept)["joints/position/actual"].values
    assert np.argwhere(np.isnan(values)).tolist() == [[5, 2]]


def test_a_damaged_reference_is_left_out_and_counted(run: Motion) -> None:
    frames = _frames(run, range(MOTION_STARTS, MOTION_STARTS + 10))
    row = next(i for i, f in enumerate(frames) if f.can_id == 0x382 and i > 100)
    frames[row] = frames[row]._replace(data=b"\xff" + frames[row].data[1:])
    table = _table(frames)
    assert len(table["reference/pose"]) == 9
    assert table.counts == {"bad_checksums": 1, "torn_references": 1}


def test_a_reference_that_comes_a_cycle_late_keeps_its_time(run: Motion) -> None:
    frames = _frames(run, range(MOTION_STARTS, MOTION_STARTS + 10))
    late = {0x282, 0x382, 0x482}
    moved = [f for f in frames if f.can_id in late and f.t_ns // PERIOD_NS == MOTION_STARTS + 9]
    early = [f for f in frames if not (f.can_id in late and f.t_ns // PERIOD_NS >= MOTION_STARTS + 8)]
    skipped = [*early, *(Frame(0x080, b"", (MOTION_STARTS + 10) * PERIOD_NS + T0), *moved)]
    pose = _table(skipped)["reference/pose"]
    assert pose.t_ns[-1] == (MOTION_STARTS + 11) * PERIOD_NS + T0


def test_a_planner_that_counts_anew_is_followed(run: Motion) -> None:
    first = _frames(run, range(MOTION_STARTS, MOTION_STARTS + 10))
    again = [f._replace(t_ns=f.t_ns + 100 * PERIOD_NS) for f in first]
    syncs = [Frame(0x080, b"", (MOTION_STARTS + k) * PERIOD_NS + T0) for k in range(10, 100)]
    pose = _table([*first, *syncs, *again])["reference/pose"]
    assert pose.t_ns[-1] == (MOTION_STARTS + 111) * PERIOD_NS + T0


def test_a_bus_without_sync_still_gives_what_needs_none(run: Motion) -> None:
    frames = [f for f in _frames(run, range(20)) if f.can_id != 0x080]
    table = _table(frames)
    assert "twist/linear" in table
    assert "joints/position/actual" not in table


def test_an_unknown_signal_names_the_nearest(table: SignalTable) -> None:
    with pytest.raises(KeyError, match="joints/effort"):
        table["joints/efort"]
