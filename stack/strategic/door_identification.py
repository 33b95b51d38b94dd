"""Axis and radius of a hinged door from the way of its handle: a circle in space, fitted to all points of the way at once.

Orthogonal distances (total least squares: there is no independent coordinate), Gauss-Newton, one iteration per call from where the last
call ended; the first guess enters as a prior with its own uncertainty, so that the fit exists from the first point on and the guess is
forgotten at the pace at which the way says more than it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stack.messages import Matrix, Vector

UNKNOWNS = 6
"""Centre (3), two tilts of the axis, radius."""


@dataclass(frozen=True, slots=True, eq=False)
class Hinge:
    """A circle: the handle's. `centre` (3,) on the axis at the handle's height, `axis` (3,) unit, `radius` m. A positive angle turns by
    the right hand about the axis."""

    centre: Vector
    axis: Vector
    radius: float

    def outward(self, point: Vector) -> Vector:
        """Unit vector (3,) across the axis from it to `point` (3,)."""
        arm = self._across(point)
        return arm / max(float(np.linalg.norm(arm)), 1e-9)

    def tangent(self, point: Vector) -> Vector:
        """Unit vector (3,): where the handle at `point` goes for a positive angle."""
        return np.cross(self.axis, self.outward(point))

    def angle(self, start: Vector, point: Vector) -> float:
        """The turn about the axis from `start` to `point` (3,), in (−π, π]."""
        a, b = self._across(start), self._across(point)
        return float(np.arctan2(self.axis @ np.cross(a, b), a @ b))

    def _across(self, point: Vector) -> Vector:
        arm: Vector = point - self.centre
        return arm - (self.axis @ arm) * self.axis


@dataclass(frozen=True, slots=True)
class Prior:
    """How much the guess is worth, and the points: standard deviations of centre and radius as a share of the radius, of the axis'
    direction (rad), and of a point's distance from the circle (m), errors that neighbours share included."""

    place: float = 0.3
    radius: float = 0.3
    tilt: float = 0.3
    point_m: float = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """What is known: `guess` where it began, `hinge` the present estimate, `points` (n, 3) of the way, at least `spacing_m` apart;
    `deviation` (6,) standard deviations of centre (m), tilts (rad), radius (m)."""

    guess: Hinge
    hinge: Hinge
    prior: Prior
    points: Matrix
    deviation: Vector

    @classmethod
    def starting(cls, guess: Hinge, prior: Prior) -> Identification:
        """From a guess alone."""
        return cls(guess, guess, prior, np.empty((0, 3)), _spread(guess, prior))

    @property
    def radius_known(self) -> float:
        """Standard deviation of the radius as a share of it."""
        return float(self.deviation[5]) / self.hinge.radius

    def with_point(self, point: Vector, spacing_m: float = 0.003) -> Identification:
        """The identification with `point` (3,) of the handle's way; itself if the last one is nearer than `spacing_m`."""
        if len(self.points) and float(np.linalg.norm(point - self.points[-1])) < spacing_m:
            return self
        points = np.vstack([self.points, point])
        hinge, information = _iterate(self.hinge, self.guess, self.prior, points)
        deviation = np.sqrt(np.diag(np.linalg.inv(information)))
        return Identification(self.guess, hinge, self.prior, points, deviation)


def _spread(guess: Hinge, prior: Prior) -> Vector:
    place = prior.place * guess.radius
    return np.array([place, place, place, prior.tilt, prior.tilt, prior.radius * guess.radius])


def _iterate(hinge: Hinge, guess: Hinge, prior: Prior, points: Matrix) -> tuple[Hinge, Matrix]:
    """One Gauss-Newton step; the better hinge, and the information matrix (6, 6) in the axes of the old one."""
    first, second = _basis(hinge.axis)
    arm = points - hinge.centre
    height = arm @ hinge.axis
    across = arm - np.outer(height, hinge.axis)
    distance = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
    outward = across / distance[:, None]
    count = len(points)
    rows = np.zeros((2 * count, UNKNOWNS))
    rows[:count, :3] = -outward
    rows[:count, 3] = -height * (outward @ first)
    rows[:count, 4] = -height * (outward @ second)
    rows[:count, 5] = -1.0
    rows[count:, :3] = -hinge.axis
    rows[count:, 3] = arm @ first
    rows[count:, 4] = arm @ second
    off = np.concatenate([distance - hinge.radius, height])
    weight = 1.0 / prior.point_m**2
    trust = 1.0 / _spread(guess, prior) ** 2
    leaning = guess.axis / max(float(guess.axis @ hinge.axis), 0.1) - hinge.axis
    back = np.concatenate(
        [guess.centre - hinge.centre, [first @ leaning, second @ leaning, guess.radius - hinge.radius]]
    )
    information = weight * rows.T @ rows + np.diag(trust)
    step = np.linalg.solve(information, trust * back - weight * rows.T @ off)
    limit = min(1.0, 0.2 * hinge.radius / max(float(np.linalg.norm(step[[0, 1, 2, 5]])), 1e-12))
    step = limit * step
    axis = hinge.axis + step[3] * first + step[4] * second
    centre = hinge.centre + step[:3]
    return Hinge(centre, axis / np.linalg.norm(axis), max(float(hinge.radius + step[5]), 0.05)), information


def _basis(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors (3,) across `axis` and across each other."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)
