"""Lanes of states and the events that follow from frames."""

from __future__ import annotations

import pytest

from drivers.frame import Frame
from logs.decoder import SignalDecoder
from logs.events import Level
from logs.signals import DecodedBlock, SignalTable, StateChange
from logs.states import drive_state, restriction_text
from logs.tape import Block
from stack.messages import Restriction
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS


def _decode(frames: list[Frame]) -> DecodedBlock:
    decoder = SignalDecoder(DEVICES.values(), sync_period_ns=PERIOD_NS, wheel_radius=0.1, track=0.45)
    return decoder.decode(Block(frames, [], []), last=True)


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0250, "switch on disabled"),
        (0x0231, "ready to switch on"),
        (0x1237, "operation enabled"),
        (0x0617, "quick stop active"),
        (0x0218, "fault"),
        (0x021F, "fault reaction active"),
    ],
)
def test_states_of_statuswords_from_manuals(word: int, state: str) -> None:
    assert drive_state(word) == state


def test_lanes_hold_changes_only(table: SignalTable) -> None:
    lane = [(change.t_ns // PERIOD_NS, change.state) for change in table.states if change.lane == "drives/elbow"]
    assert lane == [
        (0, "switch on disabled"),
        (51, "ready to switch on"),
        (56, "switched on"),
        (61, "operation enabled"),
    ]
    phases = [change.state for change in table.states if change.lane == "planner/phase"]
    assert phases == ["enabling", "idle", "executing"]


def test_one_drive_in_fault_shows_in_the_lane_of_all() -> None:
    frames = [Frame(0x080, b"", 0)]
    frames += [Frame(0x180 + n, bytes.fromhex("3712 00000000 0000"), n) for n in (11, 12, *range(21, 29))]
    frames += [Frame(0x080, b"", PERIOD_NS), Frame(0x197, bytes.fromhex("1802 00000000 0000"), PERIOD_NS + 1)]
    block = _decode(frames)
    together = [change.state for change in block.states if change.lane == "drives/all"]
    assert together == ["operation enabled", "fault"]
    assert [(event.level, event.source) for event in block.events if event.level is Level.ERROR] == [
        (Level.ERROR, "shoulder")
    ]


def test_an_emergency_is_an_error_and_its_reset_is_news() -> None:
    # following error 8611h, error register bit 5
    frames = [Frame(0x097, bytes.fromhex("1186 20 0000000000"), 5), Frame(0x097, bytes(8), 9)]
    events = _decode(frames).events
    assert [(event.t_ns, event.level, event.source) for event in events] == [
        (5, Level.ERROR, "shoulder"),
        (9, Level.INFO, "shoulder"),
    ]
    assert "8611h" in events[0].text


def test_a_node_that_falls_silent_is_lost_and_comes_back() -> None:
    ms = 1_000_000
    beats = [Frame(0x702, b"\x05", t * ms) for t in (0, 100, 200, 1000)]
    block = _decode([*beats, Frame(0x080, b"", 1100 * ms)])
    assert block.states == (
        StateChange(0, "nodes/planner", "operational"),
        StateChange(550 * ms, "nodes/planner", "lost"),
        StateChange(1000 * ms, "nodes/planner", "operational"),
    )
    assert [event.level for event in block.events] == [Level.DEBUG, Level.ERROR, Level.DEBUG]


def test_restrictions_in_words() -> None:
    assert restriction_text(0) == "none"
    assert restriction_text(int(Restriction.JOINT_2 | Restriction.JOINT_5 | Restriction.COLLISION)) == (
        "collision, joint 2+5"
    )
