"""Nobody commands any more: every way to lose a master ends in a stop with bounded deceleration."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest

from drivers.cia402.states import State
from drivers.objects import Value
from stack.servo.state import AxisMode
from tests.unit.cia402.rig import MS, SYNC_NS, Master, Rig

JOINT, WHEEL = 25, 12


def moving(*node_ids: int, defaults: dict[tuple[int, int], Value] | None = None) -> tuple[Rig, Master]:
    rig = Rig(*node_ids, defaults=defaults)
    master = Master(rig)
    master.sends_heartbeat = True
    master.enable()
    master.move(500_000)
    rig.run(400 * MS)
    assert rig.plant.velocity == pytest.approx(0.5, rel=0.03)
    rig.plant.peak_acceleration[:] = 0.0
    rig.velocities.clear()
    return rig, master


def die(master: Master) -> None:
    master.alive = False


def lose_rpdo(master: Master) -> None:
    master.sends_rpdo = False


def lose_nmt(master: Master) -> None:
    master.port.send(0x000, b"\x80\x00")


def stop_nmt(master: Master) -> None:
    master.port.send(0x000, b"\x02\x00")


@pytest.mark.parametrize("loss", [die, lose_rpdo, lose_nmt, stop_nmt])
def test_stops_within_three_periods_and_the_quick_stop_ramp(loss: Callable[[Master], None]) -> None:
    rig, master = moving(JOINT, WHEEL)
    loss(master)
    rig.run(3 * SYNC_NS + 11 * MS)  # the last set point came up to a period ago
    assert rig.plant.velocity[0] < 0.45  # brakes
    rig.run(8 * SYNC_NS)
    states = {drive.state for drive in rig.drives.values()}
    assert states <= {State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED}
    rig.run(round(0.5 / 12.0 * 1e9) + 20 * MS)
    assert np.abs(rig.plant.velocity) == pytest.approx(0.0, abs=0.02)
    rig.run(300 * MS)
    assert {drive.state for drive in rig.drives.values()} == {State.SWITCH_ON_DISABLED}
    assert rig.plant.peak_acceleration[0] < 1.3 * 12.0
    assert np.all(rig.bank.mode == AxisMode.OFF)


def test_lost_set_points_are_told_as_8250_and_a_returning_master_resolves_it() -> None:
    rig, master = moving(JOINT)
    lose_rpdo(master)
    rig.run(200 * MS)
    assert rig.sent(0x080 + JOINT) == [bytes.fromhex("5082110000000000")]
    assert struct.unpack("<H", master.read(JOINT, 0x603F)) == (0x8250,)
    master.sends_rpdo, master.follow, master.velocity = True, True, 0
    rig.run(30 * MS)
    assert rig.sent(0x080 + JOINT)[-1] == bytes(8)  # error reset
    assert rig.drive.state is State.SWITCH_ON_DISABLED  # still commanded 0x0F: does not enable by itself
    for word in (0x06, 0x07, 0x0F):
        master.command(word)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_lost_sync_is_told_as_8700() -> None:
    rig, master = moving(JOINT)
    die(master)
    rig.run(60 * MS)
    assert rig.sent(0x080 + JOINT)[0] == bytes.fromhex("0087210000000000")


def test_lost_heartbeat_stops_a_drive_that_still_gets_set_points() -> None:
    rig, master = moving(JOINT)
    master.sends_heartbeat = False
    rig.run(900 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED  # its set points speak for it
    rig.run(400 * MS)
    assert rig.sent(0x080 + JOINT)[0] == bytes.fromhex("3081110200000000")
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert rig.sent(0x700 + JOINT)[-1] == b"\x7f"  # 1029h:1 = 0: pre-operational
    assert rig.plant.peak_acceleration[0] < 1.3 * 12.0
    assert abs(rig.plant.velocity[0]) < 0.02


def test_loss_as_fault_needs_a_fault_reset_and_says_why() -> None:
    rig, master = moving(JOINT, defaults={(0x6007, 0): 1})
    lose_rpdo(master)
    rig.run(300 * MS)
    assert rig.drive.state is State.FAULT
    assert rig.plant.peak_acceleration[0] < 1.3 * 12.0
    assert struct.unpack("<H", master.read(JOINT, 0x603F)) == (0x8250,)
    master.sends_rpdo, master.follow, master.velocity = True, True, 0
    master.command(0x06)
    assert rig.drive.state is State.FAULT
    master.command(0x80)
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert struct.unpack("<H", master.read(JOINT, 0x603F)) == (0,)


def test_fault_by_lost_heartbeat_cannot_be_reset_before_the_heartbeat_is_back() -> None:
    rig, master = moving(JOINT, defaults={(0x6007, 0): 1, (0x1029, 1): 1})
    master.sends_heartbeat = False
    rig.run(1300 * MS)
    assert rig.drive.state is State.FAULT
    master.command(0x00)
    master.command(0x80)
    assert rig.drive.state is State.FAULT
    master.sends_heartbeat = True
    rig.run(150 * MS)
    master.command(0x00)
    master.command(0x80)
    assert rig.drive.state is State.SWITCH_ON_DISABLED


def test_loss_as_disable_voltage_cuts_the_torque_at_once() -> None:
    rig, master = moving(JOINT, defaults={(0x6007, 0): 2})
    lose_nmt(master)
    rig.run(2 * MS)
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert not rig.plant.command.any()


@pytest.mark.parametrize("loss", [die, lose_rpdo])
def test_even_with_no_reaction_the_axis_stops_and_goes_on_when_set_points_return(
    loss: Callable[[Master], None],
) -> None:
    rig, master = moving(JOINT, WHEEL, defaults={(0x6007, 0): 0, (0x1029, 1): 1})
    loss(master)
    rig.run(400 * MS)
    assert {drive.state for drive in rig.drives.values()} == {State.OPERATION_ENABLED}
    assert np.abs(rig.plant.velocity) == pytest.approx(0.0, abs=1e-3)
    assert rig.plant.peak_acceleration[0] < 1.3 * 12.0
    assert not rig.drive.statusword() & 0x1000
    master.alive = master.sends_rpdo = True
    master.velocity = 0
    master.target[JOINT] = round(rig.plant.position[0] * 1e6)
    rig.run(50 * MS)
    assert rig.drive.statusword() & 0x1000


def test_two_nodes_with_one_id_stop_and_neither_can_be_started() -> None:
    rig, master = moving(JOINT)
    twin = rig.bus.attach("twin", [], lambda frame: None)
    twin.send(0x700 + JOINT, b"\x00")
    rig.run(300 * MS)
    assert rig.sent(0x080 + JOINT)[0][:2] == bytes.fromhex("5081")
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert abs(rig.plant.velocity[0]) < 0.02
    master.nmt(1)
    rig.run(110 * MS)
    assert rig.sent(0x700 + JOINT)[-1] == b"\x7f"


def test_quick_stop_by_loss_waits_for_another_word_than_enable() -> None:
    rig, master = moving(JOINT, defaults={(0x605A, 0): 6})
    lose_rpdo(master)
    rig.run(300 * MS)
    assert rig.drive.state is State.QUICK_STOP_ACTIVE
    master.velocity, master.target[JOINT] = 0, round(rig.plant.position[0] * 1e6)
    master.sends_rpdo = True
    rig.run(50 * MS)
    assert rig.drive.state is State.QUICK_STOP_ACTIVE
    master.command(0x02)
    master.command(0x0F)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_power_cut_of_the_master_in_every_phase_of_power_up_leaves_no_torque() -> None:
    for cycles in range(10):
        rig = Rig(JOINT)
        master = Master(rig)
        master.nmt(1)
        for step in range(cycles):
            master.command((0x06, 0x07, 0x0F)[min(step // 3, 2)], cycles=1)
        die(master)
        rig.run(500 * MS)
        assert rig.bank.mode[0] == AxisMode.OFF
        assert rig.drive.state is not State.OPERATION_ENABLED
