"""The bank by itself: its time base under late and early SYNCs, one owner per axis, alarms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia402.axis_watch import Alarm
from drivers.cia402.bank import DriveBank
from drivers.cia402.bank_axis import AxisLimits, BankAxis
from stack.messages import Vector
from stack.servo.state import AxisMode
from tests.unit.cia402.rig import LinearPlant, servo_parameters

TICK_NS, PERIOD_NS = 1_000_000, 10_000_000


def bank_of(count: int = 1) -> tuple[DriveBank, list[BankAxis], list[list[Alarm]]]:
    none = np.zeros(count, dtype=np.bool_)
    bank = DriveBank(servo_parameters(none), LinearPlant(np.full(count, 0.5), none), TICK_NS)
    alarms: list[list[Alarm]] = [[] for _ in range(count)]
    return bank, [bank.axis(index, alarms[index].append) for index in range(count)], alarms


def drive_along(bank: DriveBank, axis: BankAxis, delays_ns: list[int], velocity: float = 0.5) -> list[float]:
    """Constant velocity by set points with SYNCs that come late by `delays_ns`; the set points of all ticks."""
    points = []
    bank.tick(0)
    axis.run(AxisMode.POSITION, 12.0)
    target = 0.5
    syncs = [((k + 1) * PERIOD_NS + delay) for k, delay in enumerate(delays_ns)]
    for tick in range(1, 10 * (len(delays_ns) + 1)):
        now_ns = tick * TICK_NS
        while syncs and syncs[0] <= now_ns:
            target += velocity * PERIOD_NS * 1e-9
            axis.accept(target, 0.0, syncs.pop(0), PERIOD_NS)
        bank.plant.step(TICK_NS * 1e-9)  # type: ignore[attr-defined]
        bank.tick(now_ns)
        points.append(float(bank.set_point[0]))
    return points


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, TICK_NS), min_size=40, max_size=60))
def test_late_syncs_leave_no_trace_in_the_velocity(delays_ns: list[int]) -> None:
    bank, (axis,), _ = bank_of()
    velocity = np.diff(drive_along(bank, axis, delays_ns)) / 1e-3
    assert velocity[250:] == pytest.approx(0.5, rel=1e-6)


def test_jitter_of_two_ticks_makes_small_ripples_only() -> None:
    bank, (axis,), _ = bank_of()
    random = np.random.default_rng(1)
    velocity = np.diff(drive_along(bank, axis, [int(d) for d in random.integers(0, 2 * TICK_NS, 100)])) / 1e-3
    assert np.abs(velocity[250:] - 0.5).max() < 0.05


@pytest.mark.parametrize("drift", [0.002, -0.002])
def test_slow_drift_between_the_clocks_is_followed(drift: float) -> None:
    bank, (axis,), _ = bank_of()
    delays_ns = [TICK_NS // 2 + round(k * drift * PERIOD_NS) for k in range(300)]
    velocity = np.diff(drive_along(bank, axis, delays_ns)) / 1e-3
    assert velocity[800:2900] == pytest.approx(0.5 / (1.0 + drift), rel=0.02)
    assert bank._segment_ns - (300 * PERIOD_NS + delays_ns[-1]) == pytest.approx(0, abs=2 * TICK_NS)


def test_an_axis_has_one_owner() -> None:
    bank, _, _ = bank_of(2)
    with pytest.raises(ValueError, match=r"axis 1: must be one of 0 … 1 that no other drive has"):
        bank.axis(1, print)
    with pytest.raises(ValueError, match="axis 2"):
        bank.axis(2, print)


def test_alarms_go_to_the_axis_that_has_them() -> None:
    bank, (_, second, _), alarms = bank_of(3)
    bank.plant.broken_encoder = 1  # type: ignore[attr-defined]
    bank.tick(0)
    assert alarms == [[], [Alarm.SENSOR], []]
    bank.plant.broken_encoder = None  # type: ignore[attr-defined]
    bank.tick(TICK_NS)
    assert second.position == pytest.approx(0.5)


def test_sync_deadline_is_told_once() -> None:
    bank, (axis,), (alarms,) = bank_of()
    axis.expect_sync(3 * TICK_NS)
    for tick in range(8):
        bank.tick(tick * TICK_NS)
    assert alarms == [Alarm.SYNC_LOST]


def test_stop_is_told_once_if_asked_for() -> None:
    for report in (False, True):
        bank, (axis,), (alarms,) = bank_of()
        bank.tick(0)
        axis.stop(12.0, report)
        for tick in range(1, 8):
            bank.tick(tick * TICK_NS)
        assert alarms == [Alarm.STOPPED] * report


def test_axes_do_not_touch_each_other() -> None:
    bank, axes, _ = bank_of(3)
    bank.tick(0)
    axes[1].run(AxisMode.VELOCITY, 12.0)
    for tick in range(1, 150):
        if tick % 10 == 0:
            axes[1].accept(0.3, 0.0, tick * TICK_NS, PERIOD_NS)
        bank.plant.step(TICK_NS * 1e-9)  # type: ignore[attr-defined]
        bank.tick(tick * TICK_NS)
    assert bank.plant.velocity == pytest.approx([0.0, 0.3, 0.0], abs=0.02)  # type: ignore[attr-defined]


@pytest.mark.parametrize(("flicker", "found"), [(True, [Alarm.SENSOR]), (False, [])])
def test_an_encoder_that_is_never_still_and_stands_still_is_frozen(flicker: bool, found: list[Alarm]) -> None:
    none = np.zeros(1, dtype=np.bool_)
    plant = LinearPlant(np.full(1, 0.5), none)
    plant.trembling = 0.0
    bank = DriveBank(servo_parameters(none), plant, TICK_NS, encoders_flicker=flicker)
    alarms: list[Alarm] = []
    bank.tick(0)
    bank.axis(0, alarms.append).run(AxisMode.POSITION, 12.0)
    for tick in range(1, 49):
        bank.tick(tick * TICK_NS)
    assert alarms == []
    for tick in range(49, 53):
        bank.tick(tick * TICK_NS)
    assert alarms[:1] == found


class FreezingPlant(LinearPlant):
    """Its encoder shows what it showed, and no velocity, once `frozen`."""

    frozen: float | None = None

    def read(self, position: Vector, velocity: Vector) -> None:
        super().read(position, velocity)
        if self.frozen is not None:
            position[0], velocity[0] = self.frozen, 0.0


@pytest.mark.parametrize(("flicker", "ticks"), [(True, range(2, 5)), (False, range(10, 16))])
def test_an_encoder_that_freezes_in_motion_is_found_before_its_joint_runs_away(flicker: bool, ticks: range) -> None:
    none = np.zeros(1, dtype=np.bool_)
    plant = FreezingPlant(np.full(1, 0.5), none)
    bank = DriveBank(servo_parameters(none), plant, TICK_NS, encoders_flicker=flicker)
    alarms: list[Alarm] = []
    axis = bank.axis(0, alarms.append)
    axis.limit(AxisLimits(-3.0, 3.0, 1.5, 6.0, 12.0, 200.0, 0.1, 0.05))
    drive_along(bank, axis, [0] * 40, velocity=1.0)
    assert alarms == []
    plant.frozen = float(plant.position[0])
    began, target = 410, 0.5 + 40 * PERIOD_NS * 1e-9
    for tick in range(began, began + 40):
        if tick % 10 == 0:
            target += PERIOD_NS * 1e-9
            axis.accept(target, 0.0, tick * TICK_NS, PERIOD_NS)
        plant.step(TICK_NS * 1e-9)
        bank.tick(tick * TICK_NS)
        if alarms:
            break
    assert alarms == [Alarm.SENSOR]
    assert tick - began + 1 in ticks
