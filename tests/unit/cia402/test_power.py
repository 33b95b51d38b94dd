"""Power up, power down, option codes: what a master sees and what the axis does."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from drivers.cia402.states import State
from stack.servo.state import AxisMode
from tests.unit.cia402.rig import MS, BrakedPlant, Master, Rig

JOINT = 25


@pytest.fixture
def rig() -> Rig:
    return Rig(JOINT)


@pytest.fixture
def master(rig: Rig) -> Master:
    return Master(rig)


def status(master: Master) -> int:
    return master.feedback[JOINT][0]


def test_statuswords_of_the_way_up(rig: Rig, master: Master) -> None:
    master.nmt(1)
    seen = []
    for word in (0x00, 0x06, 0x07, 0x0F):
        master.command(word)
        seen.append(status(master) & 0x6F)
    assert seen == [0x40, 0x21, 0x23, 0x27]


def test_enable_from_ready_passes_switched_on_by_itself(rig: Rig, master: Master) -> None:
    master.nmt(1)
    master.command(0x06)
    master.command(0x0F)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_enable_alone_does_not_power_a_disabled_drive(rig: Rig, master: Master) -> None:
    master.nmt(1)
    master.command(0x0F)
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert not rig.plant.command.any()


def test_enabling_does_not_move_the_axis_whatever_was_in_the_target_before(rig: Rig, master: Master) -> None:
    master.follow = False  # targets of 0 rad all the way, the axis is at 0.5 rad
    master.nmt(1)
    for word in (0x06, 0x07):
        master.command(word)
    assert master.write(JOINT, 0x607A, 0, struct.pack("<i", -900_000)) == 0
    master.sends_rpdo = False
    rig.run(10 * MS)
    assert master.write(JOINT, 0x6040, 0, b"\x0f\x00") == 0
    assert rig.drive.state is State.OPERATION_ENABLED
    assert struct.unpack("<i", master.read(JOINT, 0x607A)) == (500_000,)
    rig.run(15 * MS)
    assert rig.plant.position[0] == pytest.approx(0.5, abs=1e-6)


def test_controlword_and_target_of_one_rpdo_act_together_at_the_next_sync(rig: Rig, master: Master) -> None:
    master.enable()
    before = rig.drive.state
    master.port.send(0x200 + JOINT, struct.pack("<Hih", 0x00, 0, 0))
    rig.run(MS // 2)
    assert rig.drive.state is before  # nothing until SYNC
    master.word[JOINT] = 0x00
    rig.run(15 * MS)
    assert rig.drive.state is State.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("object_key", "word", "ramp", "expected"),
    [
        ((0x605B, 0), 0x06, 0, State.READY_TO_SWITCH_ON),
        ((0x605B, 0), 0x06, 1, State.READY_TO_SWITCH_ON),
        ((0x605C, 0), 0x07, 0, State.SWITCHED_ON),
        ((0x605C, 0), 0x07, 1, State.SWITCHED_ON),
    ],
)
def test_shutdown_and_disable_operation_ramp_only_if_their_option_code_says_so(
    object_key: tuple[int, int], word: int, ramp: int, expected: State
) -> None:
    rig = Rig(JOINT, defaults={object_key: ramp})
    master = Master(rig)
    master.enable()
    master.move(500_000)
    rig.run(300 * MS)
    speed = rig.plant.velocity[0]
    assert speed == pytest.approx(0.5, rel=0.02)
    rig.plant.peak_acceleration[:] = 0.0
    master.velocity = 0
    master.command(word, cycles=3)
    if ramp:
        assert rig.drive.state is State.OPERATION_ENABLED
        assert rig.plant.velocity[0] < 0.99 * speed
        rig.run(400 * MS)
        assert abs(rig.plant.velocity[0]) < 0.02
        assert rig.plant.peak_acceleration[0] < 1.3 * 6.0  # 6084h
    else:
        assert rig.bank.mode[0] == AxisMode.OFF
        assert rig.plant.velocity[0] > 0.9 * speed  # coasts: friction alone brakes it
    assert rig.drive.state is expected


def test_a_shutdown_ramp_is_called_off_by_enable(rig: Rig, master: Master) -> None:
    rig = Rig(JOINT, defaults={(0x605C, 0): 1})
    master = Master(rig)
    master.enable()
    master.move(500_000)
    rig.run(300 * MS)
    master.command(0x07, cycles=2)
    assert rig.drive.state is State.OPERATION_ENABLED
    master.command(0x0F, cycles=60)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert rig.plant.velocity[0] == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize(
    ("option", "deceleration", "end"),
    [
        (0, None, State.SWITCH_ON_DISABLED),
        (1, 6.0, State.SWITCH_ON_DISABLED),
        (2, 12.0, State.SWITCH_ON_DISABLED),
        (5, 6.0, State.QUICK_STOP_ACTIVE),
        (6, 12.0, State.QUICK_STOP_ACTIVE),
    ],
)
def test_quick_stop_brakes_with_the_ramp_of_its_option_code(
    option: int, deceleration: float | None, end: State
) -> None:
    rig = Rig(JOINT, defaults={(0x605A, 0): option})
    master = Master(rig)
    master.enable()
    master.move(800_000)
    rig.run(400 * MS)
    master.word[JOINT] = 0x02
    rig.run(10 * MS)
    begin = len(rig.velocities)
    rig.run(1_000 * MS)
    assert rig.drive.state is end
    if deceleration is None:
        assert rig.bank.mode[0] == AxisMode.OFF
        return
    assert abs(rig.plant.velocity[0]) < (0.015 if end is State.SWITCH_ON_DISABLED else 1e-3)
    slopes = -np.diff(rig.velocities[begin:]) / 1e-3
    assert max(slopes) < 1.35 * deceleration
    braking = slopes[slopes > 0.5 * deceleration]
    assert len(braking) == pytest.approx(0.8 / deceleration * 1e3, rel=0.25)
    assert status(master) & 0x400 or end is State.SWITCH_ON_DISABLED


def test_quick_stop_that_stays_can_be_left_by_enable_without_a_jump() -> None:
    rig = Rig(JOINT, defaults={(0x605A, 0): 6})
    master = Master(rig)
    master.enable()
    master.move(500_000)
    rig.run(300 * MS)
    master.velocity = 0
    master.command(0x02, cycles=30)
    where = rig.plant.position[0]
    master.target[JOINT] = round(where * 1e6)
    rig.plant.peak_acceleration[:] = 0.0
    master.command(0x0F, cycles=30)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert rig.plant.position[0] == pytest.approx(where, abs=1e-4)
    assert rig.plant.peak_acceleration[0] < 2.0


@pytest.mark.parametrize(("option", "deceleration"), [(1, 6.0), (2, 12.0)])
def test_halt_stops_keeps_enabled_and_goes_on_within_limits(option: int, deceleration: float) -> None:
    rig = Rig(JOINT, defaults={(0x605D, 0): option})
    master = Master(rig)
    master.enable()
    master.move(500_000)
    rig.run(300 * MS)
    master.word[JOINT] = 0x10F
    rig.run(10 * MS)
    begin = len(rig.velocities)
    rig.run(390 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert abs(rig.plant.velocity[0]) < 1e-3
    assert max(-np.diff(rig.velocities[begin:]) / 1e-3) < 1.35 * deceleration
    assert status(master) & 0x1400 == 0x0400  # standing, not following
    rig.plant.peak_acceleration[:] = 0.0
    master.velocity = 0
    master.command(0x0F, cycles=150)
    assert rig.plant.position[0] == pytest.approx(master.target[JOINT] * 1e-6, abs=1e-4)
    assert rig.plant.peak_acceleration[0] < 1.4 * 6.0
    assert max(rig.velocities) < 1.1 * 1.5
    assert status(master) & 0x1400 == 0x1400


def test_reset_node_in_motion_brakes_before_torque_goes(rig: Rig, master: Master) -> None:
    master.enable()
    master.move(500_000)
    rig.run(300 * MS)
    rig.plant.peak_acceleration[:] = 0.0
    master.nmt(129, JOINT)
    assert rig.drive.state is State.NOT_READY
    rig.run(300 * MS)
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert rig.bank.mode[0] == AxisMode.OFF
    assert abs(rig.plant.velocity[0]) < 0.02
    assert rig.plant.peak_acceleration[0] < 1.3 * 12.0


def test_power_off_is_silent_and_without_torque(rig: Rig, master: Master) -> None:
    master.enable()
    rig.drive.power_off()
    count = len([frame for frame in rig.frames if frame.can_id & 0x7F == JOINT and frame.can_id != 0x200 + JOINT])
    rig.run(300 * MS)
    after = len([frame for frame in rig.frames if frame.can_id & 0x7F == JOINT and frame.can_id != 0x200 + JOINT])
    assert after <= count + 1  # one may still have been on its way
    assert not rig.plant.command.any()
    rig.drive.power_on()
    rig.run(5 * MS)
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert rig.sent(0x700 + JOINT).count(b"\x00") == 2


def test_brakes_hold_while_there_is_no_torque() -> None:
    rig = Rig(JOINT, plant_type=BrakedPlant)
    master = Master(rig)
    rig.run(5 * MS)
    master.enable()
    master.command(0x00)
    assert [bool(engaged[0]) for engaged in rig.plant.brakes] == [True, False, True]
