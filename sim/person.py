"""A person who takes the gripper by the hand and leads it: a spring and damper to a hand that goes its own way.

f = K (x_hand - x_TCP) + D (v_hand - v_TCP),   ‖f‖ no more than the person's strength
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from sim.physics import Physics
from stack.messages import Vector

_STREAM = 0x9E


class HandPath(Protocol):
    """Where the hand wants to be: offset (3,) m in the world from where it gripped, and velocity (3,), at `t` s after that."""

    def at(self, t: float) -> tuple[Vector, Vector]: ...


class Waypoints:
    """A recorded way: through all points at their times on a cubic spline, from rest to rest; before and after it the hand rests."""

    def __init__(self, times: Sequence[float], offsets: Sequence[Sequence[float]]) -> None:
        t, x = np.asarray(times, np.float64), np.asarray(offsets, np.float64)
        if len(t) < 2 or x.shape != (len(t), 3):
            raise ValueError(f"person: {len(t)} times and offsets of shape {x.shape}: must be at least 2, and (n, 3)")
        if not np.all(np.diff(t) > 0.0):
            raise ValueError(f"person: times {t.tolist()} must increase")
        self.duration = float(t[-1])
        self._start = float(t[0])
        spline = CubicSpline(t, x, bc_type="clamped")
        self._position, self._velocity = spline, spline.derivative()
        self._ends = x[0], x[-1]

    def at(self, t: float) -> tuple[Vector, Vector]:
        if t <= self._start:
            return self._ends[0], np.zeros(3)
        if t >= self.duration:
            return self._ends[1], np.zeros(3)
        return self._position(t), self._velocity(t)


class Wandering:
    """A smooth random way, the same for the same seed: from corner to corner of a box by minimum-jerk strokes no faster than `speed`.

    The hand starts in the middle of the box of `size` (3,) m (full lengths), and returns there at the end of `duration` s.
    """

    def __init__(self, seed: int, size: Sequence[float], speed: float, duration: float) -> None:
        if not (speed > 0.0 and duration > 0.0 and min(size) >= 0.0 and max(size) > 0.0):
            raise ValueError(f"person: box {list(size)} m, speed {speed} m/s, duration {duration} s: must be positive")
        random = np.random.default_rng([seed, _STREAM])
        half = 0.5 * np.asarray(size, np.float64)
        points, times = [np.zeros(3)], [0.0]
        while True:
            goal = half * random.uniform(-1.0, 1.0, 3)
            here = times[-1] + _stroke_s(points[-1], goal, speed)
            home = here + _stroke_s(goal, np.zeros(3), speed)
            if home > duration:
                break
            points.append(goal)
            times.append(here)
        points.append(np.zeros(3))
        times.append(times[-1] + _stroke_s(points[-2], points[-1], speed))
        self._points, self._times = np.array(points), np.array(times)
        self.duration = times[-1]

    def at(self, t: float) -> tuple[Vector, Vector]:
        if t >= self.duration or t <= 0.0:
            return (self._points[-1] if t > 0.0 else self._points[0]), np.zeros(3)
        i = int(np.searchsorted(self._times, t, "right")) - 1
        span = self._times[i + 1] - self._times[i]
        s = (t - self._times[i]) / span
        way = self._points[i + 1] - self._points[i]
        return (
            self._points[i] + way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
            way * (30.0 * s**2 * (1.0 - s) ** 2 / span),
        )


def _stroke_s(start: Vector, end: Vector, speed: float) -> float:
    """Duration of a minimum-jerk stroke whose fastest moment is `speed`: its peak is 15/8 of its mean. Short ones take their time."""
    return max(1.875 * float(np.linalg.norm(end - start)) / speed, SHORTEST_S)


SHORTEST_S = 0.6


@dataclass(frozen=True)
class PersonParameters:
    """A hand and its way. `lets_go_s` None: never."""

    path: HandPath
    stiffness: float = 500.0
    """N/m"""
    damping: float = 20.0
    """N·s/m"""
    strength: float = 150.0
    """N"""
    grips_s: float = 0.0
    """s after the start of the run"""
    lets_go_s: float | None = None

    def __post_init__(self) -> None:
        if not (self.stiffness > 0.0 and self.damping >= 0.0 and self.strength > 0.0):
            raise ValueError(
                f"person: stiffness {self.stiffness}, damping {self.damping}, strength {self.strength}:"
                " must be positive, damping may be 0"
            )
        if self.lets_go_s is not None and self.lets_go_s <= self.grips_s:
            raise ValueError(f"person: lets_go_s = {self.lets_go_s} must be later than grips_s = {self.grips_s}")


class Person:
    """Call `act` before every step. `position` (3,): where the hand is; `force` (3,): what it does to the gripper; world axes."""

    def __init__(self, physics: Physics, parameters: PersonParameters) -> None:
        self.parameters = parameters
        self.position: Vector = np.array(physics.hand()[4])
        self.force: Vector = np.zeros(3)
        self._physics = physics
        self._steps = 0
        self._gripped_at: Vector | None = None

    def act(self) -> None:
        """Before a step: push at the gripper."""
        person, physics = self.parameters, self._physics
        step_s = physics.parameters.step_s
        t = self._steps * step_s - person.grips_s
        self._steps += 1
        if t < -0.5 * step_s:
            return
        if person.lets_go_s is not None and t >= person.lets_go_s - person.grips_s - 0.5 * step_s:
            self.force = np.zeros(3)
            return
        hand = physics.hand()
        tcp, velocity = np.array(hand[4]), np.array(hand[6])
        if self._gripped_at is None:
            self._gripped_at = tcp
        offset, rate = person.path.at(t)
        self.position = self._gripped_at + offset
        force = person.stiffness * (self.position - tcp) + person.damping * (rate - velocity)
        size = float(np.linalg.norm(force))
        self.force = force if size <= person.strength else force * (person.strength / size)
        physics.push(self.force)
