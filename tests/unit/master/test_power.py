"""The sequences of the power state machine, step by step, from the frames that a drive sends: what they command and what they wait for."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from drivers.canopen.sdo_abort import StepError
from drivers.canopen.sequence import Sequence, Until
from drivers.catalogue import devices
from drivers.cia402.axis import AxisClient
from drivers.cia402.power import Controlword, clear_fault, disable, enable, quick_stop

MS = 1_000_000
ENABLED, STOPPING, OFF, FAULT, REACTING = 0x1637, 0x1617, 0x1650, 0x1618, 0x161F
"""Statuswords: bits 0 to 3, 5 and 6 are the state (CiA 402-2), 4 voltage, 9 remote, 10 and 12 whatever."""
STANDSTILL = 50


class Talk:
    """A drive that says its statusword and position every 10 ms to one sequence."""

    def __init__(self) -> None:
        self.axis = AxisClient(devices()[25], timeout_ns=1000 * MS)
        self.t_ns = 0
        self.says(ENABLED)

    def says(self, word: int, position: int = 0, periods: int = 1) -> None:
        for _ in range(periods):
            self.t_ns += 10 * MS
            self.axis.take_feedback(struct.pack("<Hih", word, position, 0), self.t_ns)


def waits(steps: Sequence[object]) -> Until:
    """What a sequence waits for now."""
    found = next(steps)
    assert isinstance(found, Until)
    return found


def end_of(steps: Sequence[object]) -> object:
    with pytest.raises(StopIteration) as ended:
        next(steps)
    return ended.value.value


def stopping(talk: Talk, *, stays: bool) -> tuple[Sequence[bool], Until]:
    """Up to the wait for standstill; the axis has last been at 1000."""
    steps = quick_stop(talk.axis, 100 * MS, STANDSTILL, stays)
    begun = waits(steps)
    assert talk.axis.controlword == 0x02
    assert not begun.predicate()
    talk.says(STOPPING, 1000)
    assert begun.predicate()
    return steps, waits(steps)


def test_standing_is_fifty_milliseconds_without_more_than_the_bound_from_sync_to_sync() -> None:
    talk = Talk()
    steps, standing = stopping(talk, stays=True)
    assert standing.what == "standstill"
    for position in (1000 + STANDSTILL + 1, 1000):
        talk.says(STOPPING, position)
        assert not standing.predicate()
    assert standing.came() == f"quick stop active (statusword 1617h), {-STANDSTILL - 1} position units per SYNC"
    for position in (1000 + STANDSTILL, 1000, 1000 + STANDSTILL, 1000):
        talk.says(STOPPING, position)
        assert not standing.predicate(), "40 ms are not enough"
    talk.says(STOPPING, 1000)
    assert standing.predicate()
    assert end_of(steps) is True


@pytest.mark.parametrize("stays", [True, False])
def test_a_drive_that_switches_off_has_stopped_without_torque(stays: bool) -> None:
    talk = Talk()
    steps, standing = stopping(talk, stays=stays)
    if not stays:
        assert standing.what == "switch on disabled"
        talk.says(STOPPING, 1000, periods=10)
        assert not standing.predicate(), "it stands, and is not off"
    talk.says(OFF, 1000)
    assert standing.predicate()
    assert end_of(steps) is False


@pytest.mark.parametrize("stays", [True, False])
def test_a_fault_on_the_way_is_no_standstill(stays: bool) -> None:
    talk = Talk()
    _, standing = stopping(talk, stays=stays)
    talk.says(FAULT, 1000, periods=10)
    assert not standing.predicate()


def test_a_fault_is_reset_by_an_edge_after_two_commands_without_it_three_times_at_most() -> None:
    talk = Talk()
    talk.says(REACTING)
    steps = clear_fault(talk.axis, 100 * MS, 1000 * MS)
    ended = waits(steps)
    assert not ended.predicate()
    talk.says(FAULT)
    assert ended.predicate()
    gone = None
    for _ in range(3):
        low = waits(steps) if gone is None else steps.throw(StepError("fault to be gone", "fault"))
        assert isinstance(low, Until)
        assert talk.axis.controlword == 0x00
        talk.axis.sent += 1
        assert not low.predicate()
        talk.axis.sent += 1
        assert low.predicate()
        gone = waits(steps)
        assert talk.axis.controlword == 0x80
        assert not gone.predicate()
    with pytest.raises(StepError):
        steps.throw(StepError("fault to be gone", "fault"))


def test_after_the_reset_nothing_is_commanded_any_more() -> None:
    talk = Talk()
    talk.says(FAULT)
    steps = clear_fault(talk.axis, 100 * MS, 1000 * MS)
    assert waits(steps).predicate()
    waits(steps)
    gone = waits(steps)
    talk.says(OFF)
    assert gone.predicate()
    assert end_of(steps) is None
    assert talk.axis.controlword == 0x00


def without_pdos() -> Talk:
    """Nothing of it has to be verified before it is enabled."""
    talk = Talk()
    talk.axis.device = replace(talk.axis.device, pdos=())
    return talk


def test_enabling_goes_on_from_a_quick_stop_where_the_drive_lets_it() -> None:
    talk = without_pdos()
    talk.says(STOPPING)
    steps = enable(talk.axis, 100 * MS)
    left = waits(steps)
    assert talk.axis.controlword == 0x0F
    assert not left.predicate()
    talk.says(ENABLED)
    assert left.predicate()
    assert end_of(steps) is None


def test_else_it_goes_the_long_way_each_step_confirmed() -> None:
    talk = without_pdos()
    talk.says(STOPPING)
    steps = enable(talk.axis, 100 * MS)
    waits(steps)
    off = steps.throw(StepError("to leave quick stop active", "nothing"))
    assert isinstance(off, Until)
    assert (talk.axis.controlword, off.predicate()) == (0x00, False)
    talk.says(OFF)
    assert off.predicate()
    for command, word in ((0x06, 0x1631), (0x07, 0x1633), (0x0F, ENABLED)):
        step = waits(steps)
        assert (talk.axis.controlword, step.predicate()) == (command, False)
        talk.says(word)
        assert step.predicate()
    assert end_of(steps) is None


def test_a_fault_ends_the_way_up_and_says_so() -> None:
    talk = without_pdos()
    talk.says(OFF)
    steps = enable(talk.axis, 100 * MS)
    step = waits(steps)
    talk.says(FAULT)
    assert step.predicate()
    with pytest.raises(StepError, match="ready to switch on"):
        next(steps)


def test_a_drive_that_is_not_on_the_way_is_waited_for() -> None:
    talk = Talk()
    talk.says(0x1600)  # not ready to switch on
    steps = disable(talk.axis, 100 * MS)
    ready = waits(steps)
    assert ready.what == "a state on the way to switch on disabled"
    assert not ready.predicate()
    talk.says(0x1633)
    assert ready.predicate()
    step = waits(steps)
    assert talk.axis.controlword == 0x06
    talk.says(0x1631)
    assert step.predicate()
    waits(steps)
    assert talk.axis.controlword == 0x00
    talk.says(OFF)
    assert end_of(steps) is None
    assert talk.axis.controlword == 0x00


def test_a_drive_that_was_never_heard_is_shown_as_that() -> None:
    axis = AxisClient(devices()[25], timeout_ns=MS)
    begun = waits(quick_stop(axis, MS, 1, stays=True))
    assert begun.came() == "no statusword"


def test_commands_of_the_state_machine() -> None:
    """CiA 402-2: bits 7 and 3 to 0 of the controlword; the others stay 0."""
    assert {word.name: int(word) for word in Controlword} == {
        "DISABLE_VOLTAGE": 0x00,
        "QUICK_STOP": 0x02,
        "SHUTDOWN": 0x06,
        "SWITCH_ON": 0x07,
        "ENABLE_OPERATION": 0x0F,
        "FAULT_RESET": 0x80,
    }
