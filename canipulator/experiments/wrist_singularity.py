"""Schreiber's two experiments at the wrist singularity: a path under the constraint optimisation, and in closed form beside it."""

from __future__ import annotations

import time

import numpy as np

from canipulator.experiments.base import Progress
from canipulator.experiments.legs import LegPath
from canipulator.experiments.wrist_plots import wrist_plots
from config.errors import ConfigError
from config.kinematic import WristSingularityScenario
from logs.events import Event, Level
from logs.signals import StateChange
from logs.traces import Array, Recorded, Trace
from stack.kinematics import ArmModel
from stack.kinematics.se3 import pose_difference
from stack.kinematics.spherical_wrist import SphericalWrist
from stack.messages import Matrix, Vector
from stack.planner.resolvers.constraint_optimisation import GaveWay, Weights
from stack.planner.split_task import SplitStep, SplitTask, follow

_Q5 = 4
_PROGRESS_CYCLES = 50
_GAVE_WAY = {
    GaveWay.ORIENTATION_BOUND: "orientation bound gave way",
    GaveWay.TIME: "time gave way: slower on the path",
    GaveWay.TRANSLATION: "translation gave way",
}


class WristSingularity:
    """One of the two experiments; see `WristSingularityTable` for what is set.

    The judged trace follows the path by `stack.planner.split_task`; with `optimisation.enabled = false` it is the closed form.
    """

    metric_names = (
        "orientation_error_final_rad",
        "time_scaling_max",
        "optimised_cycles",
        "closed_form_q5_min_rad",
        "closed_form_velocity_share_max",
        "closed_form_step_max_rad",
        "step_max_rad",
    )

    def __init__(self, scenario: WristSingularityScenario) -> None:
        self._scenario, table = scenario, scenario.experiment
        self._arm = ArmModel.load(scenario.robot)
        where = f"{scenario.name}: experiment"
        try:
            self._wrist = SphericalWrist(self._arm)
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None
        if len(table.start) != self._arm.n:
            raise ConfigError(f"{where}.start has {len(table.start)} values, must have {self._arm.n}")
        self._start = np.array(table.start)
        for i, q in enumerate(self._start):
            low, high = self._arm.q_min[i], self._arm.q_max[i]
            if not low <= q <= high:
                name = self._arm.joint_names[i]
                raise ConfigError(f"{where}.start.{i} = {q:g} ({name}): must be within {low:.4g} to {high:.4g}")
        self._path = LegPath(self._arm.pose(self._start), table.leg, table.settle_s)
        self.duration_s = self._path.duration_s
        settings = table.optimisation
        self._task = SplitTask(
            cycle_s=scenario.cycle_s,
            weights=Weights(alpha=settings.alpha, beta=settings.beta, gamma=settings.gamma),
            error_bound=np.inf if settings.error_bound_rad is None else settings.error_bound_rad,
            iterations=settings.iterations,
            switching=settings.switching,
        )

    def run(self, on_progress: Progress, duration_s: float | None = None) -> Recorded:
        """Raises ConfigError where the path leaves the robot's reach."""
        cycle_s = self._scenario.cycle_s
        cycles = round(min(duration_s or np.inf, self._path.duration_s) / cycle_s)
        closed = self._closed_form(cycles)
        if not self._scenario.experiment.optimisation.enabled:
            return self._record(_Way.of_closed_form(closed, self._path, cycle_s), closed, "closed-form")
        way, moved_s = _Way(self._path.pose(0.0), self._start), 0.0
        self._follow(way, moved_s)  # compiled before the clock runs
        for k in range(cycles):
            began = time.perf_counter_ns()
            step = self._follow(way, moved_s)
            way.add(step, 1e-3 * (time.perf_counter_ns() - began))
            moved_s += cycle_s * (1.0 - step.time_scaling)
            if k % _PROGRESS_CYCLES == 0:
                on_progress(k * cycle_s)
        return self._record(way, closed, "qp")

    def _follow(self, way: _Way, moved_s: float) -> SplitStep:
        """The next cycle, at the path's own time `moved_s`."""
        cycle_s = self._scenario.cycle_s
        return follow(
            self._arm, self._task, way.q[-1], way.dq[-1], lambda share: self._path.pose(moved_s + share * cycle_s)
        )

    def _closed_form(self, cycles: int) -> Array:
        """(cycles + 1, 6): the way in closed form, nearest branch, limited by nothing."""
        rows = [self._start]
        for k in range(1, cycles + 1):
            try:
                rows.append(self._wrist.solve(self._path.pose(k * self._scenario.cycle_s), rows[-1]))
            except ValueError as error:
                raise ConfigError(f"{self._scenario.name}: at {k * self._scenario.cycle_s:g} s: {error}") from None
        return np.array(rows)

    def _record(self, way: _Way, closed: Array, method: str) -> Recorded:
        cycle_s = self._scenario.cycle_s
        t_s: Vector = cycle_s * np.arange(len(way.q), dtype=np.float64)
        q, goal = np.array(way.q), np.array(way.goal)
        poses = np.array([self._arm.pose(row) for row in q])
        name = "optimised" if method == "qp" else "closed form"
        judged = Trace(name, t_s, q, poses, np.array(way.dq))
        beside = Trace("closed form", t_s, closed, np.array([self._arm.pose(row) for row in closed]))
        error = np.array([pose_difference(a, b) for a, b in zip(goal, poses, strict=True)])
        theta = np.array(way.theta)
        values = (
            float(np.linalg.norm(error[-1, 3:])),
            float(theta.max()),
            float(sum(way.optimised)),
            float(np.abs(closed[:, _Q5]).min()),
            float((np.abs(beside.velocity) / self._arm.dq_max).max()),
            float(np.abs(np.diff(closed, axis=0)).max(initial=0.0)),
            float(np.abs(np.diff(q, axis=0)).max(initial=0.0)),
        )
        return Recorded(
            robot=self._scenario.robot,
            method=method,
            cycle_s=cycle_s,
            traces=(judged, beside) if method == "qp" else (judged,),
            commanded=goal,
            plots=wrist_plots(self._arm, judged, beside, error, theta, self._task.error_bound),
            states=way.states(t_s),
            events=way.events(t_s, self._path),
            metrics=dict(zip(self.metric_names, values, strict=True)),
            cycle_us=np.array(way.cycle_us),
        )


