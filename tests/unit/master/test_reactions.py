"""What goes wrong with a drive: one event that names it, a phase that shows it, and a way back without a jump."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.bus.interception import Verdict
from drivers.canopen.emcy import EmcyCode
from drivers.cia402.bring_up import MasterTimes
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.phases import AxisPhase, DriveEvent, EventKind, MasterPhase
from drivers.cia402.states import State
from drivers.frame import Frame

MS = 1_000_000
MakeCell = Callable[..., Any]


@pytest.fixture
def moving(cell: Any) -> Any:
    """Enabled, and every joint on its way with 0.1 rad/s."""

    def control(cell: Any) -> Any:
        targets = cell.master.targets()
        if cell.master.phase is MasterPhase.ENABLED:
            targets[2:] += 1e-3
            targets[:2] = 0.5
        return targets, cell.load

    cell.enabled()
    cell.control = control
    cell.run(0.3)
    return cell


def drop(can_id: int, count: int = 1_000_000) -> Callable[[str, Frame], Verdict | None]:
    left = [count]

    def fault(_: str, frame: Frame) -> Verdict | None:
        if frame.can_id == can_id and left[0]:
            left[0] -= 1
            return Verdict(drop=True)
        return None

    return fault


def only_failure(cell: Any, node: int, kind: EventKind) -> DriveEvent:
    (event,) = cell.failures()
    assert (event.node_id, event.kind) == (node, kind)
    assert f"drive {node} (" in event.text
    assert cell.master.phase is MasterPhase.FAULT
    return event  # type: ignore[no-any-return]


def bring_back(cell: Any, seconds: float = 5.0) -> None:
    """Everything stopped, faults reset, enabled again; nothing may jump meanwhile."""
    cell.master.quick_stop()
    cell.run(1.0)
    before = cell.plant.position.copy()
    cell.master.reset_faults()
    cell.run_to(MasterPhase.READY, seconds)
    cell.control = lambda cell: (cell.master.targets(), cell.load)
    cell.master.enable()
    cell.run_to(MasterPhase.ENABLED)
    cell.run(0.3)
    np.testing.assert_allclose(cell.plant.position, before, atol=1e-4)


def test_a_fault_in_motion_is_one_event_with_its_code(moving: Any) -> None:
    moving.plant.engaged = np.arange(10) == 4  # something blocks the shoulder
    moving.run(2.0)
    event = only_failure(moving, 23, EventKind.DRIVE_FAULT)
    assert event.code == 0x8611
    assert "following error" in event.text
    assert [axis.phase for axis in moving.master.axes].count(AxisPhase.ENABLED) == 9
    assert moving.drives[24].state is State.OPERATION_ENABLED  # the planner decides, not the master


def test_fault_reset_and_enabling_from_where_the_axis_is(moving: Any) -> None:
    moving.drives[23].axis._bank.watch[0, 4] = 0.0  # following error window: any error is too much
    moving.run(0.5)
    assert only_failure(moving, 23, EventKind.DRIVE_FAULT).code == 0x8611
    moving.drives[23].node.dictionary.entry(0x6065).store(100_000)
    moving.plant.position[4] -= 0.25
    bring_back(moving)
    assert moving.drives[23].state is State.OPERATION_ENABLED
    assert len(moving.failures()) == 1


def test_a_fault_that_stays_is_not_reset_for_ever(make_cell: MakeCell) -> None:
    cell = make_cell(times=MasterTimes(transition_ns=100 * MS))
    cell.enabled()
    drive = cell.drives[21]
    reset = drive._reset_fault
    drive._reset_fault = lambda: None  # the cause is still there
    drive._fault(EmcyCode.SENSOR, at_once=True)
    cell.run(0.1)
    assert only_failure(cell, 21, EventKind.DRIVE_FAULT).code == 0x7300
    cell.master.reset_faults()
    assert cell.master.phase is MasterPhase.RESETTING
    cell.run(1.0)
    assert [event.kind for event in cell.failures()] == [EventKind.DRIVE_FAULT, EventKind.RESET_FAILED]
    assert cell.master.phase is MasterPhase.FAULT
    drive._reset_fault = reset
    cell.master.reset_faults()  # needs a new rising edge of bit 7
    cell.run_to(MasterPhase.ENABLED)  # the other nine
    assert drive.state is State.SWITCH_ON_DISABLED


def test_a_fault_whose_cause_goes_away_late_gets_another_edge(make_cell: MakeCell) -> None:
    cell = make_cell(times=MasterTimes(transition_ns=100 * MS))
    cell.enabled()
    drive = cell.drives[21]
    reset, edges = drive._reset_fault, []

    def at_the_second_edge() -> None:
        edges.append(cell.clock.now_ns())
        if len(edges) == 2:
            reset()

    drive._reset_fault = at_the_second_edge
    drive._fault(EmcyCode.SENSOR, at_once=True)
    cell.run(0.1)
    cell.master.reset_faults()
    cell.run_to(MasterPhase.ENABLED)  # the other nine
    assert len(edges) == 2
    assert [event.kind for event in cell.failures()] == [EventKind.DRIVE_FAULT]


def test_enabling_a_faulty_drive_is_refused(cell: Any) -> None:
    cell.enabled()
    cell.drives[21]._fault(EmcyCode.SENSOR, at_once=True)
    cell.run(0.05)
    with pytest.raises(RuntimeError, match=r"drive 21 \(tower_rotate\) is FAULT"):
        cell.master.enable()


def test_a_drive_in_fault_at_power_on_is_reported_and_reset(cell: Any) -> None:
    cell.drives[22].power_on()
    cell.drives[22]._fault(EmcyCode.SENSOR, at_once=True)
    cell.power_on(late=[22])
    cell.run(0.5)
    only_failure(cell, 22, EventKind.DRIVE_FAULT)
    cell.master.reset_faults()
    cell.run_to(MasterPhase.READY)


def test_a_drive_that_reboots_in_mid_run(moving: Any) -> None:
    moving.drives[25].node.nmt.reset(whole=True)
    moving.run(0.2)
    only_failure(moving, 25, EventKind.REBOOTED)
    bring_back(moving)
    assert len(moving.failures()) == 1


def test_a_drive_that_loses_power_and_comes_back(moving: Any) -> None:
    moving.drives[25].power_off()
    moving.run(0.13)
    event = only_failure(moving, 25, EventKind.FEEDBACK_LATE)
    assert "11 SYNC" in event.text
    moving.run(1.0)
    assert len(moving.failures()) == 1  # that the heartbeat is lost too is the same outage
    assert len(moving.master.axes[6].causes) == 2
    moving.clock.call_at(moving.clock.now_ns() + 1500 * MS, moving.drives[25].power_on)
    bring_back(moving)


@pytest.mark.parametrize(("lost", "late"), [(10, False), (11, True)])
def test_ten_lost_answers_are_borne_the_next_is_late(moving: Any, lost: int, late: bool) -> None:
    moving.fault = drop(0x180 + 27, lost)
    moving.run(0.2)
    assert bool(moving.failures()) == late
    if late:
        only_failure(moving, 27, EventKind.FEEDBACK_LATE)
        moving.master.quick_stop()
        moving.run(1.0)
        moving.master.reset_faults()
        moving.run_to(MasterPhase.READY)


def test_a_lost_heartbeat_alone_is_a_failure(moving: Any) -> None:
    moving.fault = drop(0x700 + 24)
    moving.run(0.8)
    assert moving.failures() == []  # its feedback speaks for it
    moving.run(0.4)
    only_failure(moving, 24, EventKind.HEARTBEAT_LOST)
    moving.fault = None
    bring_back(moving)


def test_a_drive_that_somebody_takes_out_of_operational(moving: Any) -> None:
    moving.node.line.send(0x000, bytes((128, 26)))
    moving.run(0.3)
    (event,) = moving.failures()
    assert event.node_id == 26
    assert event.kind in (EventKind.FEEDBACK_LATE, EventKind.LEFT_OPERATIONAL)
    bring_back(moving)


def test_a_heartbeat_that_is_not_operational_while_feedback_goes_on(moving: Any) -> None:
    moving.master.on_frame(Frame(0x700 + 26, b"\x04", moving.clock.now_ns()))
    event = only_failure(moving, 26, EventKind.LEFT_OPERATIONAL)
    assert event.code == 4
    assert "stopped" in event.text


def test_a_mapping_that_is_changed_in_mid_run_to_another_length(moving: Any) -> None:
    dictionary = moving.drives[21].node.dictionary
    for index, subindex, value in (
        (0x1800, 1, 0xC000_0195),
        (0x1A00, 0, 0),
        (0x1A00, 0, 2),
        (0x1800, 1, 0x4000_0195),
    ):
        dictionary.entry(index, subindex).store(value)
    moving.run(0.1)
    event = only_failure(moving, 21, EventKind.FEEDBACK_MALFORMED)
    assert "195h with 6 bytes" in event.text
    bring_back(moving)
    assert dictionary.get(0x1A00, 0) == 3


def test_an_emergency_without_a_fault_is_a_warning(moving: Any) -> None:
    moving.drives[28].node.emcy.report(EmcyCode.PROTOCOL)
    moving.run(0.1)
    (event,) = moving.of_kind(EventKind.EMERGENCY)
    assert (event.node_id, event.code) == (28, EmcyCode.PROTOCOL)
    assert moving.failures() == []
    assert moving.master.phase is MasterPhase.ENABLED
    assert moving.master.axes[9].emergencies[-1].register != 0


def test_the_owner_may_stop_all_from_within_the_event(moving: Any) -> None:
    moving.on_event = lambda event: moving.master.quick_stop() if event.kind.is_failure else None
    moving.drives[22].node.nmt.reset(whole=True)
    moving.run(1.0)
    only_failure(moving, 22, EventKind.REBOOTED)
    phases = [axis.phase for axis in moving.master.axes]
    assert phases.count(AxisPhase.READY) == 9
    assert np.abs(moving.plant.velocity).max() < 1e-2


def test_an_axis_given_up_for_late_feedback_is_stopped_with_the_others(moving: Any) -> None:
    moving.fault = drop(0x180 + 27, 11)
    moving.run(0.2)
    only_failure(moving, 27, EventKind.FEEDBACK_LATE)
    assert moving.drives[27].state is State.OPERATION_ENABLED  # it is there again, and holds
    moving.master.quick_stop()
    moving.run(1.0)
    assert {drive.state for drive in moving.drives.values()} == {State.SWITCH_ON_DISABLED}


def test_an_axis_that_fails_while_it_is_enabled_is_not_led_on(cell: Any) -> None:
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    cell.run(0.1)
    cell.master.enable()
    cell.run(0.01)
    cell.master.on_frame(Frame(0x700 + 26, b"\x04", cell.clock.now_ns()))
    cell.wire.clear()
    cell.run(0.5)
    only_failure(cell, 26, EventKind.LEFT_OPERATIONAL)
    assert cell.drives[26].state is State.SWITCH_ON_DISABLED
    requests = [frame for frame in cell.wire if frame.can_id == 0x600 + 26]
    assert len(requests) <= 2  # the one in flight,
    assert requests[-1].data[0] == 0x80  # and its abort


def test_a_dead_master_stops_everything(moving: Any) -> None:
    moving.node.power_off()
    moving.run(1.5)
    assert np.abs(moving.plant.velocity).max() < 1e-2
    assert State.OPERATION_ENABLED not in {drive.state for drive in moving.drives.values()}


def test_a_failure_while_enabling_leaves_no_sequence_behind(cell: Any) -> None:
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    cell.master.enable()
    cell.run(0.065)
    cell.drives[28]._fault(EmcyCode.SENSOR, at_once=True)
    cell.run(0.3)
    only_failure(cell, 28, EventKind.DRIVE_FAULT)
    enabled = [axis for axis in cell.master.axes if axis.phase is AxisPhase.ENABLED]
    assert len(enabled) == 9
    assert not any(axis.follows_planner for axis in enabled)  # they hold until all are there
    cell.run(1.0)
    assert len(cell.failures()) == 1
    cell.master.reset_faults()
    cell.run_to(MasterPhase.ENABLED)  # nine of them; the tenth is ready
    cell.master.enable()
    cell.run_to(MasterPhase.ENABLED)
    assert all(axis.follows_planner for axis in cell.master.axes)


def test_a_drive_that_will_not_be_enabled(make_cell: MakeCell) -> None:
    cell = make_cell(times=MasterTimes(transition_ns=200 * MS), settings=DriveSettings())
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    cell.fault = drop(0x200 + 22)  # it never hears its commands
    cell.master.enable()
    cell.run(0.5)
    event = only_failure(cell, 22, EventKind.ENABLE_FAILED)
    assert "ready to switch on" in event.text
    assert "switch on disabled" in event.text
