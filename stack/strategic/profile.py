"""A speed profile along one coordinate: smooth ramp up, cruise, smooth ramp down."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RampProfile:
    """Distance over time with cubic smoothstep ramps of `ramp_s`; velocity and acceleration continuous but at the ends.

    Covers exactly `length` (sign = direction) in `duration_s`. Where the length is too short to reach `speed`, the cruise
    vanishes and the speed is what fits.
    """

    length: float
    speed: float
    ramp_s: float

    def __post_init__(self) -> None:
        if self.speed <= 0.0 or self.ramp_s <= 0.0:
            raise ValueError(f"speed {self.speed} and ramp_s {self.ramp_s} must be positive")

    @property
    def cruise_speed(self) -> float:
        """The speed between the ramps, ≥ 0."""
        return min(self.speed, abs(self.length) / self.ramp_s)

    @property
    def duration_s(self) -> float:
        """Time from rest to rest; 0 for no length."""
        return abs(self.length) / self.cruise_speed + self.ramp_s if self.length else 0.0

    def position(self, t: float) -> float:
        """Distance covered at `t` (s), clamped to the ends."""
        if not self.length:
            return 0.0
        total, ramp, speed = self.duration_s, self.ramp_s, self.cruise_speed
        t = min(max(t, 0.0), total)
        if t < ramp:
            covered = speed * ramp * _ramp_integral(t / ramp)
        elif t <= total - ramp:
            covered = speed * (t - 0.5 * ramp)
        else:
            covered = abs(self.length) - speed * ramp * _ramp_integral((total - t) / ramp)
        return covered if self.length > 0.0 else -covered

    def mean_velocity(self, t: float, dt: float) -> float:
        """Mean velocity over [t, t + dt]: summed over the samples it gives exactly `length`."""
        return (self.position(t + dt) - self.position(t)) / dt


def _ramp_integral(u: float) -> float:
    """∫ of smoothstep 3u² − 2u³ from 0 to u."""
    return u * u * u * (1.0 - 0.5 * u)