class _Way:
    """What is noted in each cycle."""

    def __init__(self, goal: Matrix, q: Vector) -> None:
        self.q, self.dq, self.goal = [q], [np.zeros_like(q)], [goal]
        self.theta, self.optimised, self.cycle_us = [0.0], [False], list[float]()
        self.status, self.messages = ["OK"], [""]
        self.gave_way = [GaveWay.NOTHING]

    @staticmethod
    def of_closed_form(closed: Array, path: LegPath, cycle_s: float) -> _Way:
        """The closed form as the way that is judged."""
        way = _Way(path.pose(0.0), closed[0])
        way.q = list(closed)
        way.dq = [np.zeros(closed.shape[1]), *(np.diff(closed, axis=0) / cycle_s)]
        way.goal = [path.pose(k * cycle_s) for k in range(len(closed))]
        way.theta, way.optimised = [0.0] * len(closed), [False] * len(closed)
        way.status, way.messages = ["OK"] * len(closed), [""] * len(closed)
        way.gave_way = [GaveWay.NOTHING] * len(closed)
        return way

    def add(self, step: SplitStep, cycle_us: float) -> None:
        """One cycle."""
        self.q.append(step.q)
        self.dq.append(step.dq)
        self.goal.append(step.goal)
        self.theta.append(step.time_scaling)
        self.optimised.append(step.optimised)
        self.status.append(step.status.name)
        self.messages.append(step.message)
        self.gave_way.append(step.gave_way)
        self.cycle_us.append(cycle_us)

    def states(self, t_s: Vector) -> tuple[StateChange, ...]:
        """Lanes `method` and `status`."""
        methods = ["optimisation" if flag else "closed form" for flag in self.optimised]
        return (*_changes("method", methods, t_s), *_changes("status", [text.lower() for text in self.status], t_s))

    def events(self, t_s: Vector, path: LegPath) -> tuple[Event, ...]:
        """Taking over, handing back, and whatever gave way."""
        found = [Event(0, Level.INFO, "path", f"begins, {path.moving_s:g} s")]
        for k in range(1, len(self.q)):
            t_ns = _ns(t_s[k])
            if self.optimised[k] != self.optimised[k - 1]:
                text = "takes over: the closed form would break a limit" if self.optimised[k] else "hands back"
                found.append(Event(t_ns, Level.INFO, "optimisation", text))
            new = self.gave_way[k] & ~self.gave_way[k - 1]
            for flag, words in _GAVE_WAY.items():
                if flag in new:
                    found.append(Event(t_ns, Level.WARN, "optimisation", f"{words} ({self.messages[k]})"))
        found.append(Event(_ns(t_s[-1]), Level.INFO, "path", "ends"))
        return tuple(found)


def _changes(lane: str, texts: list[str], t_s: Vector) -> list[StateChange]:
    return [StateChange(_ns(t_s[k]), lane, text) for k, text in enumerate(texts) if k == 0 or text != texts[k - 1]]


def _ns(t_s: float) -> int:
    return round(1e9 * t_s)
