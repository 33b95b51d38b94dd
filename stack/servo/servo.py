"""The servo loops of a bank of drives: parameters, state, and the two calls that move them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stack.messages import Vector
from stack.servo.cascade import accept_all, tick_all
from stack.servo.state import AxisMode, BoolVector, ServoParameters, ServoState

IntVector = NDArray[np.int64]


class Servo:
    """n servo axes that tick together every `dt_s` (s).

    All arrays are (n,), C-contiguous, float64 (int64 for modes and flags, bool for `received`). Same parameters and
    same calls give the same bits.
    """

    def __init__(self, parameters: ServoParameters, dt_s: float) -> None:
        if not dt_s > 0.0:
            raise ValueError(f"servo dt_s = {dt_s}: must be positive")
        self.parameters = parameters
        self.dt_s = dt_s
        self.state = ServoState(parameters.count)
        self._parameter_table = parameters.table()
        self._compile(parameters.count)

    def configure(self, parameters: ServoParameters) -> None:
        """New settings from the next tick on; set points and integrals stay. Raises ValueError if n differs."""
        if parameters.count != self.parameters.count:
            raise ValueError(f"servo has {self.parameters.count} axes, parameters are for {parameters.count}")
        self.parameters = parameters
        self._parameter_table[:] = parameters.table()

    def accept(
        self,
        mode: IntVector,
        received: BoolVector,
        target: Vector,
        offset: Vector,
        period_s: float,
        elapsed_s: float = 0.0,
    ) -> None:
        """Take the set points that a SYNC makes valid, on the axes where `received`.

        `target` is rad (POSITION), rad/s (VELOCITY) or N·m (TORQUE); `offset` is N·m. Both are reached `period_s` after
        the SYNC. `elapsed_s` is the time between the SYNC and the end of the tick computed last: 0 if the tick of the
        same instant comes after, one tick if it came before. An axis without a new target goes on with the velocity it
        has for one more period, then brakes at `stop_deceleration` (flag OVERDUE). OFF ignores everything, STOP all but
        the offset.
        """
        accept_all(self.state.table, mode, received, target, offset, period_s, elapsed_s)

    def tick(self, mode: IntVector, position: Vector, velocity: Vector, output: Vector, flags: IntVector) -> None:
        """One tick of every loop, from the encoders `position` (rad) and `velocity` (rad/s).

        Fills in place `output` (N·m, or rad/s of velocity outputs), which holds until the next tick, and `flags`
        (LIMITED_*, OVERDUE, STANDSTILL bits of stack.servo).
        """
        tick_all(self.state.table, self._parameter_table, mode, position, velocity, self.dt_s, output, flags)

    def _compile(self, count: int) -> None:
        """Compile (or load from the cache) now rather than in the first tick."""
        table, zeros = self.state.table.copy(), np.zeros(count)
        mode, flags = np.full(count, int(AxisMode.OFF), dtype=np.int64), np.zeros(count, dtype=np.int64)
        accept_all(table, mode, np.ones(count, dtype=np.bool_), zeros, zeros, 1.0, 0.0)
        tick_all(table, self._parameter_table, mode, zeros, zeros, self.dt_s, zeros.copy(), flags)
