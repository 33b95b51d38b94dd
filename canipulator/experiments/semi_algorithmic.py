"""Park's test case: the optimum of the manipulability along a circle, maximised and minimised, by a Kuhn-Tucker tracker and by CQPM."""

from __future__ import annotations

import math
import time

import numpy as np

from canipulator.experiments.base import Progress
from canipulator.experiments.semi_algorithmic_views import Ways, plane_of, plots_of, states_of
from config.errors import ConfigError
from config.kinematic import SemiAlgorithmicScenario
from logs.events import Event, Level
from logs.traces import Recorded, Trace
from stack.kinematics import ArmModel
from stack.messages import Matrix, Vector
from stack.planner.kuhn_tucker import Change, KuhnTuckerTracker, Path, Track
from stack.planner.kuhn_tucker import Event as TrackEvent
from stack.planner.measures import Manipulability
from stack.planner.monitor import Kind, Margins, joint_limits, margins
from stack.planner.singular_points import PlaneSearch, SingularPoint
from stack.planner.velocity_qp import VelocityProgramme, VelocityTrack

_ROWS = np.arange(2, dtype=np.int64)
_PLANE = (1, 2)
_BOUNDED = 1
_PART_DONE = 0.2


class SemiAlgorithmic:
    """Four runs over one lap of the circle; see `SemiAlgorithmicTable` for what is set. The judged trace is the tracker that maximises."""

    metric_names = (
        "maximise_reaches_limit_s",
        "maximise_stops_s",
        "maximise_stop_kind",
        "maximise_stop_theta3_deg",
        "minimise_reaches_limit_s",
        "minimise_leaves_limit_s",
        "minimise_closure_rad",
        "task_error_max_m",
        "qp_maximise_velocity_max_rad_s",
        "qp_maximise_jump_s",
        "qp_maximise_closure_rad",
        "qp_minimise_velocity_max_rad_s",
        "qp_minimise_closure_rad",
        "qp_minimise_second_lap_rad",
        "points_kinematic",
        "points_semi",
        "points_semi_algorithmic",
        "points_algorithmic",
        "points_misnamed",
    )

    def __init__(self, scenario: SemiAlgorithmicScenario) -> None:
        self._scenario, table = scenario, scenario.experiment
        self._arm = arm = ArmModel.load(scenario.robot)
        if arm.n != 3 or float(np.abs(arm.jacobian(arm.home)[2:5]).max()) > 1e-9:
            raise ConfigError(f"{scenario.name}: robot {scenario.robot!r} must be a planar arm of three joints")
        self._measure = Manipulability(arm, _ROWS)
        self._lower, self._upper = np.full(arm.n, -math.inf), np.full(arm.n, math.inf)
        if table.limits:  # Park's case bounds joint 2 alone; the others turn freely
            self._lower[_BOUNDED], self._upper[_BOUNDED] = arm.q_min[_BOUNDED], arm.q_max[_BOUNDED]
        self.duration_s = table.lap_s
        self._path = _circle(table.centre_m, table.radius_m, table.lap_s)

    def run(self, on_progress: Progress, duration_s: float | None = None) -> Recorded:
        """Raises ConfigError where there is no optimum near a start."""
        table, cycle_s = self._scenario.experiment, self._scenario.cycle_s
        end_s = min(table.lap_s, duration_s or math.inf)
        t_s: Vector = cycle_s * np.arange(round(end_s / cycle_s) + 1, dtype=np.float64)
        self._tracked(t_s[:2], table.start_maximise_deg, maximise=True)  # compiles, where nothing is cached yet
        began = time.perf_counter_ns()
        best = self._tracked(t_s, table.start_maximise_deg, maximise=True)
        cycle_us = 1e-3 * (time.perf_counter_ns() - began) / len(best.t)
        on_progress(_PART_DONE * end_s)
        least = self._tracked(t_s, table.start_minimise_deg, maximise=False)
        on_progress(2 * _PART_DONE * end_s)
        climbing = self._stepped(best.q[0], end_s, table.gain)
        on_progress(3 * _PART_DONE * end_s)
        falling = self._stepped(least.q[0], end_s, -table.gain)
        lap_later = self._stepped(falling.q[-1], end_s, -table.gain)
        on_progress(4 * _PART_DONE * end_s)
        search = PlaneSearch(self._measure, _PLANE, np.zeros(3), self._bounds())
        points = search.all()
        thin = slice(None, None, table.steps_per_cycle)
        ways = Ways(best, least, *(VelocityTrack(v.t[thin], v.q[thin], v.dq[thin]) for v in (climbing, falling)))
        values = {
            **_tracker_metrics(best, least),
            "task_error_max_m": max(self._task_error(ways.best.t, ways.best.q), self._task_error(least.t, least.q)),
            **_velocity_metrics(climbing, falling, lap_later),
            **self._point_metrics(points),
        }
        margins_of = {name: [self._margins(q) for q in rows] for name, _, rows in ways.named()}
        return Recorded(
            robot=self._scenario.robot,
            method="kuhn-tucker, qp",
            cycle_s=cycle_s,
            traces=tuple(self._trace(name, times, rows) for name, times, rows in ways.named()),
            plots=plots_of(ways, margins_of, self._bounds()),
            states=states_of(ways, margins_of),
            events=_events(best, least),
            maps=(plane_of(ways, points, search, self._bounds(), self._scenario.title),),
            metrics={name: values[name] for name in self.metric_names},
            cycle_us=np.full(len(best.t), cycle_us),
        )

    def _bounds(self) -> dict[int, tuple[float, float]]:
        return {_BOUNDED: (float(self._arm.q_min[_BOUNDED]), float(self._arm.q_max[_BOUNDED]))}

    def _place(self, q: Vector) -> Vector:
        place: Vector = self._arm.pose(q)[:2, 3]
        return place

    def _tracked(self, t_s: Vector, start_deg: tuple[float, float, float], *, maximise: bool) -> Track:
        tracker = KuhnTuckerTracker(self._measure, self._place, self._lower, self._upper, maximise=maximise)
        try:
            return tracker.track(np.radians(start_deg), self._path, t_s)
        except ValueError as error:
            raise ConfigError(f"{self._scenario.name}: experiment: {error}") from None

    def _stepped(self, start: Vector, end_s: float, gain: float) -> VelocityTrack:
        programme = VelocityProgramme(self._measure, self._place, self._lower, self._upper, gain)
        steps = round(end_s / self._scenario.cycle_s) * self._scenario.experiment.steps_per_cycle
        return programme.track(start, self._path, np.linspace(0.0, end_s, steps + 1))

    def _trace(self, name: str, t_s: Vector, q: Matrix) -> Trace:
        return Trace(name, t_s, q, np.array([self._arm.pose(row) for row in q]))

    def _task_error(self, t_s: Vector, q: Matrix) -> float:
        off = [self._place(row) - self._path.position(t) for t, row in zip(t_s.tolist(), q, strict=True)]
        return float(np.abs(off).max())

    def _margins(self, q: Vector) -> Margins:
        return margins(self._measure.at(q), joint_limits(q, self._lower, self._upper, self._arm.padding))

    def _point_metrics(self, points: list[SingularPoint]) -> dict[str, float]:
        """How many of each kind (regular ones, whole torus), and how many of all that the monitor calls by another name."""
        counts = {kind: sum(p.kind is kind and p.regular for p in points) for kind in Kind}
        misnamed = 0
        for point in points:
            q = np.append(0.0, point.q)
            free = np.full(q.size, math.inf)
            found_without = math.isnan(point.bound) and not point.inside
            lower, upper = (-free, free) if found_without else (self._arm.q_min, self._arm.q_max)
            limits = joint_limits(q, lower, upper, self._arm.padding)
            misnamed += margins(self._measure.at(q), limits).kind(1e-6) is not point.kind
        return {
            "points_kinematic": float(counts[Kind.KINEMATIC]),
            "points_semi": float(counts[Kind.SEMI]),
            "points_semi_algorithmic": float(counts[Kind.SEMI_ALGORITHMIC]),
            "points_algorithmic": float(counts[Kind.ALGORITHMIC]),
            "points_misnamed": float(misnamed),
        }


