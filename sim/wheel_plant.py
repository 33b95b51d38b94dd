"""A velocity-controlled drive wheel as platforms have them: slow, late, limited in acceleration, and it slips.

    command -> dead time -> first-order lag -> acceleration limit -> wheel speed u
    joint speed follows u (1 - s),  encoder increment = joint increment / (1 - s)

The joint of the model rolls without slipping, hence it stands for the way over ground; the encoder sits on the wheel
that turns too far, and cannot see the slip s.

The joint is driven by a torque: a stiff proportional-integral velocity loop with the platform's inertia fed forward.
A velocity motor of PyBullet would do too, but its solver rows make a step half as dear again, and a parked platform
creeps more (0.08 instead of 0.0002 mm/s).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stack.compiled import compiled
from stack.messages import Vector


@dataclass(frozen=True)
class WheelPlantParameters:
    """Both wheels of the platform."""

    bandwidth_hz: float = 2.5
    dead_time_s: float = 0.040
    acceleration: float = 8.0
    """rad/s² of the wheel"""
    velocity_gain: float = 80.0
    """N·m·s/rad; with a wheel in the air (0.11 kg·m²) an explicit loop at 1 kHz stands up to 220"""
    integral_gain: float = 1600.0
    """N·m/rad"""
    inertia: float = 0.75
    """kg·m², what one wheel has to accelerate: half the robot's mass times the radius squared, and its own"""
    peak_torque: float = 30.0
    """N·m"""

    def __post_init__(self) -> None:
        for name in ("bandwidth_hz", "acceleration", "peak_torque"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"wheel {name} = {getattr(self, name)}: must be positive")
        if not self.dead_time_s >= 0.0:
            raise ValueError(f"wheel dead_time_s = {self.dead_time_s}: must be 0 or positive")


@compiled
def _follow(
    command: Vector,
    rate: Vector,
    slip: Vector,
    share: float,
    change: float,
    gains: Vector,
    lagged: Vector,
    speed: Vector,
    integral: Vector,
    effort: Vector,
) -> None:
    for i in range(command.shape[0]):
        lagged[i] += share * (command[i] - lagged[i])
        before = speed[i]
        speed[i] += min(max(lagged[i] - speed[i], -change), change)
        driven = speed[i] * (1.0 - slip[i])
        error = driven - rate[i]
        torque = gains[0] * error + integral[i] + gains[1] * error + gains[2] * (speed[i] - before)
        if abs(torque) <= gains[3]:
            integral[i] += gains[1] * error
        effort[i] = min(max(torque, -gains[3]), gains[3])


@compiled
def _turn(angle: Vector, rate: Vector, last: Vector, slip: Vector, encoder: Vector, encoder_rate: Vector) -> None:
    for i in range(angle.shape[0]):
        encoder[i] += (angle[i] - last[i]) / (1.0 - slip[i])
        encoder_rate[i] = rate[i] / (1.0 - slip[i])
        last[i] = angle[i]


class WheelPlant:
    """Velocity commands in; torques on the wheel joints and encoder readings out."""

    def __init__(self, parameters: WheelPlantParameters, dt_s: float, count: int = 2) -> None:
        self.parameters = parameters
        self.dt_s = dt_s
        delay = round(parameters.dead_time_s / dt_s)
        self._delay_line = np.zeros((delay + 1, count))
        self._head = 0
        self._share = -math.expm1(-2.0 * math.pi * parameters.bandwidth_hz * dt_s)
        self._change = parameters.acceleration * dt_s
        self._lagged = np.zeros(count)
        self._last = np.zeros(count)
        self._integral = np.zeros(count)
        self._gains = np.array(
            [
                parameters.velocity_gain,
                parameters.integral_gain * dt_s,
                parameters.inertia / dt_s,
                parameters.peak_torque,
            ]
        )
        self.effort: Vector = np.zeros(count)
        """Torque on each wheel joint over the coming step (n,), N·m."""
        self.speed: Vector = np.zeros(count)
        """Speed that the wheels are driven at (n,), rad/s, before slip."""
        self.encoder: Vector = np.zeros(count)
        """Encoder angle (n,), rad."""
        self.encoder_rate: Vector = np.zeros(count)
        """Encoder velocity (n,), rad/s."""

    def zero(self, angle: Vector) -> None:
        """Stand still at joint angle `angle` (n,); encoders read 0, torques stay."""
        for array in (self._delay_line, self._lagged, self.speed, self.encoder, self.encoder_rate):
            array[...] = 0.0
        self._last[:] = angle

    def drive(self, command: Vector, rate: Vector, slip: Vector) -> None:
        """One tick: `speed` and `effort` from commanded wheel velocity, joint velocity (rad/s) and slip, each (n,)."""
        line = self._delay_line
        line[self._head] = command
        self._head = (self._head + 1) % len(line)
        _follow(
            line[self._head],
            rate,
            slip,
            self._share,
            self._change,
            self._gains,
            self._lagged,
            self.speed,
            self._integral,
            self.effort,
        )

    def sense(self, angle: Vector, rate: Vector, slip: Vector) -> None:
        """Encoders after a step in which the joints moved to `angle` with slip ratio `slip`, all (n,)."""
        _turn(angle, rate, self._last, slip, self.encoder, self.encoder_rate)
