"""Dead reckoning of the platform from its wheel encoders, and where it will be when a command takes effect.

The planner needs no self-localisation (spec 3.10-3.15): the odometry frame is only a common base for "what the platform really
does" between a measurement and a command. Slip is not in it; the drift estimate (`drift.py`) carries that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from stack.kinematics.platform import platform_twist
from stack.kinematics.robot_file import PlatformParameters


class PlatformPose(NamedTuple):
    """x, y (m), heading (rad) of the platform's reference point in the odometry frame."""

    x: float
    y: float
    heading: float


class PlatformRate(NamedTuple):
    """Forward speed v (m/s) and yaw rate omega (rad/s)."""

    v: float
    omega: float


def advance(pose: PlatformPose, distance: float, turn: float) -> PlatformPose:
    """Along a circular arc of length `distance` (m) and angle `turn` (rad); exact for constant v and ω."""
    half = 0.5 * turn
    chord = distance * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0)
    direction = pose.heading + half
    return PlatformPose(pose.x + chord * math.cos(direction), pose.y + chord * math.sin(direction), pose.heading + turn)


@dataclass(frozen=True, slots=True)
class WheelModel:
    """How the wheels follow: `dead_time_s`, then a first-order lag of `bandwidth_hz`. Both act alike on wheels, v and ω."""

    bandwidth_hz: float
    dead_time_s: float

    def share(self, duration_s: float) -> float:
        """Part of the way to the command that is covered in `duration_s`."""
        return -math.expm1(-2.0 * math.pi * self.bandwidth_hz * duration_s)


@dataclass(frozen=True, slots=True)
class Odometry:
    """Wheel angles of the last reading (None before the first), pose then, and the mean rate of the period before it.

    `missed`: periods since that reading; a lost frame costs accuracy, not the platform's pose. `commands`: the rates
    commanded in the last cycles, newest last. What comes next is predicted from the commands, not from differences of
    readings: the arm's reaction shakes the wheels, and feeding that back to the arm makes both of them hum.
    """

    wheels: tuple[float, float] | None = None
    pose: PlatformPose = PlatformPose(0.0, 0.0, 0.0)
    rate: PlatformRate = PlatformRate(0.0, 0.0)
    missed: int = 0
    commands: tuple[PlatformRate, ...] = ()

    def without_reading(self) -> Odometry:
        """One period later, nothing heard."""
        return replace(self, missed=self.missed + 1)

    def update(self, platform: PlatformParameters, left: float, right: float, period_s: float) -> Odometry:
        """One period later, with new wheel angles (rad)."""
        if self.wheels is None:
            return replace(self, wheels=(left, right), missed=0)
        # The map from wheel rates to platform rates is linear: it maps wheel angles to arc and turn as well.
        distance, turn = platform_twist(platform, left - self.wheels[0], right - self.wheels[1])
        elapsed = (self.missed + 1) * period_s
        rate = PlatformRate(distance / elapsed, turn / elapsed)
        return Odometry((left, right), advance(self.pose, distance, turn), rate, 0, self.commands)

    def commanded(self, rate: PlatformRate) -> Odometry:
        """With the command of this cycle remembered."""
        commands = (*self.commands[1 - _HISTORY :], rate)
        return Odometry(self.wheels, self.pose, self.rate, self.missed, commands)

    def ahead(self, periods: int, period_s: float, model: WheelModel) -> PlatformPose:
        """Pose `periods` from now.

        The measured rate is the mean of the period before the reading, its middle half a period ago; from there the model follows the
        commands that are on their way.
        """
        return self.path(periods, period_s, model)[-1]

    def path(self, periods: int, period_s: float, model: WheelModel) -> list[PlatformPose]:
        """`ahead` of 0, 1, … `periods`, at the cost of the last."""
        pose, (v, omega) = self.pose, self.rate
        share = model.share(period_s)
        poses = [pose]
        for i in range(1 - self.missed, periods + 1):
            aim = self._on_its_way(i - 1.0, period_s, model)
            v, omega = v + share * (aim.v - v), omega + share * (aim.omega - omega)
            pose = advance(pose, v * period_s, omega * period_s)
            poses.append(pose)
        return poses[self.missed :]

    def acceleration(self, period_s: float, model: WheelModel) -> PlatformRate:
        """Rate of change of v and ω now, as the model has it (m/s², rad/s²)."""
        aim = self._on_its_way(0.0, period_s, model)
        slope = 2.0 * math.pi * model.bandwidth_hz
        return PlatformRate(slope * (aim.v - self.rate.v), slope * (aim.omega - self.rate.omega))

    def _on_its_way(self, lead: float, period_s: float, model: WheelModel) -> PlatformRate:
        """The command that reaches the wheels' lag `lead` periods from now.

        The command of cycle j is a ramp between SYNC j + 1 and j + 2, and takes the dead time besides; the newest one here is of the cycle
        before this one.
        """
        if not self.commands:
            return PlatformRate(0.0, 0.0)
        age = max(0.0, 0.5 + model.dead_time_s / period_s - lead)
        newer = min(int(age), len(self.commands) - 1)
        older = min(newer + 1, len(self.commands) - 1)
        u = age - int(age)
        a, b = self.commands[-1 - newer], self.commands[-1 - older]
        return PlatformRate(a.v + u * (b.v - a.v), a.omega + u * (b.omega - a.omega))


_HISTORY = 64
