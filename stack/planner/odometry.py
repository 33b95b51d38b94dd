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
class Odometry:
    """Wheel angles of the last reading (None before the first), pose then, mean rate of the period before it and its trend.

    `missed`: periods since that reading; a lost frame costs accuracy, not the platform's pose.
    """

    wheels: tuple[float, float] | None = None
    pose: PlatformPose = PlatformPose(0.0, 0.0, 0.0)
    rate: PlatformRate = PlatformRate(0.0, 0.0)
    trend: PlatformRate = PlatformRate(0.0, 0.0)
    missed: int = 0

    def without_reading(self) -> Odometry:
        """One period later, nothing heard."""
        return replace(self, missed=self.missed + 1)

    def update(self, platform: PlatformParameters, left: float, right: float, period_s: float) -> Odometry:
        """One period later, with new wheel angles (rad). `trend` is the low-passed change of the rate (per s)."""
        if self.wheels is None:
            return replace(self, wheels=(left, right), missed=0)
        # The map from wheel rates to platform rates is linear: it maps wheel angles to arc and turn as well.
        distance, turn = platform_twist(platform, left - self.wheels[0], right - self.wheels[1])
        elapsed = (self.missed + 1) * period_s
        rate = PlatformRate(distance / elapsed, turn / elapsed)
        trend = PlatformRate(
            self.trend.v + _TREND_WEIGHT * ((rate.v - self.rate.v) / elapsed - self.trend.v),
            self.trend.omega + _TREND_WEIGHT * ((rate.omega - self.rate.omega) / elapsed - self.trend.omega),
        )
        return Odometry((left, right), advance(self.pose, distance, turn), rate, trend)

    def ahead(self, periods: int, period_s: float) -> PlatformPose:
        """Pose `periods` from now, extrapolated with rate and trend.

        The measured rate is the mean of the period before the reading, its middle half a period ago; the mean of the i-th period
        ahead lies i periods after that.
        """
        pose = self.pose
        for i in range(1, periods + self.missed + 1):
            lead = i * period_s
            v, omega = self.rate.v + self.trend.v * lead, self.rate.omega + self.trend.omega * lead
            pose = advance(pose, v * period_s, omega * period_s)
        return pose


_TREND_WEIGHT = 0.4
"""Weight of one difference of rates in the trend: quick enough for the wheels' 64 ms, dull enough for encoder noise."""
