"""Follows the constrained optimum of a measure along a path: Sung's Kuhn-Tucker tracker, to rounding.

While the task x(t) is met, the redundancy stays where H is largest (or smallest) under the joint limits. With the active limits a, the
robot solves  f(q) = x(t),  g_a(q) = 0,  Z_a ∇H = 0  (Z_a: null-space base of [J; ∇g_a]), the multipliers μ of the active limits keep the
sign that presses the optimum against them, and the active set changes where a limit is reached or a multiplier passes through zero:
on a semi algorithmic singularity. Beyond one that cannot be passed no optimum is left that hangs together with the way so far: the
tracker stops there, and says on what kind of singularity.

Source: Park, Chang, Lee (the tracker as they use it); an implementation as predictor and corrector with located events, not an ODE.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.optimize import brentq

from stack.messages import Matrix, Vector
from stack.planner.measures import Measure
from stack.planner.monitor import Kind, joint_limits, margins
from stack.planner.monitor_kernels import projected_curvature

_TOLERANCE = 1e-13
_ROUNDS = 30
_FURTHEST = 0.4
_SMALLEST_STEP = 1e-10
_AFTER = 1e-7

Active = tuple[int, ...]
"""Active limits by the rows of `joint_limits`: 0 … n − 1 the lower, n … 2n − 1 the upper ones."""


class Change(Enum):
    """What happens to a track at an event."""

    REACHED_LIMIT = "reached a limit"
    LEFT_LIMIT = "left a limit"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """A change of a track at time `t` (s) in configuration `q` (n,), on a singularity of `kind`; `limit`: row of `joint_limits`, −1."""

    t: float
    q: Vector
    change: Change
    kind: Kind
    limit: int


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """t (k,), q (k, n), multiplier (k,) of the first active limit (0 without one), the events, and whether the path's end was reached."""

    t: Vector
    q: Matrix
    multiplier: Vector
    events: tuple[Event, ...]
    finished: bool


@dataclass(frozen=True, slots=True)
class Path:
    """A task in time: position (m,) and velocity (m,) at t in s."""

    position: Callable[[float], Vector]
    velocity: Callable[[float], Vector]


