"""All joints together on a straight line between two configurations, from rest to rest: the plain way, through whatever lies on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stack.messages import Vector


@dataclass(frozen=True, slots=True, eq=False)
class StraightPath:
    """Quintic in time from `start` to `goal` (n,), velocity and acceleration zero at both ends."""

    start: Vector
    goal: Vector
    duration_s: float

    def at(self, t_s: float) -> tuple[Vector, Vector]:
        """Position and velocity (n,)."""
        u = min(max(t_s / self.duration_s, 0.0), 1.0)
        share = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        pace = 30.0 * u * u * (1.0 - u) ** 2 / self.duration_s
        way = self.goal - self.start
        return self.start + share * way, pace * way


_PEAK_VELOCITY = 1.875
_PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)


def straight_path(start: Vector, dq: Vector, goal: Vector, dq_max: Vector, ddq_max: Vector) -> StraightPath | str:
    """The quickest one within `dq_max`, `ddq_max` (n,); from rest only."""
    if np.abs(dq).max() > 1e-6:
        return "a straight way begins at rest; the arm is moving"
    way = np.abs(goal - start)
    by_velocity = float((_PEAK_VELOCITY * way / dq_max).max())
    by_acceleration = float(np.sqrt(_PEAK_ACCELERATION * way / ddq_max).max())
    return StraightPath(start, goal, max(by_velocity, by_acceleration, 0.1))
