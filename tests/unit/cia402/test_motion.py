"""Cyclic modes on a plant: following, limits that hold whatever the master sends, scaling, modes, homing."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia402.states import State
from tests.unit.cia402.rig import MS, Master, Rig

JOINT, LIFT, WHEEL = 25, 22, 11


def enabled(*node_ids: int, position: float = 0.5, **defaults: object) -> tuple[Rig, Master]:
    rig = Rig(*node_ids, position=position, **defaults)  # type: ignore[arg-type]
    master = Master(rig)
    master.enable()
    return rig, master


def test_set_point_computed_in_one_cycle_is_reached_two_periods_later() -> None:
    """Sent after SYNC k, valid with SYNC k + 1, reached one period after that; for a motion of constant velocity."""
    rig, master = enabled(JOINT)
    master.move(400_000)
    rig.run(500 * MS - rig.clock.now_ns() % (10 * MS))
    target = master.target[JOINT] * 1e-6  # sent right after the SYNC of this instant
    rig.run(19 * MS)  # the tick at the end of which the target is due
    assert rig.bank.set_point[0] == pytest.approx(target, abs=1e-9)


def test_velocity_of_the_set_point_is_smooth_over_the_segments() -> None:
    rig, master = enabled(JOINT)
    master.move(400_000)
    rig.run(400 * MS)
    points = []
    for _ in range(50):
        rig.run(MS)
        points.append(float(rig.bank.set_point[0]))
    assert np.diff(points) == pytest.approx(0.4e-3, rel=1e-6)


def test_axis_follows_and_says_so() -> None:
    rig, master = enabled(JOINT)
    master.move(400_000)
    rig.run(500 * MS)
    word, position, _ = master.feedback[JOINT]
    assert word & 0x6F == 0x27
    assert word & 0x1000
    assert not word & 0x2000
    assert position * 1e-6 == pytest.approx(rig.plant.position[0], abs=0.005)
    assert rig.plant.velocity[0] == pytest.approx(0.4, rel=0.01)


@settings(max_examples=15, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(-(1 << 31), (1 << 31) - 1), st.integers(-(1 << 15), (1 << 15) - 1)),
        min_size=3,
        max_size=25,
    )
)
def test_no_target_whatsoever_takes_the_set_point_beyond_its_limits(commands: list[tuple[int, int]]) -> None:
    rig, master = enabled(JOINT, defaults={(0x6065, 0): 0xFFFF_FFFF})
    points = [float(rig.bank.set_point[0])]
    for target, offset in commands:
        master.target[JOINT], master.offset[JOINT] = target, offset
        for _ in range(10):
            rig.run(MS)
            points.append(float(rig.bank.set_point[0]))
    velocity = np.diff(points) / 1e-3
    assert np.all(np.abs(points) <= 2.967 + 1e-9)
    assert np.all(np.abs(velocity) <= 1.5 + 1e-6)
    assert np.all(np.abs(np.diff(velocity)) / 1e-3 <= 12.0 + 1e-3)
    assert np.all(np.isfinite(rig.plant.command))
    assert np.all(np.abs(rig.plant.command) <= 200.0 + 1e-9)  # 6072h: twice the rated 100 N·m


def test_internal_limit_is_told_in_the_statusword() -> None:
    rig, master = enabled(JOINT)
    assert not master.feedback[JOINT][0] & 0x0800
    master.target[JOINT] = 5_000_000
    rig.run(50 * MS)
    assert master.feedback[JOINT][0] & 0x0800


def test_units_of_a_lift_are_micrometres_and_newtons() -> None:
    rig, master = enabled(LIFT, position=0.75)
    rig.plant.load[0] = -5.0
    master.offset[LIFT] = 10  # a hundredth of the rated 500 N
    rig.run(1_000 * MS)
    _, position, torque = master.feedback[LIFT]
    assert position == pytest.approx(750_000, abs=50)
    assert torque == pytest.approx(10, abs=1)
    master.move(100_000)
    rig.run(500 * MS)
    assert rig.plant.velocity[0] == pytest.approx(0.1, rel=0.02)


def test_wheel_follows_its_velocity_and_turns_on_past_32_bits() -> None:
    rig = Rig(WHEEL)
    rig.plant.position[0] = 2147.0  # after many turns; 6064h wraps at 2147.483 rad
    master = Master(rig)
    master.enable()
    master.move(2_000_000)
    rig.run(500 * MS)
    assert rig.plant.velocity[0] == pytest.approx(2.0, rel=0.01)
    assert master.read(WHEEL, 0x6061) == b"\x09"
    _, position, _ = master.feedback[WHEEL]
    assert position == pytest.approx((rig.plant.position[0] - 4294.967296) * 1e6, abs=30_000)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_position_mode_of_an_endless_axis_takes_the_nearest_place_that_reads_like_the_target() -> None:
    rig = Rig(WHEEL, defaults={(0x6060, 0): 8, (0x1600, 2): 0x607A_0020})
    rig.plant.position[0] = 2147.0  # 32 bits end at 2147.483 rad
    master = Master(rig)
    master.nmt(1)
    for word in (0x06, 0x07):
        master.command(word)
    master.sends_rpdo = False
    rig.run(10 * MS)
    target = 2_147_000_000
    for _ in range(150):
        target = (target + 20_000 + (1 << 31)) % (1 << 32) - (1 << 31)
        master.port.send(0x200 + WHEEL, struct.pack("<Hih", 0x0F, target, 0))
        rig.run(10 * MS)
    assert target < 0
    assert rig.plant.position[0] == pytest.approx(2150.0, abs=0.3)
    assert max(map(abs, rig.velocities)) < 5.0


def test_wheel_refuses_torque_mode_since_its_plant_takes_none() -> None:
    rig, master = enabled(WHEEL)
    assert master.write(WHEEL, 0x6060, 0, b"\x0a") == 0x0609_0030
    assert struct.unpack("<I", master.read(WHEEL, 0x6502))[0] & 1 << 9 == 0
    assert rig.drive.state is State.OPERATION_ENABLED


@pytest.mark.parametrize("mode", [1, 3, 4, 7, -1, 11])
def test_modes_that_the_drive_has_not_are_refused(mode: int) -> None:
    rig = Rig(JOINT)
    master = Master(rig)
    assert master.write(JOINT, 0x6060, 0, struct.pack("<b", mode)) == 0x0609_0030
    assert master.read(JOINT, 0x6061) == b"\x08"


def test_change_of_mode_in_motion_begins_at_rest_from_where_the_axis_is() -> None:
    rig, master = enabled(JOINT)
    master.move(400_000)
    rig.run(300 * MS)
    rig.plant.peak_acceleration[:] = 0.0
    master.sends_rpdo = False
    assert master.write(JOINT, 0x6060, 0, b"\x09") == 0
    assert master.read(JOINT, 0x6061) == b"\x09"
    for _ in range(20):
        assert master.write(JOINT, 0x60FF, 0, struct.pack("<i", 200_000)) == 0
        rig.run(8 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert rig.plant.velocity[0] == pytest.approx(0.2, rel=0.05)
    assert rig.plant.peak_acceleration[0] < 1.5 * 6.0


def test_torque_mode_gives_the_torque_and_stops_before_a_position_limit() -> None:
    rig, master = enabled(JOINT)
    master.sends_rpdo = False
    assert master.write(JOINT, 0x6060, 0, b"\x0a") == 0
    for _ in range(20):
        assert master.write(JOINT, 0x6071, 0, struct.pack("<h", 10)) == 0  # 1 % of 100 N·m
        rig.run(5 * MS)
    assert rig.plant.command[0] == pytest.approx(1.0)
    assert rig.plant.velocity[0] > 0.1
    for _ in range(400):
        if rig.drive.state is State.OPERATION_ENABLED:
            master.write(JOINT, 0x6071, 0, struct.pack("<h", 10))
        rig.run(5 * MS)
    assert rig.drive.state is State.FAULT
    assert rig.sent(0x080 + JOINT)[0][:3] == bytes.fromhex("128621")
    assert max(rig.velocities) < 1.1 * 1.5
    assert rig.plant.position[0] < 2.967 + 0.15  # coasts on after the ramp, without brakes


def test_missed_set_point_is_bridged_without_a_stop() -> None:
    rig, master = enabled(JOINT)
    master.move(400_000)
    rig.run(300 * MS)
    lowest = []
    master.sends_rpdo = False
    rig.run(10 * MS)
    master.sends_rpdo = True
    rig.run(10 * MS)
    assert rig.drive.statusword() & 0x0080  # warning: running on nothing
    for _ in range(100):
        rig.run(MS)
        lowest.append(rig.plant.velocity[0])
    assert min(lowest) > 0.35
    assert rig.drive.state is State.OPERATION_ENABLED
    assert not rig.drive.statusword() & 0x0080


def test_homing_makes_the_present_position_the_home_offset() -> None:
    rig, master = enabled(JOINT)
    assert master.write(JOINT, 0x607C, 0, struct.pack("<i", 100_000)) == 0
    assert master.write(JOINT, 0x6098, 0, b"\x25") == 0  # 37
    master.follow = True
    assert master.write(JOINT, 0x6060, 0, b"\x06") == 0
    rig.run(30 * MS)
    assert master.feedback[JOINT][0] & 0x3400 == 0x0400  # not started
    master.command(0x1F)
    assert master.feedback[JOINT][0] & 0x3400 == 0x1400  # completed
    assert master.feedback[JOINT][1] == pytest.approx(100_000, abs=20)
    assert rig.plant.position[0] == pytest.approx(0.5, abs=1e-4)
    assert master.write(JOINT, 0x6060, 0, b"\x08") == 0
    master.command(0x0F)
    master.follow = False
    master.move(100_000)
    rig.run(1000 * MS)
    assert rig.plant.position[0] == pytest.approx(0.5 + (master.target[JOINT] - 100_000) * 1e-6, abs=5e-3)


def test_homing_of_a_moving_axis_is_an_error() -> None:
    rig, master = enabled(JOINT, defaults={(0x6060, 0): 6, (0x6065, 0): 0xFFFF_FFFF})
    rig.plant.velocity[0] = 1.0
    rig.run(3 * MS)
    assert abs(rig.plant.velocity[0]) > 0.1
    before = rig.bank.zero[0]
    assert master.write(JOINT, 0x6040, 0, b"\x1f\x00") == 0
    assert rig.drive.statusword() & 0x3400 == 0x2000
    assert rig.bank.zero[0] == before


@pytest.mark.parametrize("method", [1, 17, 34, 0, -1])
def test_homing_methods_that_need_switches_are_refused(method: int) -> None:
    master = Master(Rig(JOINT))
    assert master.write(JOINT, 0x6098, 0, struct.pack("<b", method)) == 0x0609_0030


def test_limits_written_by_sdo_hold_from_the_next_tick() -> None:
    rig, master = enabled(JOINT)
    assert master.write(JOINT, 0x607F, 0, struct.pack("<I", 200_000)) == 0
    master.move(800_000)
    rig.run(500 * MS)
    assert rig.plant.velocity[0] == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x607F, 0, struct.pack("<I", 0), 0x0609_0032),
        (0x6085, 0, struct.pack("<I", 0), 0x0609_0032),
        (0x607D, 1, struct.pack("<i", 3_000_000), 0x0609_0036),
        (0x607D, 2, struct.pack("<i", -3_000_000), 0x0609_0036),
        (0x605A, 0, struct.pack("<h", 3), 0x0609_0030),
        (0x605A, 0, struct.pack("<h", 7), 0x0609_0031),
        (0x6007, 0, struct.pack("<h", -1), 0x0609_0032),
        (0x6041, 0, b"\0\0", 0x0601_0002),
        (0x60C2, 2, b"\x01", 0x0609_0031),
    ],
)
def test_parameters_without_a_meaning_are_refused(index: int, subindex: int, data: bytes, code: int) -> None:
    assert Master(Rig(JOINT)).write(JOINT, index, subindex, data) == code


def test_interpolation_follows_60c2() -> None:
    rig = Rig(JOINT, defaults={(0x60C2, 1): 5})
    assert rig.drive.parameters.period_ns == 5 * MS
    master = Master(rig)
    assert master.write(JOINT, 0x60C2, 1, b"\x02") == 0
    assert master.write(JOINT, 0x60C2, 2, b"\xfe") == 0
    assert rig.drive.parameters.period_ns == 20 * MS


def test_readings_that_are_no_number_never_reach_the_plant() -> None:
    rig, master = enabled(JOINT)
    rig.plant.broken_encoder = 0
    rig.run(5 * MS)  # the plant itself asserts that its commands are finite
    assert rig.drive.state is State.FAULT
    assert not rig.plant.command.any()
    assert rig.sent(0x080 + JOINT) == [bytes.fromhex("0073210000000000")]
    rig.run(30 * MS)
    assert not math.isnan(master.feedback[JOINT][1])
    master.command(0x80)
    assert rig.drive.state is State.FAULT  # the cause is still there
    rig.plant.broken_encoder = None
    master.command(0x00)
    master.command(0x80)
    assert rig.drive.state is State.SWITCH_ON_DISABLED


def test_mode_in_every_rpdo_does_not_hold_the_axis_back() -> None:
    rig = Rig(JOINT, defaults={(0x1600, 3): 0x6060_0008})
    master = Master(rig)
    master.sends_rpdo = False
    master.nmt(1)
    target = 500_000
    for cycle in range(80):
        word = {0: 0x06, 1: 0x07}.get(cycle, 0x0F)
        target += 4_000 if cycle > 10 else 0
        master.port.send(0x200 + JOINT, struct.pack("<Hib", word, target, 8))
        rig.run(10 * MS)
    assert rig.plant.position[0] == pytest.approx(target * 1e-6, abs=0.01)
    master.port.send(0x200 + JOINT, struct.pack("<Hib", 0x0F, target, 3))  # a mode that it has not
    rig.run(12 * MS)
    assert rig.sent(0x080 + JOINT)[-1] == bytes.fromhex("0082113000090601")
    assert rig.drive.state is State.OPERATION_ENABLED
