"""What one platform cycle commands: what the platform would like to drive, within its limits, and back onto its way."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stack.kinematics.arm import ArmState
from stack.messages import Restriction, Vector
from stack.planner.odometry import PlatformPose, PlatformRate
from stack.planner.parameters import Limits, Preferences

PLATFORM_DELAY_S = 0.15
"""Platform cycle, dead time and lag of the wheels together."""
_STANDSTILL = 1e-3
_FULL_SPEED = 0.05
_ALONG, _ACROSS, _TURN = 1.0, 3.0, 1.5


@dataclass(frozen=True, slots=True)
class PlatformCommand:
    """Platform rate of one platform cycle and whether a limit of the platform shaped it."""

    rate: PlatformRate
    restrictions: Restriction = Restriction.NONE


def platform_wish(model: ArmState, slow_twist: Vector, wish: Preferences) -> tuple[float, float]:
    """Preferred v and ω (4.1.3): feed-forward of the slow TCP command, and the P-controller of the heading (Fig. 4.7)."""
    velocity = model.rotation @ slow_twist[:3]
    speed = math.hypot(velocity[0], velocity[1])
    v = wish.platform_speed + wish.platform_feed_forward * float(velocity[0])
    if speed < _STANDSTILL:
        return v, 0.0
    error = _wrapped(math.atan2(velocity[1], velocity[0]) - wish.platform_angle)
    # The direction of a vanishing velocity means nothing: fade the controller in with the speed.
    fade = min(1.0, speed / _FULL_SPEED)
    omega = min(max(wish.platform_gain * error, -wish.platform_max_rate), wish.platform_max_rate)
    return v, fade * omega


def accelerated(wanted: PlatformRate, current: PlatformRate, limits: Limits, period_s: float) -> PlatformCommand:
    """`wanted` within the platform's speed limits, v and ω scaled together so that the curvature stays, and its accelerations."""
    share = min(1.0, limits.v_max / max(abs(wanted.v), 1e-12), limits.omega_max / max(abs(wanted.omega), 1e-12))
    v = _towards(share * wanted.v, current.v, limits.dv_max * period_s)
    omega = _towards(share * wanted.omega, current.omega, limits.domega_max * period_s)
    limited = abs(v - wanted.v) + abs(omega - wanted.omega) > 1e-9
    return PlatformCommand(PlatformRate(v, omega), Restriction.PLATFORM if limited else Restriction.NONE)


def following(wanted: PlatformRate, target: PlatformPose, pose: PlatformPose) -> PlatformRate:
    """`wanted` plus what takes the platform from `pose` back to `target` on its way (Kanayama et al. 1990)."""
    dx, dy = target.x - pose.x, target.y - pose.y
    cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
    ahead, aside = cosine * dx + sine * dy, cosine * dy - sine * dx
    turn = _wrapped(target.heading - pose.heading)
    v = wanted.v * math.cos(turn) + _ALONG * ahead
    return PlatformRate(v, wanted.omega + _TURN * turn + _ACROSS * wanted.v * aside)


def _towards(wanted: float, current: float, step: float) -> float:
    return min(max(wanted, current - step), current + step)


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)