def _circle(centre: tuple[float, float], radius: float, lap_s: float) -> Path:
    """One lap in lap_s, clockwise, from the point nearest to the base on."""
    rate = 2.0 * math.pi / lap_s

    def position(t: float) -> Vector:
        return np.array([centre[0] - radius * math.cos(rate * t), centre[1] - radius * math.sin(rate * t)])

    def velocity(t: float) -> Vector:
        return radius * rate * np.array([math.sin(rate * t), -math.cos(rate * t)])

    return Path(position, velocity)


def _first(track: Track, change: Change) -> TrackEvent | None:
    return next((event for event in track.events if event.change is change), None)


def _closure(q: Matrix) -> float:
    return float(np.abs(q[-1] - q[0]).max())


def _tracker_metrics(best: Track, least: Track) -> dict[str, float | None]:
    stop = _first(best, Change.STOPPED)
    reached, passed, left = (
        _first(best, Change.REACHED_LIMIT),
        _first(least, Change.REACHED_LIMIT),
        _first(least, Change.LEFT_LIMIT),
    )
    return {
        "maximise_reaches_limit_s": None if reached is None else reached.t,
        "maximise_stops_s": None if stop is None else stop.t,
        "maximise_stop_kind": None if stop is None else float(stop.kind),
        "maximise_stop_theta3_deg": None
        if stop is None
        else math.degrees(math.remainder(float(stop.q[2]), 2.0 * math.pi)),
        "minimise_reaches_limit_s": None if passed is None else passed.t,
        "minimise_leaves_limit_s": None if left is None else left.t,
        "minimise_closure_rad": _closure(least.q) if least.finished else None,
    }


def _velocity_metrics(climbing: VelocityTrack, falling: VelocityTrack, later: VelocityTrack) -> dict[str, float | None]:
    speed = np.abs(climbing.dq).max(axis=1)
    return {
        "qp_maximise_velocity_max_rad_s": float(speed.max()),
        "qp_maximise_jump_s": float(climbing.t[speed.argmax()]),
        "qp_maximise_closure_rad": _closure(climbing.q),
        "qp_minimise_velocity_max_rad_s": float(np.abs(falling.dq).max()),
        "qp_minimise_closure_rad": _closure(falling.q),
        "qp_minimise_second_lap_rad": float(np.abs(later.q[-1] - falling.q[-1]).max()),
    }


def _events(best: Track, least: Track) -> tuple[Event, ...]:
    found = []
    for source, track in (("maximise", best), ("minimise", least)):
        for event in track.events:
            level = Level.WARN if event.change is Change.STOPPED else Level.INFO
            kind = event.kind.name.lower().replace("_", " ")
            where = ", ".join(f"{angle:.2f}" for angle in np.degrees(event.q))
            text = f"{event.change.value} at ({where}) degrees, a singularity of kind: {kind}"
            found.append(Event(round(1e9 * event.t), level, source, text))
    return tuple(sorted(found, key=lambda event: event.t_ns))
