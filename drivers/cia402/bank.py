"""The loops of many drives in one: a bank ticks all its axes in a few compiled calls, each drive holds one axis of it.

Order of a tick at time t: read the encoders, check them, take the set points of the last SYNC, loops and limits,
supervision, write the command that holds over [t, t + dt]. Set points are those of the end of the tick, t + dt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np

from drivers.cia402.axis_watch import (
    FLICKER_S,
    NO_DEADLINE,
    UNSEEN_LIMIT_S,
    Alarm,
    sense,
    supervise,
    watch_table,
)
from drivers.cia402.bank_axis import BankAxis
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


class DriveBank:
    """n axes on one plant. `parameters` gives the gains; the limits in it are those until a drive sets its own. `encoders_flicker`:
    the plant's position encoders are so fine that they never show the same twice, and one that does is broken.

    `tick(t_ns)` is called every `dt_ns` by whoever steps the plant. The arrays `position`, `velocity`, `set_point`,
    `command` (n,) may be read at any time.
    """

    def __init__(
        self, parameters: ServoParameters, plant: Plant, dt_ns: int = 1_000_000, *, encoders_flicker: bool = False
    ) -> None:
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
        self.mode_changed = True
        self.limited = np.zeros(count, dtype=np.int64)
        self.deadline_ns = np.full(count, NO_DEADLINE, dtype=np.int64)
        self.target: Vector = np.zeros(count)
        self.offset: Vector = np.zeros(count)
        self.zero: Vector = np.zeros(count)
        self.watch = watch_table(count)
        if encoders_flicker:
            self.watch[UNSEEN_LIMIT_S, ~parameters.outputs_velocity] = FLICKER_S
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
        if sense(
            self.raw_position,
            self._raw_velocity,
            self.zero,
            self.position,
            self.velocity,
            self._alarms,
            self.mode,
            self.watch,
            self.servo.dt_s,
        ):
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
            self.command,
            self._flags,
            self.limited,
            self._alarms,
            self.servo.dt_s,
        ):
            self._report()
        if self.mode_changed:
            self.mode_changed = False
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
        sync_ns, dt_ns = min(self._sync_ns, t_ns), self.dt_ns  # a tick that is made up for in real time may be older
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
        sense(zeros, zeros, zeros, zeros.copy(), zeros.copy(), ints.copy(), ints, self.watch.copy(), self.servo.dt_s)
        supervise(
            self.watch.copy(),
            self.deadline_ns.copy(),
            0,
            ints,
            zeros,
            zeros,
            self.set_point,
            zeros,
            ints,
            ints.copy(),
            ints.copy(),
            self.servo.dt_s,
        )
