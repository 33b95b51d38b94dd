"""The loops of many drives in one: a bank ticks all its axes in a few compiled calls, each drive holds one axis of it.

Order of a tick at time t: read the encoders, check them, take the set points of the last SYNC, loops and limits,
supervision, write the command that holds over [t, t + dt]. Set points are those of the end of the tick, t + dt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from drivers.cia402.axis_watch import (
    AWAITS_STOP,
    DECELERATION,
    LOWER,
    NO_DEADLINE,
    SPEED_LIMIT,
    STANDING_S,
    UPPER,
    WINDOW,
    WINDOW_TIME_S,
    Alarm,
    sense,
    supervise,
    watch_table,
)
from stack.messages import Vector
from stack.servo.servo import Servo
from stack.servo.state import AxisMode, BoolVector, ServoParameters

SUSPICIOUS_PERIODS = 10


class Plant(Protocol):
    """What the drives of a bank are bolted to; (n,) arrays in the order of the axes, SI units."""

    def read(self, position: Vector, velocity: Vector) -> None:
        """Fills in place what the encoders show."""

    def write(self, command: Vector) -> None:
        """Torque or force, velocity for velocity-controlled axes; holds until the next call."""


@runtime_checkable
class Braked(Protocol):
    """A plant with holding brakes."""

    def brake(self, engaged: BoolVector) -> None:
        """Called when a brake has to change: engaged while its axis is without power."""


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


class DriveBank:
    """n axes on one plant. `parameters` gives the gains; the limits in it are those until a drive sets its own.

    `tick(t_ns)` is called every `dt_ns` by whoever steps the plant. The arrays `position`, `velocity`, `set_point`,
    `command` (n,) may be read at any time.
    """

    def __init__(self, parameters: ServoParameters, plant: Plant, dt_ns: int = 1_000_000) -> None:
        count = parameters.count
        self.count = count
        self.dt_ns = dt_ns
        self.plant = plant
        self.servo = Servo(parameters, dt_ns * 1e-9)
        self.position: Vector = np.zeros(count)
        self.velocity: Vector = np.zeros(count)
        self.command: Vector = np.zeros(count)
        self.set_point: Vector = self.servo.state.set_point
        self.mode = np.full(count, int(AxisMode.OFF), dtype=np.int64)
        self.limited = np.zeros(count, dtype=np.int64)
        self.deadline_ns = np.full(count, NO_DEADLINE, dtype=np.int64)
        self.target: Vector = np.zeros(count)
        self.offset: Vector = np.zeros(count)
        self.zero: Vector = np.zeros(count)
        self.watch = watch_table(count)
        self.settings = {name: np.array(value) for name, value in vars(parameters).items()}
        self.settings_changed = False
        self.raw_position: Vector = np.zeros(count)
        self._raw_velocity: Vector = np.zeros(count)
        self._flags = np.zeros(count, dtype=np.int64)
        self._alarms = np.zeros(count, dtype=np.int64)
        self._on_alarm: list[Callable[[Alarm], None] | None] = [None] * count
        self._received: dict[int, BoolVector] = {}
        self._sync_ns = -1
        self._segment_ns = 0
        self._brakes = plant if isinstance(plant, Braked) else None
        self._engaged = np.zeros(count, dtype=np.bool_)
        self._compile()

    def axis(self, index: int, on_alarm: Callable[[Alarm], None]) -> BankAxis:
        """The axis for one drive, whose alarms go to `on_alarm`. Raises ValueError if it has been given away."""
        if not 0 <= index < self.count or self._on_alarm[index] is not None:
            raise ValueError(f"axis {index}: must be one of 0 … {self.count - 1} that no other drive has")
        self._on_alarm[index] = on_alarm
        return BankAxis(self, index)

    def tick(self, t_ns: int) -> None:
        """One tick of all loops; the plant has been stepped to `t_ns`."""
        self.plant.read(self.raw_position, self._raw_velocity)
        if sense(self.raw_position, self._raw_velocity, self.zero, self.position, self.velocity, self._alarms):
            self._report()
        if self.settings_changed:
            self.settings_changed = False
            self.servo.configure(ServoParameters(**self.settings))
        if self._sync_ns >= 0:
            self._accept(t_ns)
        self.servo.tick(self.mode, self.position, self.velocity, self.command, self._flags)
        if supervise(
            self.watch,
            self.deadline_ns,
            t_ns,
            self.mode,
            self.position,
            self.velocity,
            self.set_point,
            self._flags,
            self.limited,
            self._alarms,
            self.servo.dt_s,
        ):
            self._report()
        if self._brakes is not None:
            self._set_brakes(self._brakes)
        self.plant.write(self.command)

    def received(self, period_ns: int, sync_ns: int) -> BoolVector:
        """Mask of the axes that get a new set point with the SYNC at `sync_ns`, for the caller to mark his own."""
        self._sync_ns = sync_ns
        mask = self._received.get(period_ns)
        if mask is None:
            mask = self._received[period_ns] = np.zeros(self.count, dtype=np.bool_)
        return mask

    def _accept(self, t_ns: int) -> None:
        """Starts the segments of the last SYNC in all axes that got a target with it."""
        for period_ns, mask in self._received.items():
            if mask.any():
                elapsed_ns = t_ns - self._segment_start(t_ns, period_ns)
                self.servo.accept(self.mode, mask, self.target, self.offset, period_ns * 1e-9, elapsed_ns * 1e-9)
                mask[:] = False
        self._sync_ns = -1

    def _segment_start(self, t_ns: int, period_ns: int) -> int:
        """When the present segment began, as the loops see it: at the tick in which its SYNC fell.

        A SYNC comes as late as the bus is busy. As long as that is less than a tick, segments follow each other at
        exactly their period; a drift beyond is followed slowly, so that jitter does not get into the velocity.
        """
        sync_ns, dt_ns = self._sync_ns, self.dt_ns
        periods = (sync_ns - self._segment_ns + period_ns // 2) // period_ns
        if not 1 <= periods <= SUSPICIOUS_PERIODS:
            self._segment_ns = t_ns - -(-(t_ns - sync_ns) // dt_ns) * dt_ns
            return self._segment_ns
        start_ns = self._segment_ns + periods * period_ns
        error_ns = sync_ns - start_ns
        if error_ns < 0:
            start_ns += error_ns // 8
        elif error_ns > dt_ns:
            start_ns += (error_ns - dt_ns) // 8
        self._segment_ns = start_ns
        return start_ns

    def _report(self) -> None:
        for index in np.flatnonzero(self._alarms):
            on_alarm = self._on_alarm[index]
            if on_alarm is not None:
                on_alarm(Alarm(int(self._alarms[index])))

    def _set_brakes(self, plant: Braked) -> None:
        engaged = self.mode == AxisMode.OFF
        if not np.array_equal(engaged, self._engaged):
            self._engaged = engaged
            plant.brake(engaged.copy())

    def _compile(self) -> None:
        """Compile (or load from the cache) now rather than in the first tick."""
        zeros, ints = np.zeros(self.count), np.zeros(self.count, dtype=np.int64)
        sense(zeros, zeros, zeros, zeros.copy(), zeros.copy(), ints.copy())
        supervise(
            self.watch.copy(),
            self.deadline_ns.copy(),
            0,
            ints,
            zeros,
            zeros,
            self.set_point,
            ints,
            ints.copy(),
            ints.copy(),
            self.servo.dt_s,
        )


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

    def run(self, mode: AxisMode, deceleration: float) -> None:
        """Follow set points; `deceleration` brakes the axis when they stay away."""
        self._bank.mode[self.index] = int(mode)
        self._decelerate_with(deceleration)
        self._bank.watch[AWAITS_STOP, self.index] = 0.0

    def stop(self, deceleration: float, report: bool) -> None:
        """Brake the set point, then hold. `report`: an alarm STOPPED tells when the axis stands."""
        self._bank.mode[self.index] = int(AxisMode.STOP)
        self._decelerate_with(deceleration)
        self._bank.watch[AWAITS_STOP, self.index] = float(report)
        self._bank.watch[STANDING_S, self.index] = 0.0

    def off(self) -> None:
        """No torque, at once."""
        self._bank.mode[self.index] = int(AxisMode.OFF)
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

    def make_home(self, position: float) -> None:
        """The present place is called `position` from now on."""
        bank, index = self._bank, self.index
        bank.zero[index] = bank.raw_position[index] - position
        bank.position[index] = position
        self.seed()

    def _decelerate_with(self, deceleration: float) -> None:
        if self._bank.settings["stop_deceleration"][self.index] != deceleration:
            self._bank.settings["stop_deceleration"][self.index] = deceleration
            self._bank.settings_changed = True
