"""A velocity-controlled drive wheel as platforms have them: slow, late, limited in acceleration, and it slips.

    command -> dead time -> first-order lag -> acceleration limit -> wheel speed u
    joint speed = u (1 - s),  encoder increment = joint increment / (1 - s)

The joint of the model rolls without slipping, hence it stands for the way over ground; the encoder sits on the wheel
that turns too far, and cannot see the slip s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stack.messages import Vector
from stack.servo.compiled import compiled


@dataclass(frozen=True)
class WheelPlantParameters:
    """Both wheels of the platform."""

    bandwidth_hz: float = 2.5
    dead_time_s: float = 0.040
    acceleration: float = 8.0
    """rad/s² of the wheel"""
    peak_torque: float = 30.0
    """N·m"""

    def __post_init__(self) -> None:
        for name in ("bandwidth_hz", "acceleration", "peak_torque"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"wheel {name} = {getattr(self, name)}: must be positive")
        if not self.dead_time_s >= 0.0:
            raise ValueError(f"wheel dead_time_s = {self.dead_time_s}: must be 0 or positive")


@compiled
def _follow(command: Vector, lagged: Vector, speed: Vector, share: float, change: float) -> None:
    for i in range(command.shape[0]):
        lagged[i] += share * (command[i] - lagged[i])
        speed[i] += min(max(lagged[i] - speed[i], -change), change)


@compiled
def _turn(
    angle: Vector, rate: Vector, last: Vector, slip: Vector, encoder: Vector, encoder_rate: Vector
) -> None:
    for i in range(angle.shape[0]):
        encoder[i] += (angle[i] - last[i]) / (1.0 - slip[i])
        encoder_rate[i] = rate[i] / (1.0 - slip[i])
        last[i] = angle[i]


class WheelPlant:
    """Velocity commands in; joint velocity targets and encoder readings out."""

    def __init__(self, parameters: WheelPlantParameters, dt_s: float, count: int = 2) -> None:
        self.parameters = parameters
        delay = round(parameters.dead_time_s / dt_s)
        self._delay_line = np.zeros((delay + 1, count))
        self._head = 0
        self._share = -math.expm1(-2.0 * math.pi * parameters.bandwidth_hz * dt_s)
        self._change = parameters.acceleration * dt_s
        self._lagged = np.zeros(count)
        self._last = np.zeros(count)
        self.speed: Vector = np.zeros(count)
        """Speed that the wheels are driven at (n,), rad/s, before slip."""
        self.encoder: Vector = np.zeros(count)
        """Encoder angle (n,), rad."""
        self.encoder_rate: Vector = np.zeros(count)
        """Encoder velocity (n,), rad/s."""

    def zero(self, angle: Vector) -> None:
        """Stand still at joint angle `angle` (n,); encoders read 0."""
        for array in (self._delay_line, self._lagged, self.speed, self.encoder, self.encoder_rate):
            array[...] = 0.0
        self._last[:] = angle

    def drive(self, command: Vector) -> None:
        """One tick: `speed` from the commanded wheel velocity (n,), rad/s."""
        line = self._delay_line
        line[self._head] = command
        self._head = (self._head + 1) % len(line)
        _follow(line[self._head], self._lagged, self.speed, self._share, self._change)

    def sense(self, angle: Vector, rate: Vector, slip: Vector) -> None:
        """Encoders after a step in which the joints moved to `angle` with slip ratio `slip`, all (n,)."""
        _turn(angle, rate, self._last, slip, self.encoder, self.encoder_rate)
