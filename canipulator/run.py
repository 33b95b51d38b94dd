"""One lockstep run: roles on one bus, one event loop in virtual time, files, metrics, verdict."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from canipulator.collector import collector_off
from canipulator.dashboard import Dashboard, Status
from canipulator.dashboard import wanted as dashboard_wanted
from canipulator.ending import ended_by
from canipulator.fault_effects import Parts
from canipulator.fault_injection import FAULT_LOG, FaultInjector
from canipulator.judging import OWN_METRICS, check_expectations, check_scenario, overload, run_info
from canipulator.outcome import (
    EXPECTATION_MISSED,
    OK,
    Outcome,
    RunOptions,
    expectations,
    progress_bar,
    run_directory,
    show,
)
from canipulator.roles import SimulatedRobot, planner_role, simulated_robot, strategic_role
from canipulator.surroundings import objects_off_goal
from canipulator.warm_up import warm_up
from config.load import dump_scenario
from config.robot import Robot, load_robot
from config.scenario import Scenario
from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.planner_node import PlannerNode
from drivers.strategic_node import StrategicNode
from logs.bus_log import BusLogWriter
from logs.events import Event, Level
from logs.metrics import Metrics, RunFacts, evaluate
from logs.run_log import BLOCK_NS, RunLog
from stack.messages import Truth
from stack.strategic.mission import Stage

SETTLE_NS = 300_000_000
"""How long a run goes on after its mission has ended: the planner comes to rest and switches the drives off."""
CHUNK_NS = 100_000_000
LOCKSTEP_BLOCK_NS = 900_000_000
"""The run stands still while a block is written; fewer and larger ones cost less, but a run that is killed lacks no more than a second."""


def run_scenario(scenario: Scenario, options: RunOptions) -> Outcome:
    """Runs to the end of the mission, the scenario's duration, or Ctrl-C; every file is closed and readable whatever ends it.

    Raises ConfigError for what cannot be run, OSError where files cannot be written, KeyboardInterrupt after having saved everything.
    """
    robot = load_robot(scenario.robot)
    check_scenario(scenario, robot)
    check_expectations(scenario, robot)
    directory = run_directory(scenario.name, options)
    (directory / "scenario.toml").write_text(dump_scenario(scenario), encoding="utf-8")
    with LockstepRun(scenario, robot, options, directory) as run:
        interrupted = run.go()
    metrics = run.metrics(judged=options.duration_s is None and not interrupted)
    (directory / "metrics.json").write_text(metrics.to_json(), encoding="utf-8")
    if not options.quiet:
        show(metrics, directory, options)
    if interrupted:
        raise KeyboardInterrupt
    return Outcome(directory, metrics.as_dict(), OK if metrics.ok else EXPECTATION_MISSED)


class LockstepRun:
    """Everything that lives while a run goes on; a context manager that closes it."""

    def __init__(self, scenario: Scenario, robot: Robot, options: RunOptions, directory: Path) -> None:
        self.scenario, self.robot, self.options, self.directory = scenario, robot, options, directory
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock, scenario.bus.bitrate, queue_limit=scenario.bus.queue_frames)
        self.faults: list[str] = []
        self.wall_s = self.physics_s = 0.0
        self.period_ns = round(1e9 / scenario.planner.arm_cycle_hz)
        self.finished_ns: int | None = None
        self.first: Truth | None = None
        self.last: Truth | None = None
        self._timed_cycles = 0
        self._dashboard: Dashboard | None = None
        self.bus_log = BusLogWriter(directory / "bus.log", clock=self.clock, on_error=self._on_log_error)
        self.log = RunLog(
            robot.devices.values(),
            scenario.robot,
            run_info(scenario),
            sync_period_ns=self.period_ns,
            bitrate=scenario.bus.bitrate,
            platform_ratio=self._platform_ratio,
            world_reference=scenario.feedback.rate_hz > 0.0,
            recording=directory / "run.rrd" if options.record else None,
            event_log=directory / "events.log",
            detail=options.detail,
            viewer=options.viewer,
            compact=False,  # blocks are large already, it would save a twelfth
            block_ns=BLOCK_NS if options.viewer is not None or options.served is not None else LOCKSTEP_BLOCK_NS,
        )
        self.bus.observe(self.bus_log)
        self.bus.observe(self.log.on_frame)
        self.sim: SimulatedRobot = simulated_robot(robot, scenario, self.clock, self.bus)
        warm_up(robot, scenario)
        self.planner: PlannerNode = planner_role(
            robot, scenario, self.clock, self.bus, self._on_event, time.perf_counter_ns
        )
        self.strategic: StrategicNode = strategic_role(robot, scenario, self.clock, self.bus, self._on_event)
        self.fault_log: BusLogWriter | None = None
        self.injector = self._injector()
        self._time_physics()

    def __enter__(self) -> LockstepRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.bus_log.close()
        if self.fault_log is not None:
            self.fault_log.close()
        self.log.close()
        self.sim.world.close()

    def go(self) -> bool:
        """Runs to the end; True when Ctrl-C ended it."""
        end_ns = round(1e9 * (self.options.duration_s or self.scenario.duration_s))
        self.power_on()
        began = time.perf_counter()
        try:
            with (
                ended_by(signal.SIGINT) as ending,
                collector_off(),
                self._run_until() as run_until,
                self._shown(end_ns) as advance,
            ):
                while ending.signal is None and (now_ns := self.clock.now_ns()) < end_ns and not self._done():
                    run_until(min(now_ns + CHUNK_NS, end_ns))
                    self._advance(advance)
            interrupted = ending.signal is not None
        except KeyboardInterrupt:  # the second Ctrl-C, or one that a test sends
            interrupted = True
        self.wall_s = time.perf_counter() - began
        if interrupted:
            self._on_event(Level.WARN, "run", "interrupted")
        return interrupted

    def power_on(self) -> None:
        """Boots every node; from here on the clock moves everything."""
        self.sim.power_on()
        self.strategic.node.power_on()
        self.planner.power_on()
        self._sample()
        if self.injector is not None:
            self.injector.arm()

    def dashboard(self) -> Dashboard:
        """Of this run; it hears nothing yet."""
        return Dashboard(self.scenario.name, self.robot.devices.values(), self._status)

    def _status(self) -> Status:
        traffic = self.bus.statistics()
        return Status(self.clock.now_ns(), traffic.load_mean, traffic.load_peak, cycle_ns=self.planner.cycle_ns)

    @contextlib.contextmanager
    def _shown(self, end_ns: int) -> Iterator[Callable[[float, str], None]]:
        """A dashboard if one was asked for, else a progress bar."""
        if not dashboard_wanted(self.options.dashboard, quiet=self.options.quiet, real_time=False):
            with progress_bar(self.scenario.name, end_ns, quiet=self.options.quiet) as advance:
                yield advance
            return
        self._dashboard = self.dashboard()
        self.bus.observe(self._dashboard.on_frame)
        with self._dashboard.live():
            yield lambda done, at: None

    def _injector(self) -> FaultInjector | None:
        """The faults of the scenario, None if it has none."""
        sim, scenario = self.sim, self.scenario
        if sim.breakable is None:
            return None
        self.fault_log = BusLogWriter(self.directory / FAULT_LOG, clock=self.clock)
        files = {"bus.log": self.bus_log.fileno, "events.log": self.log.event_fileno}
        parts = Parts(
            self.clock,
            self.bus,
            self.robot.devices,
            sim.drives,
            sim.breakable,
            self.planner.node,
            self.strategic.node,
            files,
            self._on_event,
            self.fault_log,
        )
        return FaultInjector(scenario.fault, scenario.seed, parts)

    def _run_until(self) -> contextlib.AbstractContextManager[Callable[[int], None]]:
        """The clock's own, or one that serves the bus to tools and keeps to real time."""
        served = self.options.served
        return contextlib.nullcontext(self.clock.run_until) if served is None else served.paced(self.clock, self.bus)

    def _advance(self, advance: Callable[[float, str], None]) -> None:
        now_ns = self.clock.now_ns()
        advance(now_ns, f"{now_ns * 1e-9:.1f} s {self.planner.phase.name.lower()}")

    def _done(self) -> bool:
        """Some time after the mission's end: the planner has come to rest by then."""
        if self.strategic.stage not in (Stage.FINISHED, Stage.FAILED):
            return False
        if self.finished_ns is None:
            self.finished_ns = self.clock.now_ns()
        return self.clock.now_ns() >= self.finished_ns + SETTLE_NS

    def _sample(self) -> None:
        """Truth at every multiple of the SYNC period, after the physics of that instant."""
        now_ns = self.clock.now_ns()
        truth = self.sim.world.truth(now_ns)
        self.first = self.first or truth
        self.last = truth
        self.log.on_truth(truth)
        for pair in self.sim.world.collisions.news():
            self._on_event(Level.ERROR, "collision", f"{pair} touch")
        self._note_computing(now_ns - self.period_ns)
        self.clock.call_at(now_ns + self.period_ns, self._sample, priority=5)

    def _note_computing(self, t_ns: int) -> None:
        """How long the planner took in the cycle that began at `t_ns`, if it has computed one since the last call."""
        cycle_ns = self.planner.cycle_ns
        if len(cycle_ns) > self._timed_cycles:
            self._timed_cycles = len(cycle_ns)
            self.log.on_timing(t_ns, cycle_ns[-1])

    def _time_physics(self) -> None:
        """A stop watch around the bare physics step: what `physics_only_real_time_factor` is made of."""
        step, watch = self.sim.world.physics_step, time.perf_counter

        def timed() -> None:
            began = watch()
            step()
            self.physics_s += watch() - began

        self.sim.world.physics_step = timed

    def _on_event(self, level: Level, source: str, text: str) -> None:
        self.log.on_event(self.clock.now_ns(), level, source, text)
        if self._dashboard is not None:
            self._dashboard.on_event(Event(self.clock.now_ns(), level, source, text))
        if level >= Level.ERROR or (source == "fault" and level >= Level.WARN):
            self.faults.append(f"{source}: {text}")

    def _on_log_error(self, error: OSError) -> None:
        self._on_event(Level.ERROR, "bus.log", f"{error.strerror}: frames from here on are not in bus.log")

    @property
    def _platform_ratio(self) -> int:
        return round(self.scenario.planner.arm_cycle_hz / self.scenario.planner.platform_cycle_hz)

    def metrics(self, *, judged: bool) -> Metrics:
        """The numbers of the run, with the scenario's expectations if they are to be judged. Call after closing."""
        scenario = self.scenario
        sim_s = self.clock.now_ns() * 1e-9
        statistics = self.bus.statistics()
        frames_lost = statistics.frames_lost - (self.injector.dropped if self.injector is not None else 0)
        bus_full = overload(self.log.table, frames_lost)
        facts = RunFacts(
            scenario=scenario.name,
            seed=scenario.seed,
            method=scenario.planner.method,
            coordination=scenario.planner.coordination,
            sim_time_s=sim_s,
            wall_time_s=self.wall_s,
            platform_ratio=self._platform_ratio,
            physics_only_real_time_factor=sim_s / self.physics_s if self.physics_s > 0.0 else None,
            arm_cycle_us=np.array(self.planner.cycle_ns) * 1e-3,
            frames=statistics.frames,
            frames_lost=frames_lost,
            faults=(*bus_full, *self.faults),
            recorder_fault=self.log.recorder_fault,
            dropped_blocks=self.log.dropped_blocks,
            recording_bytes=self.log.recording_bytes,
            extra=self._own_metrics(),
            door=None if scenario.door is None else scenario.door.kind,
            platform_path=None if scenario.platform_path is None else scenario.platform_path.build(),
        )
        metrics = evaluate(self.log.table, self.robot.arm, facts)
        return metrics.judged(expectations(scenario.expect)) if judged else metrics

    def _own_metrics(self) -> dict[str, float | None]:
        assert self.first is not None and self.last is not None  # `go` samples at once
        moved = self.last.pose_WB[:2, 3] - self.first.pose_WB[:2, 3]
        values = (
            float(self.strategic.stage is Stage.FINISHED),
            self.planner.path_progress,
            float(self.planner.incomplete_cycles),
            float(np.hypot(*moved)),
            float(self.injector.injected if self.injector is not None else 0),
            float(self.injector.dropped if self.injector is not None else 0),
            float(sum(drive.gate.gate.counts.refused for drive in self.sim.drives)),
            float(self.sim.world.collisions.ticks),
            objects_off_goal(self.scenario, self.last),
            self.strategic.found.get("door_radius_found_m"),
            self.strategic.found.get("door_axis_tilt_found_rad"),
        )
        return dict(zip(OWN_METRICS, values, strict=True))


__all__ = ["LockstepRun", "Outcome", "RunOptions", "run_scenario"]
