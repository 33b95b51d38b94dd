"""Following error, overspeed, position limit: fault with EMCY, reaction of 605Eh, fault reset."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.cia402.states import State
from stack.servo.state import AxisMode
from tests.unit.cia402.rig import MS, Master, Rig

JOINT = 25


def moving(velocity: int = 500_000, **defaults: object) -> tuple[Rig, Master]:
    rig = Rig(JOINT, **defaults)  # type: ignore[arg-type]
    master = Master(rig)
    master.enable()
    master.move(velocity)
    rig.run(300 * MS)
    return rig, master


def test_blocked_axis_is_a_following_error_after_its_time_out() -> None:
    rig, master = moving()
    rig.plant.blocked[0] = True
    for _ in range(600):
        rig.run(MS)
        if abs(rig.drive.axis.following_error) > 0.1:
            break
    assert rig.drive.state is State.OPERATION_ENABLED
    rig.run(45 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    rig.run(8 * MS)
    assert rig.sent(0x080 + JOINT) == [bytes.fromhex("1186210000000000")]
    assert rig.drive.state is State.FAULT  # it stands already: the reaction is done at once
    rig.run(20 * MS)
    assert rig.bank.mode[0] == AxisMode.OFF
    assert master.feedback[JOINT][0] & 0x204F == 0x2008


def test_short_excursion_beyond_the_window_is_no_fault() -> None:
    rig, _ = moving(defaults={(0x6065, 0): 30_000})
    rig.plant.load[0] = -100.0
    for _ in range(100):
        rig.run(MS)
        if abs(rig.drive.axis.following_error) > 0.03:
            break
    else:
        pytest.fail("the load was to push the axis out of the window")
    rig.plant.load[0] = 0.0
    rig.run(300 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_window_of_all_ones_switches_the_watch_off() -> None:
    rig, _ = moving(defaults={(0x6065, 0): 0xFFFF_FFFF})
    rig.plant.blocked[0] = True
    rig.run(1_000 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED


@pytest.mark.parametrize(("option", "deceleration"), [(0, None), (1, 6.0), (2, 12.0)])
def test_fault_reaction_brakes_as_605e_says(option: int, deceleration: float | None) -> None:
    rig, master = moving(defaults={(0x605E, 0): option})
    assert master.write(JOINT, 0x6066, 0, b"\0\0") == 0
    assert master.write(JOINT, 0x6065, 0, (10_000).to_bytes(4, "little")) == 0
    rig.plant.load[0] = 60.0  # a push, out of a narrow window
    for _ in range(50):
        rig.run(MS)
        if rig.drive.state is not State.OPERATION_ENABLED:
            break
    rig.plant.load[0] = 0.0
    if deceleration is None:
        assert rig.drive.state is State.FAULT
        assert not rig.plant.command.any()
        return
    assert rig.drive.state is State.FAULT_REACTION_ACTIVE
    rig.run(10 * MS)
    rig.velocities.clear()
    rig.run(600 * MS)
    assert rig.drive.state is State.FAULT
    assert abs(rig.plant.velocity[0]) < 0.02
    assert max(-np.diff(rig.velocities) / 1e-3) < 1.5 * deceleration


def test_fault_is_reset_by_a_rising_edge_only() -> None:
    rig, master = moving()
    rig.plant.blocked[0] = True
    rig.run(800 * MS)
    assert rig.drive.state is State.FAULT
    rig.plant.blocked[0] = False
    master.follow, master.velocity = True, 0
    master.command(0x8F)  # an edge, but ...
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    master.command(0x8F)  # ... what stays high does nothing more
    assert rig.drive.state is State.SWITCH_ON_DISABLED
    assert rig.sent(0x080 + JOINT)[-1] == bytes(8)
    for word in (0x06, 0x07, 0x0F):
        master.command(word)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert not master.feedback[JOINT][0] & 0x2000


def test_edge_is_seen_between_two_rpdos_not_in_a_level() -> None:
    rig, master = moving()
    master.word[JOINT] = 0x8F  # high before the fault
    rig.run(20 * MS)
    rig.plant.blocked[0] = True
    rig.run(800 * MS)
    assert rig.drive.state is State.FAULT
    master.command(0x00)
    assert rig.drive.state is State.FAULT
    master.command(0x80)
    assert rig.drive.state is State.SWITCH_ON_DISABLED


def test_overspeed_by_a_foreign_force_is_a_fault() -> None:
    rig, _ = moving(velocity=0, defaults={(0x6065, 0): 0xFFFF_FFFF, (0x605E, 0): 0})
    rig.plant.load[0] = 450.0  # more than the motor can hold
    rig.run(150 * MS)
    assert rig.drive.state is State.FAULT
    assert rig.sent(0x080 + JOINT) == [bytes.fromhex("0084210000000000")]


def test_pushed_far_beyond_a_position_limit_is_a_fault() -> None:
    rig = Rig(JOINT, position=2.9, defaults={(0x6065, 0): 50_000, (0x6066, 0): 10_000})
    master = Master(rig)
    master.enable()
    rig.plant.load[0] = 230.0
    rig.run(300 * MS)
    assert rig.sent(0x080 + JOINT)[0] == bytes.fromhex("1286210000000000")


def test_axis_that_starts_beyond_its_limit_is_brought_back() -> None:
    rig = Rig(JOINT, position=3.0)
    master = Master(rig)
    master.enable()
    master.move(-100_000)
    rig.run(1_500 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert rig.plant.position[0] < 2.967
