"""Paths that a platform can be bound to (4.1.2): a line, a circle, a spline, each by arc length s, |r'(s)| = 1.

Pure geometry in the path's own frame: at s = 0 it is at the origin and points along x. Where that frame lies is somebody else's business
(`path_following.py`). Curvature κ (1/m) is positive to the left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from stack.messages import Vector

ENDLESS = 1e6
"""m; a path that goes on for so long has no end."""
LEAST_RADIUS = 0.1
"""m; a platform that has to bend its way more sharply turns on the spot instead."""
_NODES = 64
_ITERATIONS = 12


class PathPoint(NamedTuple):
    """A point of a path: x, y (m), heading of its tangent (rad, continuous along the path), curvature κ (1/m)."""

    x: float
    y: float
    heading: float
    curvature: float


class PlatformPath(Protocol):
    """A curve by arc length between `start` ≤ 0 and `end` ≥ 0 (m).

    `sharpest`: the largest |κ| (1/m); `steepest`: the largest |dκ/ds| (1/m²).
    """

    @property
    def start(self) -> float: ...
    @property
    def end(self) -> float: ...
    @property
    def sharpest(self) -> float: ...
    @property
    def steepest(self) -> float: ...

    def at(self, s: float) -> PathPoint:
        """The point at s, which is taken as the nearer end where it lies beyond."""

    def closest(self, x: float, y: float, near: float) -> float:
        """s of the point that is locally closest to (x, y), looked for from `near` on; never beyond the ends."""


@dataclass(frozen=True, slots=True)
class LinePath:
    """Straight ahead along x, from `start` to `end`."""

    start: float = -ENDLESS
    end: float = ENDLESS

    def __post_init__(self) -> None:
        _check_ends(self.start, self.end)

    @property
    def sharpest(self) -> float:
        return 0.0

    @property
    def steepest(self) -> float:
        return 0.0

    def at(self, s: float) -> PathPoint:
        return PathPoint(min(max(s, self.start), self.end), 0.0, 0.0, 0.0)

    def closest(self, x: float, y: float, near: float) -> float:
        return min(max(x, self.start), self.end)


@dataclass(frozen=True, slots=True)
class CirclePath:
    """A circle of |`radius`| m, its centre to the left for a positive one; s may go round any number of times."""

    radius: float
    start: float = -ENDLESS
    end: float = ENDLESS

    def __post_init__(self) -> None:
        if not abs(self.radius) >= LEAST_RADIUS:
            raise ValueError(f"radius {self.radius} m: must be at least {LEAST_RADIUS} m, positive to the left")
        _check_ends(self.start, self.end)

    @property
    def sharpest(self) -> float:
        return 1.0 / abs(self.radius)

    @property
    def steepest(self) -> float:
        return 0.0

    def at(self, s: float) -> PathPoint:
        angle = min(max(s, self.start), self.end) / self.radius
        half = math.sin(0.5 * angle)
        return PathPoint(self.radius * math.sin(angle), 2.0 * self.radius * half * half, angle, 1.0 / self.radius)

    def closest(self, x: float, y: float, near: float) -> float:
        if math.hypot(x, y - self.radius) < 1e-9:  # at the centre every point is as near as any other
            return min(max(near, self.start), self.end)
        side = math.copysign(1.0, self.radius)
        angle = math.atan2(side * x, side * (self.radius - y))
        turns = math.remainder(angle - near / self.radius, 2.0 * math.pi)
        return min(max(near + self.radius * turns, self.start), self.end)


class SplinePath:
    """A smooth curve from the origin through `waypoints` (k, 2), leaving along x: cubic by chord length, read by arc length.

    κ is continuous; at the last waypoint it is 0. Raises ValueError for less than one waypoint, for two that coincide, for values that
    are not finite, and where the curve would bend more sharply than `LEAST_RADIUS`.
    """

    def __init__(self, waypoints: Sequence[tuple[float, float]]) -> None:
        points = np.vstack([np.zeros((1, 2)), np.asarray(waypoints, float).reshape(-1, 2)])
        if len(points) < 2:
            raise ValueError("a spline needs at least one waypoint")
        if not np.isfinite(points).all():
            raise ValueError(f"waypoints {points[1:].tolist()}: must be finite")
        chords = np.hypot(*np.diff(points, axis=0).T)
        if not (chords > 1e-3).all():
            number = int(np.argmin(chords)) + 1
            raise ValueError(
                f"waypoint {number} is {chords.min():.4g} m from the one before it: must be more than 0.001 m"
            )
        ends = ((1, np.array([1.0, 0.0])), (2, np.zeros(2)))
        self._curve = CubicSpline(np.concatenate([[0.0], np.cumsum(chords)]), points, bc_type=ends)
        self._first, self._second, self._third = (self._curve.derivative(order) for order in (1, 2, 3))
        self._u = np.concatenate(
            [np.linspace(a, b, _NODES, endpoint=False) for a, b in _pairs(self._curve.x)] + [self._curve.x[-1:]]
        )
        speed = np.hypot(*self._first(self._u).T)
        if speed.min() < 0.05:
            raise ValueError(f"waypoints {points[1:].tolist()}: the curve through them has a cusp")
        self._s = np.concatenate([[0.0], np.cumsum(_lengths(self._first, self._u))])
        self._du = 1.0 / speed
        self.start, self.end = 0.0, float(self._s[-1])
        self.sharpest, self.steepest = self._bends()
        if self.sharpest > 1.0 / LEAST_RADIUS:
            raise ValueError(
                f"waypoints {points[1:].tolist()}: the curve bends with a radius of {1 / self.sharpest:.3g} m; "
                f"it must be at least {LEAST_RADIUS} m"
            )
        self._headings = np.unwrap(np.arctan2(*self._first(self._u).T[::-1]))

    def at(self, s: float) -> PathPoint:
        s = min(max(s, self.start), self.end)
        u = self._parameter(s)
        (x, y), (dx, dy), (ddx, ddy) = self._curve(u).tolist(), self._first(u).tolist(), self._second(u).tolist()
        speed = math.hypot(dx, dy)
        heading = math.atan2(dy, dx)
        about = float(np.interp(s, self._s, self._headings))
        heading = about + math.remainder(heading - about, 2.0 * math.pi)
        return PathPoint(x, y, heading, (dx * ddy - dy * ddx) / speed**3)

    def closest(self, x: float, y: float, near: float) -> float:
        s = min(max(near, self.start), self.end)
        for _ in range(_ITERATIONS):
            point = self.at(s)
            cosine, sine = math.cos(point.heading), math.sin(point.heading)
            ahead = cosine * (x - point.x) + sine * (y - point.y)
            aside = cosine * (y - point.y) - sine * (x - point.x)
            # Newton on ahead(s) = 0, whose slope is κ·aside − 1; beyond the centre of curvature it would turn back.
            step = ahead / max(1.0 - point.curvature * aside, 0.5)
            before, s = s, min(max(s + step, self.start), self.end)
            if abs(s - before) < 1e-12:
                break
        return s

    def _parameter(self, s: float) -> float:
        """u of arc length s: cubic Hermite between the nodes, whose slopes du/ds are known."""
        i = min(max(int(np.searchsorted(self._s, s, "right")) - 1, 0), len(self._s) - 2)
        h = float(self._s[i + 1] - self._s[i])
        t = (s - float(self._s[i])) / h
        a, b = h * float(self._du[i]), h * float(self._du[i + 1])
        begin, way = float(self._u[i]), float(self._u[i + 1] - self._u[i])
        return begin + t * (a + t * (3.0 * way - 2.0 * a - b + t * (a + b - 2.0 * way)))

    def _bends(self) -> tuple[float, float]:
        """The largest |κ| and |dκ/ds| at the nodes."""
        (dx, dy), (ddx, ddy) = self._first(self._u).T, self._second(self._u).T
        d3x, d3y = self._third(np.minimum(self._u, self._u[-1] - 1e-9)).T
        square = dx * dx + dy * dy
        cross = dx * ddy - dy * ddx
        curvature = cross / square**1.5
        slope = (dx * d3y - dy * d3x) / square**1.5 - 3.0 * cross * (dx * ddx + dy * ddy) / square**2.5
        return float(np.abs(curvature).max()), float(np.abs(slope / np.sqrt(square)).max())


def _check_ends(start: float, end: float) -> None:
    if not start <= 0.0 <= end or start == end:
        raise ValueError(
            f"a path from {start} to {end} m: must begin at or behind 0, end at or ahead of it, and have a length"
        )


def _pairs(knots: Vector) -> list[tuple[float, float]]:
    return list(zip(knots[:-1].tolist(), knots[1:].tolist(), strict=True))


def _lengths(first: CubicSpline, u: Vector) -> Vector:
    """Arc length between neighbouring nodes, by Gauss-Legendre of order 5."""
    places, weights = np.polynomial.legendre.leggauss(5)
    half = 0.5 * np.diff(u)
    middle = 0.5 * (u[:-1] + u[1:])
    slopes = first(middle[:, None] + half[:, None] * places)
    lengths: Vector = half * (np.hypot(slopes[..., 0], slopes[..., 1]) @ weights)
    return lengths


@dataclass(frozen=True, slots=True, eq=False)
class RelativePath:
    """A path and where its frame lies, seen from the platform when it begins to follow: x, y (m), heading (rad)."""

    path: PlatformPath
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
