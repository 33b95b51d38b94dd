"""The gate: every rule by the frames that it lets pass and refuses; and that no line or branch of it goes untried."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers import gate as gate_module
from drivers.gate import (
    CounterGate,
    FeedbackGate,
    FrameGate,
    Reason,
    SetPointGate,
    SetPointLimits,
    limit,
    limit_change,
    wrapped,
)

MS = 1_000_000
PERIOD = 10 * MS
LIMITS = SetPointLimits(-2_000_000, 2_000_000, 45_000, 4_500, 2000, 1000, PERIOD)
LOOSE = SetPointLimits(-(1 << 31), (1 << 31) - 1, None, None, 2000, 1000, PERIOD)


def frame(target: int, offset: int = 0, word: int = 0x0F) -> bytes:
    return struct.pack("<Hih", word, target, offset)


def target_of(data: bytes | None) -> tuple[int, int]:
    assert data is not None
    _, target, offset = struct.unpack("<Hih", data)
    return target, offset


class Stream:
    """A gate that hears a SYNC every period and a frame 3 ms after it."""

    def __init__(self, limits: SetPointLimits = LIMITS, begin: int = 0) -> None:
        self.gate = SetPointGate(limits)
        self.t_ns = 0
        self.gate.on_sync(0)
        self.gate.seed(begin, 0)

    def next(self, data: bytes, periods: int = 1, heard: bool = True) -> tuple[bytes | None, Reason | None]:
        self.t_ns += periods * PERIOD
        if heard:
            self.gate.on_sync(self.t_ns)
        return self.gate.judge(data, True, self.t_ns + 3 * MS)


@given(st.integers(-(10**12), 10**12), st.integers(-(10**6), 10**6), st.integers(0, 10**6))
def test_a_limited_value_is_inside_and_as_near_as_can_be(value: int, lower: int, span: int) -> None:
    limited, was = limit(value, lower, lower + span)
    assert lower <= limited <= lower + span
    assert was == (limited != value)
    assert limit_change(value, lower, span) == limit(value, lower - span, lower + span)


@pytest.mark.parametrize(
    ("value", "expected"), [(9, (9, False)), (10, (10, False)), (11, (10, True)), (-11, (-10, True))]
)
def test_bounds_belong_to_what_is_allowed(value: int, expected: tuple[int, bool]) -> None:
    assert limit(value, -10, 10) == expected


def test_differences_go_the_short_way_round() -> None:
    assert wrapped(5) == 5
    assert wrapped(-5) == -5
    assert wrapped((1 << 32) - 7) == -7
    assert wrapped(1 << 31) == -(1 << 31)


def test_a_smooth_motion_passes_as_it_is() -> None:
    stream = Stream()
    for k in range(1, 50):
        data = frame(100 * k * k, 5 * k)
        assert stream.next(data) == (data, None)
    assert stream.gate.counts.refused == 0


@pytest.mark.parametrize("length", [0, 7])
def test_another_length_is_refused(length: int) -> None:
    gate = SetPointGate(LIMITS)
    assert gate.judge(bytes(length), True, 0) == (None, Reason.LENGTH)


def test_a_jump_is_refused_and_the_one_that_goes_on_from_before_passes() -> None:
    stream = Stream()
    assert stream.next(frame(45_001)) == (None, Reason.JUMP)
    assert stream.next(frame(-45_001 * 2 - 1)) == (None, Reason.JUMP)
    assert stream.gate.counts.by_reason[Reason.JUMP] == 2
    assert stream.next(frame(2_000))[1] is None


def test_what_was_missed_may_be_made_up_for() -> None:
    stream = Stream()
    assert stream.next(frame(45_000 * 3), periods=3)[0] is not None  # two SYNCs got lost
    stream = Stream()
    assert stream.next(frame(90_001)) == (None, Reason.JUMP)
    assert stream.next(frame(90_000))[0] is not None  # the refused one counts as missed
    assert stream.next(frame(90_000 + 45_001)) == (None, Reason.JUMP)


def test_a_stop_always_passes() -> None:
    stream = Stream()
    assert stream.next(frame(0))[1] is None
    for word in (0x00, 0x02, 0x06, 0x07, 0x0B, 0x0D, 0x80, 0x87):
        data = frame(1_900_000, 30_000, word)
        assert stream.gate.judge(data, True, stream.t_ns + 4 * MS) == (data, None)


def test_a_fault_reset_in_an_enabling_command_opens_nothing() -> None:
    """An enabled drive takes no notice of bit 7: it goes on following."""
    stream = Stream()
    stream.next(frame(0))
    assert stream.next(frame(500_000, word=0x8F)) == (None, Reason.JUMP)


def test_what_a_stop_says_besides_is_not_where_it_goes_on_from() -> None:
    stream = Stream()
    stream.next(frame(0))
    stream.next(frame(500_000, 2000, word=0x07))
    assert stream.next(frame(500_000)) == (None, Reason.JUMP)
    assert target_of(stream.next(frame(1_000, 2000))[0]) == (1_000, 2000)


def test_after_a_late_sync_one_frame_takes_its_place_and_not_one_after_the_other() -> None:
    stream = Stream()
    stream.next(frame(0))
    late_ns = stream.t_ns + 13 * MS
    assert stream.gate.judge(frame(40_000), True, late_ns)[1] is None
    assert stream.gate.judge(frame(80_000), True, late_ns + MS) == (None, Reason.RATE)
    assert stream.gate.judge(frame(80_000), True, late_ns + PERIOD)[1] is None
    assert stream.gate.judge(frame(120_000), True, late_ns + PERIOD + MS) == (None, Reason.RATE)


def test_after_a_stop_an_enabling_frame_of_the_same_period_is_a_beginning() -> None:
    stream = Stream()
    stream.next(frame(0))
    stream.gate.judge(frame(500, 0, 0x07), True, stream.t_ns + 4 * MS)
    assert stream.gate.judge(frame(600), True, stream.t_ns + 5 * MS)[1] is None


def test_an_axis_that_does_not_follow_may_be_told_anything_and_that_is_where_it_begins() -> None:
    gate = SetPointGate(LIMITS)
    gate.on_sync(0)
    data = frame(1_500_000)
    assert gate.judge(data, False, MS) == (data, None)
    assert gate.judge(frame(1_500_001), True, 2 * MS) == (None, Reason.RATE)
    gate.on_sync(PERIOD)
    assert gate.judge(frame(1_501_000), True, PERIOD + MS)[1] is None


def test_one_set_point_in_a_period_the_first() -> None:
    stream = Stream()
    data = frame(1_000)
    assert stream.next(data) == (data, None)
    assert stream.gate.judge(data, True, stream.t_ns + 4 * MS) == (data, None)  # twice the same is one
    assert stream.gate.judge(frame(1_001), True, stream.t_ns + 4 * MS) == (None, Reason.RATE)
    assert stream.next(frame(2_000))[1] is None


def test_the_same_twice_in_a_period_passes_twice_as_it_was_limited() -> None:
    stream = Stream(begin=1_999_000)
    data = frame(2_000_500, 9_999)
    first = stream.next(data)
    assert first == (frame(2_000_000, 1000), Reason.LIMITED)
    assert stream.gate.judge(data, True, stream.t_ns + 4 * MS) == (first[0], None)
    stopped = frame(2_000_500, 9_999, word=0x0B)
    assert stream.gate.judge(stopped, True, stream.t_ns + 5 * MS) == (stopped, None)
    assert stream.next(frame(2_000_500, 9_999)) == (frame(2_000_000, 2000), Reason.LIMITED)


def test_a_second_one_passes_where_a_sync_got_lost() -> None:
    stream = Stream()
    stream.next(frame(1_000))
    passed, reason = stream.next(frame(46_001 * 2 - 3_000), heard=False)
    assert reason is None
    assert passed is not None
    gate = SetPointGate(LIMITS)  # before any SYNC nobody knows
    gate.judge(frame(0), True, 0)
    assert gate.judge(frame(1), True, 10 * PERIOD) == (None, Reason.RATE)


def test_positions_torques_and_their_changes_are_limited() -> None:
    stream = Stream(begin=1_999_000)
    assert target_of(stream.next(frame(2_000_500))[0]) == (2_000_000, 0)
    assert target_of(stream.next(frame(2_000_000, 1_200))[0]) == (2_000_000, 1000)
    assert target_of(stream.next(frame(2_000_000, 9_999))[0]) == (2_000_000, 2000)
    assert stream.next(frame(2_000_000, -9_999))[1] is Reason.LIMITED
    assert stream.gate.counts.by_reason[Reason.LIMITED] == 4
    assert stream.gate.counts.refused == 0


def test_limits_hold_however_fast_it_comes_to_them() -> None:
    stream = Stream(begin=1_960_000)
    assert [target_of(stream.next(frame(target))[0])[0] for target in (1_980_000, 2_000_000, 2_000_000, 2_000_000)] == [
        1_980_000,
        2_000_000,
        2_000_000,
        2_000_000,
    ]
    stream.next(frame(2_000_000, 9_999, word=0x0B))  # a stop says what it likes
    assert target_of(stream.next(frame(2_000_000, 9_999))[0]) == (2_000_000, 2000)


def test_acceleration_is_limited_once_a_velocity_is_known() -> None:
    stream = Stream()
    assert stream.next(frame(5_000))[1] is None  # no velocity before it
    assert target_of(stream.next(frame(20_000))[0]) == (14_500, 0)
    assert target_of(stream.next(frame(14_500), periods=2)[0]) == (14_500, 0)  # over a gap nothing is known of it
    assert stream.next(frame(19_000))[1] is None
    assert target_of(stream.next(frame(19_000))[0]) == (19_000, 0)


def test_without_a_limit_targets_may_jump_and_bend() -> None:
    stream = Stream(LOOSE)
    for target in (0, 1_999_999_999, -1_999_999_999):
        assert stream.next(frame(target))[1] is None


def test_a_position_that_turns_on_past_32_bits_has_not_jumped() -> None:
    stream = Stream(SetPointLimits(-(1 << 31), (1 << 31) - 1, 45_000, None, 2000, 1000, PERIOD), begin=(1 << 31) - 100)
    assert stream.next(frame(-(1 << 31) + 100))[1] is None


def test_counters_each_once_none_after_a_later_one() -> None:
    gate = CounterGate(200 * MS)
    assert [gate.judge(c, t * MS) for t, c in ((0, 250), (10, 251), (20, 251), (30, 255), (40, 0), (50, 254), (60, 1))] == [
        None, None, Reason.STALE, None, None, Reason.BEHIND, None,
    ]  # fmt: skip
    assert gate.lost == 3
    assert gate.counts.refused == 2


def test_a_sender_that_counts_anew_is_believed_after_three() -> None:
    gate = CounterGate(200 * MS)
    gate.judge(100, 0)
    assert [gate.judge(c, (10 + c) * MS) for c in range(1, 6)] == [Reason.BEHIND] * 3 + [None, None]
    assert gate.lost == 0


def test_after_a_silence_any_counter_is_a_beginning() -> None:
    gate = CounterGate(200 * MS)
    gate.judge(7, 0)
    assert gate.judge(7, 200 * MS) is Reason.STALE
    assert gate.judge(7, 201 * MS) is None
    assert gate.judge(3, 402 * MS) is None
    assert gate.judge(9, 700 * MS) is None
    assert gate.lost == 0


def test_the_silence_is_that_since_the_last_message() -> None:
    gate = CounterGate(200 * MS)
    for t_ms, counter in ((0, 7), (150, 8)):
        assert gate.judge(counter, t_ms * MS) is None
    assert gate.judge(8, 300 * MS) is Reason.STALE


def test_the_first_sync_counts_as_one_period_and_a_lost_one_as_one_more() -> None:
    gate = SetPointGate(LIMITS)
    gate.on_sync(0)
    assert gate.judge(frame(45_001), True, MS) == (None, Reason.JUMP)
    stream = Stream()
    stream.next(frame(0))
    assert stream.next(frame(90_001), heard=False) == (None, Reason.JUMP)
    assert stream.gate.judge(frame(90_000), True, stream.t_ns + 4 * MS)[1] is None


def test_half_the_circle_is_where_ahead_becomes_behind() -> None:
    gate = CounterGate(200 * MS)
    gate.judge(0, 0)
    assert gate.judge(128, MS) is Reason.BEHIND
    assert gate.judge(127, 2 * MS) is None
    assert gate.lost == 126


def test_a_position_that_nobody_can_have_got_to_is_left_out_three_times() -> None:
    gate = FeedbackGate(1_000, PERIOD)
    assert gate.judge(5_000_000, 0) is None
    assert gate.judge(5_001_000, PERIOD) is None
    assert gate.judge(5_002_001, 2 * PERIOD) is Reason.JUMP
    assert gate.judge(5_003_000, 3 * PERIOD) is None  # two periods since the last one
    far = [gate.judge(0, (4 + k) * PERIOD) for k in range(4)]
    assert far == [Reason.JUMP] * 3 + [None]
    assert gate.judge(900, 7 * PERIOD + 1) is None  # the same period still counts as one
    assert gate.counts.refused == 4


def test_a_firewall_of_identifiers_lengths_and_rates() -> None:
    gate = FrameGate({0x215: 8, 0x080: 0}, most=2)
    assert gate.judge(0x080, b"") is None
    assert gate.judge(0x216, bytes(8)) is Reason.UNKNOWN
    assert gate.judge(0x215, bytes(7)) is Reason.LENGTH
    assert [gate.judge(0x215, bytes(8)) for _ in range(3)] == [None, None, Reason.RATE]
    gate.on_sync()
    assert gate.judge(0x215, bytes(8)) is None
    assert gate.counts.refused == 3


@given(st.lists(st.tuples(st.binary(min_size=8, max_size=8), st.booleans(), st.integers(0, 4)), max_size=60))
def test_nothing_gets_through_that_is_outside_its_limits(stream: list[tuple[bytes, bool, int]]) -> None:
    gate, t_ns = SetPointGate(LIMITS), 0
    for data, sync, gap in stream:
        t_ns += gap * 4 * MS
        if sync:
            gate.on_sync(t_ns)
        passed, _ = gate.judge(data, True, t_ns)
        if passed is not None:
            assert gate.judge(data, True, t_ns) == (passed, None), "the same once more"
        word = struct.unpack_from("<H", data)[0]
        stops = word & 0x0F != 0x0F
        if stops:
            assert passed == data
        elif passed is not None:
            target, offset = target_of(passed)
            assert -2_000_000 <= target <= 2_000_000
            assert abs(offset) <= 2000


@pytest.mark.slow
def test_no_line_and_no_branch_of_the_gate_goes_untried(tmp_path: Path) -> None:
    """This file, run by itself under measurement."""
    import subprocess
    import sys

    source = Path(gate_module.__file__)
    data = tmp_path / "coverage"
    command = [
        sys.executable,
        "-m",
        "coverage",
        "run",
        "--branch",
        f"--data-file={data}",
        f"--include={source}",
        "-m",
        "pytest",
    ]
    subprocess.run(
        [*command, "-q", "-p", "no:cacheprovider", "-k", "not untried", __file__], check=True, capture_output=True
    )
    report = [sys.executable, "-m", "coverage", "report", f"--data-file={data}", "--show-missing", "--fail-under=100"]
    done = subprocess.run(report, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_numbers_that_stand_on_the_wire_and_in_the_documentation() -> None:
    """Reasons go into the emergency message FF01h; margins are those of docs/faults.md."""
    assert [(reason.name, int(reason)) for reason in Reason] == [
        ("LENGTH", 1),
        ("RATE", 2),
        ("JUMP", 3),
        ("LIMITED", 4),
        ("STALE", 5),
        ("BEHIND", 6),
        ("UNKNOWN", 7),
    ]
    assert (gate_module.JUMP_MARGIN, gate_module.ACCELERATION_MARGIN, gate_module.OFFSET_SHARE) == (3.0, 1.5, 0.5)


def test_limits_cannot_be_changed_behind_the_back_of_the_gate() -> None:
    with pytest.raises(AttributeError):
        LIMITS.jump = 1  # type: ignore[misc]


def test_a_message_half_the_counters_ahead_counts_no_loss() -> None:
    """At 128 nobody can say whether it is ahead or behind: after three refusals it is a new beginning, not 127 losses."""
    gate = CounterGate(1000 * MS)
    assert gate.judge(0, 0) is None
    answers = [gate.judge(128, (i + 1) * MS) for i in range(4)]
    assert answers == [Reason.BEHIND] * 3 + [None]
    assert gate.lost == 0
