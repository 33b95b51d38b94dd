"""Cyclic motion: targets reach the axes, feedback comes back in SI units, stopping and starting without a jump."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers.catalogue import DRIVE_IDS
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.phases import AxisPhase, EventKind, MasterPhase
from drivers.cia402.states import State
from stack.messages import Vector

MakeCell = Callable[..., Any]
WHEELS = 2
STAY: dict[int, dict[tuple[int, int], Any]] = {node: {(0x605A, 0): 6} for node in DRIVE_IDS}
"""Quick stop ends standing under torque."""


class Swing:
    """Joints swing about where they were enabled; wheels turn steadily, one each way. Loads go into the offsets."""

    def __init__(self) -> None:
        self.start: Vector | None = None
        self.begin_ns = 0

    def __call__(self, cell: Any) -> tuple[Vector, Vector]:
        if cell.master.phase is not MasterPhase.ENABLED:
            self.start = None
            return cell.master.targets(), cell.load
        if self.start is None:
            self.start, self.begin_ns = cell.master.targets(), cell.clock.now_ns()
        t = (cell.clock.now_ns() - self.begin_ns) * 1e-9
        targets = self.start + 0.1 * (1.0 - math.cos(2.0 * t))
        targets[:WHEELS] = (1.0, -0.5)
        return targets, cell.load


@pytest.fixture
def swinging(cell: Any) -> Any:
    cell.control = Swing()
    return cell.enabled()


def largest_step(cell: Any, seconds: float) -> float:
    """Largest change of any joint between two milliseconds: a jump would show."""
    largest = 0.0
    before = cell.plant.position.copy()
    for _ in range(round(seconds * 1000)):
        cell.run(0.001)
        largest = max(largest, float(np.abs(cell.plant.position - before)[WHEELS:].max()))
        before = cell.plant.position.copy()
    return largest


def test_joints_follow_positions_and_wheels_velocities(swinging: Any) -> None:
    swing = swinging.control
    swinging.run(2.0)
    t = (swinging.clock.now_ns() - swing.begin_ns) * 1e-9 - 2 * 0.010  # two SYNCs from target to position
    expected = swing.start + 0.1 * (1.0 - math.cos(2.0 * t))
    np.testing.assert_allclose(swinging.plant.position[WHEELS:], expected[WHEELS:], atol=4e-3)
    np.testing.assert_allclose(swinging.plant.velocity[:WHEELS], (1.0, -0.5), atol=1e-3)
    np.testing.assert_allclose(swinging.master.targets()[:WHEELS], (1.0, -0.5))  # also after the next feedback
    assert swinging.failures() == []


def test_feedback_is_what_the_plant_does_in_si_units(swinging: Any) -> None:
    swinging.run(1.0)
    feedback = swinging.master.feedback()
    np.testing.assert_allclose([axis.position for axis in feedback], swinging.plant.position, atol=0.01)
    lift = feedback[3]
    assert lift.effort == pytest.approx(swinging.plant.command[3], rel=0.2)
    assert lift.effort > 30.0  # newtons of a 50 N load, not per mille
    velocities = [axis.velocity(swinging.clock.now_ns(), 200_000_000) for axis in swinging.master.axes]
    assert velocities[:WHEELS] == pytest.approx([1.0, -0.5], abs=0.01)


def test_feedback_that_is_too_old_is_missing_not_zero(swinging: Any) -> None:
    swinging.run(0.5)
    assert swinging.master.positions() is not None
    swinging.drives[26].power_off()
    swinging.run(0.05)
    feedback = swinging.master.feedback()
    assert feedback[DRIVE_IDS.index(26)] is None
    assert feedback[0] is not None
    assert swinging.master.positions() is None


def test_targets_that_are_no_numbers_are_refused_before_anything_is_sent(swinging: Any) -> None:
    targets, offsets = swinging.control(swinging)
    targets[4] = math.nan
    sent = [axis.sent for axis in swinging.master.axes]
    with pytest.raises(ValueError, match=r"drive 23 \(shoulder\): target nan"):
        swinging.master.send_targets(targets, offsets)
    assert [axis.sent for axis in swinging.master.axes] == sent


def test_huge_targets_are_clipped_to_what_the_wire_carries(swinging: Any) -> None:
    swinging.master.send_targets(np.full(10, 1e9), np.full(10, -1e9))
    assert swinging.master.axes[2].command() == bytes.fromhex("0f 00 ff ff ff 7f 00 80")


def test_the_bytes_of_a_command(swinging: Any) -> None:
    """Enable operation, 0.25 rad in µrad, 12.5 N·m of 100 N·m rated in per mille."""
    swinging.master.send_targets(np.full(10, 0.25), np.full(10, 12.5))
    assert swinging.master.axes[2].command() == bytes.fromhex("0f 00 90 d0 03 00 7d 00")


def test_disable_takes_the_torque_away_step_by_step(cell: Any) -> None:
    cell.enabled()
    cell.run(0.2)
    cell.master.disable()
    assert cell.master.phase is MasterPhase.DISABLING
    cell.run_to(MasterPhase.READY, 2.0)
    assert {drive.state for drive in cell.drives.values()} == {State.SWITCH_ON_DISABLED}
    assert cell.plant.engaged.all()
    assert cell.failures() == []
    cell.master.enable()
    cell.run_to(MasterPhase.ENABLED)


def test_some_axes_alone(cell: Any) -> None:
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    cell.master.enable([11, 12])
    cell.run_to(MasterPhase.ENABLED)
    phases = [axis.phase for axis in cell.master.axes]
    assert phases == [AxisPhase.ENABLED] * 2 + [AxisPhase.READY] * 8
    cell.run(0.3)
    cell.master.enable()
    cell.run_to(MasterPhase.ENABLED)
    cell.master.disable([21])
    cell.run(1.0)
    assert cell.drives[21].state is State.SWITCH_ON_DISABLED
    assert cell.drives[22].state is State.OPERATION_ENABLED
    assert cell.failures() == []


def test_quick_stop_in_motion_stands_and_switches_off(swinging: Any) -> None:
    swinging.run(0.7)
    assert np.abs(swinging.plant.velocity).max() > 0.1
    swinging.master.quick_stop()
    assert swinging.master.phase is MasterPhase.STOPPING
    swinging.run_to(MasterPhase.READY, 3.0)
    assert np.abs(swinging.plant.velocity).max() < 1e-2
    assert {drive.state for drive in swinging.drives.values()} == {State.SWITCH_ON_DISABLED}
    assert swinging.failures() == []


def test_quick_stop_under_torque_and_on_from_there_without_a_jump(make_cell: MakeCell) -> None:
    cell = make_cell(settings=DriveSettings(parameters=STAY))
    cell.control = Swing()
    cell.enabled()
    cell.run(0.7)
    cell.master.quick_stop()
    cell.run_to(MasterPhase.STOPPED, 3.0)
    assert np.abs(cell.plant.velocity).max() < 1e-2  # not before it stands
    assert {drive.state for drive in cell.drives.values()} == {State.QUICK_STOP_ACTIVE}
    cell.run(0.5)
    cell.master.enable()
    assert largest_step(cell, 0.5) < 0.35e-3  # the swing moves with 0.2 rad/s
    assert cell.master.phase is MasterPhase.ENABLED
    assert not cell.plant.engaged.any()
    assert cell.failures() == []


def test_an_axis_that_was_moved_while_off_is_enabled_where_it_is(cell: Any) -> None:
    cell.enabled()
    cell.master.disable()
    cell.run_to(MasterPhase.READY, 2.0)
    cell.plant.position[5] += 0.4
    cell.run(0.1)
    moved = cell.plant.position.copy()
    cell.master.enable()
    cell.run_to(MasterPhase.ENABLED)
    cell.run(0.5)
    np.testing.assert_allclose(cell.plant.position, moved, atol=1e-5)


def test_wheels_turn_on_where_the_wire_ends(cell: Any) -> None:
    """2147 rad is what 32 bits of µrad carry: 215 m of way, and then on, not back."""
    cell.plant.position[0] = 2147.4
    cell.control = Swing()
    cell.enabled()
    cell.run(1.0)
    assert cell.plant.position[0] > 2148.0
    assert cell.master.positions()[0] == pytest.approx(cell.plant.position[0], abs=0.02)


@pytest.mark.parametrize("seed", [1, 2])
def test_any_order_of_frames(make_cell: MakeCell, seed: int) -> None:
    cell = make_cell(shuffle_seed=seed)
    cell.control = Swing()
    cell.enabled()
    assert largest_step(cell, 1.0) < 0.5e-3
    assert cell.failures() == []
    cell.master.disable()
    cell.run_to(MasterPhase.READY, 3.0)


def test_same_run_same_frames(make_cell: MakeCell) -> None:
    wires = []
    for _ in range(2):
        cell = make_cell(shuffle_seed=3)
        cell.control = Swing()
        cell.enabled()
        cell.run(0.3)
        wires.append(cell.wire)
    assert wires[0] == wires[1]


def test_enabling_what_is_not_ready_is_an_error_of_the_caller(cell: Any) -> None:
    cell.power_on()
    with pytest.raises(RuntimeError, match=r"drive 11 \(wheel_left\) is ABSENT"):
        cell.master.enable()
    cell.run_to(MasterPhase.READY)
    cell.master.enable()
    assert not [event for event in cell.master.events if event.kind is EventKind.ENABLE_FAILED]


def test_the_owner_may_enable_each_axis_as_it_gets_ready(cell: Any) -> None:
    cell.on_event = lambda event: cell.master.enable([event.node_id]) if event.kind is EventKind.CONFIGURED else None
    cell.power_on()
    cell.run_to(MasterPhase.ENABLED)
    cell.run(0.5)
    assert all(axis.follows_planner for axis in cell.master.axes)
    assert cell.failures() == []