class KuhnTuckerTracker:
    """One robot and one measure. `place`: f(q) (m,), the task that `measure` belongs to; `lower`, `upper` (n,): joint limits;
    `maximise`: False to follow the smallest H."""

    def __init__(
        self, measure: Measure, place: Callable[[Vector], Vector], lower: Vector, upper: Vector, *, maximise: bool
    ) -> None:
        self._measure, self._place = measure, place
        self._lower, self._upper = lower, upper
        self._direction = 1.0 if maximise else -1.0

    def track(self, start: Vector, path: Path, times: Vector) -> Track:
        """The optimum from near `start` (n,) at times[0] on, one row per time, rows at events added; ends early where it stops.

        Raises ValueError where there is no optimum near `start`.
        """
        active = tuple(int(i) for i in np.flatnonzero(self._violation(start) >= 0.0))
        q = self._solve(start, path.position(float(times[0])), active)
        if q is None or not self._optimal(q, active):
            raise ValueError(
                f"start {start.tolist()}: no {'maximum' if self._direction > 0 else 'minimum'} of H near it"
            )
        rows = [(float(times[0]), q, self._multiplier(q, active))]
        events: list[Event] = []
        t = float(times[0])
        for target in times[1:].tolist():
            while t < target:
                event = self._advance(t, q, active, path, target)
                if event is None:
                    moved = self._solve(q, path.position(target), active)
                    assert moved is not None  # `_advance` has been there
                    t, q = target, moved
                    rows.append((t, q, self._multiplier(q, active)))
                    continue
                events.append(event)
                t, q = event.t, event.q
                if t > rows[-1][0]:
                    rows.append((t, q, self._multiplier(q, active)))
                if event.change is Change.STOPPED:
                    return _track(rows, events, finished=False)
                active = _changed(active, event)
        return _track(rows, events, finished=True)

    def _advance(self, t: float, q: Vector, active: Active, path: Path, target: float) -> Event | None:
        """The first event in (t, target], or None."""
        after = self._solve(q, path.position(target), active)
        if after is None or not self._optimal(after, active):
            return self._narrowed(t, q, active, path, target)
        reached = [i for i in np.flatnonzero(self._violation(after) > 0.0).tolist() if i not in active]
        left = [i for i in active if self._direction * self._pressure(after, active)[i] < 0.0]
        if not reached and not left:
            return None
        when, i = min((self._when(t, q, active, path, target, self._crossing(i, active)), i) for i in (*reached, *left))
        there = self._solve(q, path.position(when), active)
        there = q if there is None else there
        if i in reached:
            there = self._solve(there, path.position(when), _sorted(active, i))
            assert there is not None
            return Event(when, there, Change.REACHED_LIMIT, self._kind(there), i)
        freed = tuple(a for a in active if a != i)
        change = Change.LEFT_LIMIT if self._leaves(there, i, freed, path, when) else Change.STOPPED
        return Event(when, there, change, self._kind(there), i)

    def _narrowed(self, t: float, q: Vector, active: Active, path: Path, target: float) -> Event | None:
        """Where the optimum ends within (t, target]: bisected; an event before that comes first."""
        good, bad, last = t, target, q
        while bad - good > _SMALLEST_STEP:
            middle = 0.5 * (good + bad)
            found = self._solve(last, path.position(middle), active)
            if found is not None and self._optimal(found, active):
                event = self._advance(good, last, active, path, middle)
                if event is not None:
                    return event
                good, last = middle, found
            else:
                bad = middle
        return Event(good, last, Change.STOPPED, self._kind(last, nearest=True), -1)

    def _crossing(self, limit: int, active: Active) -> Callable[[Vector], float]:
        """What turns positive where an inactive limit is reached, or where an active one is left."""
        if limit in active:
            return lambda q: -self._direction * self._pressure(q, active)[limit]
        return lambda q: float(self._violation(q)[limit])

    def _when(
        self,
        t: float,
        q: Vector,
        active: Active,
        path: Path,
        target: float,
        crossing: Callable[[Vector], float],
    ) -> float:
        """The time in [t, target] at which `crossing`, positive at target, becomes so."""
        if crossing(q) >= 0.0:
            return t

        def value(when: float) -> float:
            found = self._solve(q, path.position(when), active)
            return crossing(q if found is None else found)

        return float(brentq(value, t, target, xtol=1e-15, rtol=8.9e-16))

    def _leaves(self, q: Vector, limit: int, freed: Active, path: Path, t: float) -> bool:
        """Whether the optimum without `limit` is one, and goes away from that limit."""
        rows, _, free = self._system(q, freed)
        if free.size and not self._definite(free):
            return False
        wanted = np.zeros(q.size)
        velocity = path.velocity(t)
        wanted[: velocity.size] = velocity
        rate = np.linalg.solve(rows, wanted)
        sign, joint = (-1.0, limit) if limit < q.size else (1.0, limit - q.size)
        return bool(sign * rate[joint] <= 0.0)

    def _solve(self, q: Vector, target: Vector, active: Active) -> Vector | None:
        """The optimum near q with these limits active: Newton's method; None where it does not come to rest nearby."""
        start, m = q, target.size
        bounds = np.concatenate((self._lower, self._upper))[list(active)]
        joints = [i % q.size for i in active]
        for _ in range(_ROUNDS):
            rows, motion, _ = self._system(q, active)
            off = np.concatenate((self._place(q) - target, q[joints] - bounds, motion))
            for k, i in enumerate(active):
                rows[m + k] = 0.0
                rows[m + k, i % q.size] = 1.0
            try:
                step = np.linalg.solve(rows, -off)
            except np.linalg.LinAlgError:
                return None
            length = float(np.abs(step).max())
            q = q + step * min(1.0, 0.2 / max(length, 1e-300))
            if not np.isfinite(length) or float(np.abs(q - start).max()) > _FURTHEST:
                return None
            if length < _TOLERANCE:
                q[joints] = bounds
                return q
        return q if length < 1e-9 else None

    def _system(self, q: Vector, active: Active) -> tuple[Matrix, Vector, Matrix]:
        """[J; ∇g_a; ∇(Z_a h)] (n, n), Z_a h (r,) and C_AS (r, r) in the motion that the active limits leave."""
        local = self._measure.at(q)
        n, k = q.size, len(active)
        normal = _normals(n, active)
        null, rows, _ = projected_curvature(
            local.jacobian, local.derivative, local.gradient, local.hessian, normal, np.zeros((k, n, n))
        )
        return np.vstack((local.jacobian, normal, rows)), null @ local.gradient, rows @ null.T

    def _pressure(self, q: Vector, active: Active) -> dict[int, float]:
        """Multipliers of the active limits, positive where H grows beyond them."""
        local = self._measure.at(q)
        n, m = q.size, local.jacobian.shape[0]
        _, _, multipliers = projected_curvature(
            local.jacobian, local.derivative, local.gradient, local.hessian, _normals(n, active),
            np.zeros((len(active), n, n)),
        )  # fmt: skip
        return dict(zip(active, multipliers[m:].tolist(), strict=True))

    def _multiplier(self, q: Vector, active: Active) -> float:
        return self._pressure(q, active)[active[0]] if active else 0.0

    def _optimal(self, q: Vector, active: Active) -> bool:
        """Whether the stationary point is the wanted optimum of the motion that is left."""
        curvature = self._system(q, active)[2]
        return curvature.size == 0 or self._definite(curvature)

    def _definite(self, curvature: Matrix) -> bool:
        values = np.linalg.eigvalsh(0.5 * (curvature + curvature.T))
        return bool((self._direction * values < 0.0).all())

    def _violation(self, q: Vector) -> Vector:
        return np.concatenate((self._lower - q, q - self._upper))

    def _kind(self, q: Vector, *, nearest: bool = False) -> Kind:
        """The singularity that q is on; the nearest one for the end of an optimum, which is located less sharply."""
        found = margins(self._measure.at(q), joint_limits(q, self._lower, self._upper, np.full(q.size, 0.1)))
        return found.nearest if nearest else found.kind(_AFTER)


def _normals(n: int, active: Active) -> Matrix:
    rows = np.zeros((len(active), n))
    for k, i in enumerate(active):
        rows[k, i % n] = -1.0 if i < n else 1.0
    return rows


def _sorted(active: Active, limit: int) -> Active:
    return tuple(sorted((*active, limit)))


def _changed(active: Active, event: Event) -> Active:
    if event.change is Change.REACHED_LIMIT:
        return _sorted(active, event.limit)
    return tuple(i for i in active if i != event.limit)


def _track(rows: list[tuple[float, Vector, float]], events: list[Event], *, finished: bool) -> Track:
    t, q, multiplier = zip(*rows, strict=True)
    return Track(np.array(t), np.array(q), np.array(multiplier), tuple(events), finished)
