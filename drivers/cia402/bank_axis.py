"""One axis of a bank of drives: what a drive may ask of it, and tell it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.cia402.axis_watch import (
    AWAITS_STOP,
    DECELERATION,
    LOWER,
    NO_DEADLINE,
    OUTSIDE_S,
    RATE_MARGIN,
    RATE_S,
    RATE_WINDOW,
    SPEED_LIMIT,
    STANDING_S,
    TOO_FAST_S,
    UPPER,
    WINDOW,
    WINDOW_TIME_S,
)
from stack.servo.state import AxisMode

if TYPE_CHECKING:
    from drivers.cia402.bank import DriveBank


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """What one axis keeps to, SI (rad or m; N·m or N). Position limits may be infinite, `following_error` too."""

    lower: float
    upper: float
    velocity: float
    acceleration: float
    quick_stop_deceleration: float
    torque: float
    following_error: float
    following_error_time_s: float


class BankAxis:
    """One axis of a bank, as its drive handles it. Changes are in force from the next tick on."""

    def __init__(self, bank: DriveBank, index: int) -> None:
        self._bank = bank
        self.index = index
        self.outputs_velocity = bool(bank.settings["outputs_velocity"][index])

    @property
    def position(self) -> float:
        return self._bank.position.item(self.index)

    @property
    def velocity(self) -> float:
        return self._bank.velocity.item(self.index)

    @property
    def following_error(self) -> float:
        """Set point less position."""
        return self._bank.set_point.item(self.index) - self._bank.position.item(self.index)

    @property
    def torque(self) -> float:
        """Torque commanded to the plant; 0 for a velocity-controlled axis, whose torque nobody knows."""
        return 0.0 if self.outputs_velocity else self._bank.command.item(self.index)

    @property
    def mode(self) -> AxisMode:
        return AxisMode(self._bank.mode.item(self.index))

    def limit(self, limits: AxisLimits) -> None:
        """New limits."""
        bank, index = self._bank, self.index
        for name, value in (
            ("lower", limits.lower),
            ("upper", limits.upper),
            ("velocity_limit", limits.velocity),
            ("acceleration_limit", limits.acceleration),
            ("stop_deceleration", limits.quick_stop_deceleration),
            ("torque_limit", limits.torque),
        ):
            bank.settings[name][index] = value
        bank.settings_changed = True
        bank.watch[LOWER, index] = limits.lower
        bank.watch[UPPER, index] = limits.upper
        bank.watch[SPEED_LIMIT, index] = limits.velocity
        bank.watch[DECELERATION, index] = limits.quick_stop_deceleration
        bank.watch[WINDOW, index] = limits.following_error
        bank.watch[WINDOW_TIME_S, index] = limits.following_error_time_s
        if self.outputs_velocity:
            bank.watch[RATE_WINDOW, index] = RATE_MARGIN * limits.velocity

    def run(self, mode: AxisMode, deceleration: float) -> None:
        """Follow set points; `deceleration` brakes the axis when they stay away."""
        self._switch(mode)
        self._decelerate_with(deceleration)
        self._bank.watch[AWAITS_STOP, self.index] = 0.0

    def stop(self, deceleration: float, report: bool) -> None:
        """Brake the set point, then hold. `report`: an alarm STOPPED tells when the axis stands."""
        self._switch(AxisMode.STOP)
        self._decelerate_with(deceleration)
        self._bank.watch[AWAITS_STOP, self.index] = float(report)
        self._bank.watch[STANDING_S, self.index] = 0.0

    def off(self) -> None:
        """No torque, at once."""
        self._switch(AxisMode.OFF)
        self._bank.command[self.index] = 0.0
        self._bank.watch[AWAITS_STOP, self.index] = 0.0
        self._bank.deadline_ns[self.index] = NO_DEADLINE

    def accept(self, target: float, offset: float, sync_ns: int, period_ns: int) -> None:
        """Set point of the SYNC at `sync_ns`, to be reached one period later; rad, rad/s or N·m, as the mode wants."""
        bank, index = self._bank, self.index
        bank.target[index] = target
        bank.offset[index] = offset
        bank.received(period_ns, sync_ns)[index] = True

    def expect_sync(self, deadline_ns: int | None) -> None:
        """Alarm SYNC_LOST once the tick time has passed `deadline_ns`; None: no watch."""
        self._bank.deadline_ns[self.index] = NO_DEADLINE if deadline_ns is None else deadline_ns

    def take_flags(self) -> int:
        """LIMITED_* and OVERDUE bits of all ticks since the last call."""
        flags = self._bank.limited.item(self.index)
        self._bank.limited[self.index] = 0
        return flags

    def seed(self) -> None:
        """Set point = where the axis is and how fast it moves: what comes next begins there."""
        state, index = self._bank.servo.state, self.index
        state.set_point[index] = state.nominal[index] = self._bank.position[index]
        state.set_velocity[index] = self._bank.velocity[index]

    def forgive(self) -> None:
        """The times that alarms need begin anew: one that comes again has got worse since, or has not got better."""
        self._bank.watch[[OUTSIDE_S, TOO_FAST_S, RATE_S], self.index] = 0.0

    def make_home(self, position: float) -> None:
        """The present place is called `position` from now on."""
        bank, index = self._bank, self.index
        bank.zero[index] = bank.raw_position[index] - position
        bank.position[index] = position
        self.seed()

    def _switch(self, mode: AxisMode) -> None:
        self._bank.mode[self.index] = int(mode)
        self._bank.mode_changed = True

    def _decelerate_with(self, deceleration: float) -> None:
        if self._bank.settings["stop_deceleration"][self.index] != deceleration:
            self._bank.settings["stop_deceleration"][self.index] = deceleration
            self._bank.settings_changed = True
