"""Runs on a real wire, in real time: any of the three roles in this process, the others wherever they are.

Every role waits for those that it needs and says so, comes and goes as it likes, and ends with the mission.
"""

from __future__ import annotations

import contextlib
import signal
import time
from dataclasses import replace
from pathlib import Path

import click

from canipulator.collector import collector_off
from canipulator.dashboard import Dashboard, Status
from canipulator.dashboard import wanted as dashboard_wanted
from canipulator.ending import ended_by
from canipulator.judging import check_expectations, check_scenario, run_info
from canipulator.mission_end import MissionEnd
from canipulator.outcome import Outcome, RunOptions, run_directory
from canipulator.roles import SimulatedRobot, planner_role, simulated_robot, strategic_role
from canipulator.warm_up import warm_up
from canipulator.wire import Wire, run_time, undisturbed
from canipulator.wire_report import report
from canipulator.wire_watch import MissionWatch
from config.errors import ConfigError
from config.load import dump_scenario
from config.robot import Robot, load_robot
from config.scenario import Scenario
from drivers.bus.python_can import PythonCanBus
from drivers.cia402.bring_up import MasterTimes
from drivers.clock import LAST
from drivers.frame import Frame
from drivers.planner_node import PlannerNode
from drivers.realtime_clock import CATCH_UP_NS, RealTimeClock
from drivers.strategic_node import StrategicNode
from logs.bus_log import BusLogWriter
from logs.columns import WallClock
from logs.events import Event, EventLog, Level
from logs.run_log import RunLog
from logs.tape import SYNC_ID
from stack.messages import Truth

TIMES = MasterTimes(boot_ns=600_000_000_000, boot_report_ns=5_000_000_000)
"""Drives of another process, or of a bench, may be switched on much later than the planner."""
CHUNK_NS = 50_000_000
REPORT_NS = 5_000_000_000
SIM_CATCH_UP_NS = 100_000_000
SIM_GRAIN_NS = 1_000_000
"""Physics alone in its process is woken up by its own step only, and by frames; its other timers go along with that."""
LOG_FLUSH_NS = 8_000_000
"""So long may a line of the bus log wait: a system call for every cycle would cost more than the lines."""


def run_on_wire(
    scenario: Scenario,
    options: RunOptions,
    wire: Wire,
    bus: PythonCanBus | None = None,
) -> Outcome:
    """Plays `wire.roles` of the scenario until the mission has ended, the time is over, or a signal comes.

    `bus`: one that is open already; it has the time of the run. With the role `sim` the outcome has the metrics of the run; the
    others leave `timing.json`. Raises ConfigError, BusError (an OSError) for a bus that cannot be opened or goes away,
    KeyboardInterrupt after everything was saved.
    """
    if scenario.fault:
        raise ConfigError(f"{scenario.name}: fault: faults are injected into lockstep runs only")
    robot = load_robot(scenario.robot)
    check_scenario(scenario, robot)
    check_expectations(scenario, robot)
    if bus is None:
        bus = PythonCanBus(
            wire.url,
            run_time(wire.pace),
            bitrate=scenario.bus.bitrate,
            stamp_clock_ns=time.time_ns,
            pace=wire.pace,
        )
    with contextlib.closing(bus):
        name = scenario.name if "sim" in wire.roles else "-".join(wire.roles)
        directory = run_directory(name, options)
        (directory / "scenario.toml").write_text(dump_scenario(scenario), encoding="utf-8")
        with WireRun(scenario, robot, options, wire, directory, bus) as run:
            signalled = run.go()
        outcome = report(run, judged=options.duration_s is None and signalled is None)
    if signalled == signal.SIGINT:
        raise KeyboardInterrupt
    return outcome if signalled is None else Outcome(directory, outcome.metrics, 128 + signalled)


class WireRun:
    """Everything that lives while the roles of this process are on the wire; a context manager that closes it."""

    def __init__(
        self,
        scenario: Scenario,
        robot: Robot,
        options: RunOptions,
        wire: Wire,
        directory: Path,
        bus: PythonCanBus,
    ) -> None:
        self.scenario, self.robot, self.options, self.wire, self.directory = scenario, robot, options, wire, directory
        self.bus = bus
        alone = wire.roles == ("sim",)
        self.clock = RealTimeClock(
            bus.now_ns,
            bus,
            catch_up_ns=SIM_CATCH_UP_NS if alone else CATCH_UP_NS,
            grain_ns=SIM_GRAIN_NS if alone else 1,
        )
        self.period_ns = round(1e9 / scenario.planner.arm_cycle_hz)
        self.watch = MissionWatch(self.period_ns)
        self.faults: list[str] = []
        self.failure: str | None = None
        self.first: Truth | None = None
        self.last: Truth | None = None
        self._timed_cycles = 0
        self._dashboard: Dashboard | None = None
        self.elapsed_s = 0.0
        self.sim: SimulatedRobot | None = None
        self.planner: PlannerNode | None = None
        self.strategic: StrategicNode | None = None
        self.log: RunLog | None = None
        self._events: EventLog | None = None
        self._report_ns = 0
        self._forgotten = False
        self.bus_log = BusLogWriter(
            directory / "bus.log", clock=self.clock, flush_ns=LOG_FLUSH_NS, on_error=self._on_log_error
        )
        bus.observe(self.watch)
        bus.observe(self.bus_log)
        self._compose()
        self.end = MissionEnd(wire.roles, scenario, self.watch, self.planner, self.strategic, self._fail)

    def _compose(self) -> None:
        """The roles of this process, nothing powered yet."""
        robot, scenario, clock, bus = self.robot, self.scenario, self.clock, self.bus
        if "sim" in self.wire.roles:
            self.log = self._run_log()
            bus.observe(self.log.on_frame)
            self.sim = simulated_robot(robot, scenario, clock, bus, self.wire.absent)
            bus.observe(self._on_frame)
        else:
            self._events = EventLog(self.directory / "events.log")
        if "planner" in self.wire.roles:
            warm_up(robot, scenario)
            self.planner = planner_role(robot, scenario, clock, bus, self._on_event, time.perf_counter_ns, TIMES)
        if "strategic" in self.wire.roles:
            self.strategic = strategic_role(robot, scenario, clock, bus, self._on_event)

    def _run_log(self) -> RunLog:
        scenario = self.scenario
        return RunLog(
            self.robot.devices.values(),
            scenario.robot,
            replace(run_info(scenario), wall_clock=self._wall_clock()),
            sync_period_ns=self.period_ns,
            bitrate=scenario.bus.bitrate,
            platform_ratio=self.platform_ratio,
            world_reference=scenario.feedback.rate_hz > 0.0,
            recording=self.directory / "run.rrd" if self.options.record else None,
            event_log=self.directory / "events.log",
            detail=self.options.detail,
            viewer=self.options.viewer,
            wait=False,
            postpone=self.options.viewer is None,
        )

    def _wall_clock(self) -> WallClock:
        """Unix time at time 0 of the run."""
        return WallClock(time.time_ns() - round(self.bus.now_ns() / self.wire.pace), self.wire.pace)

    def __enter__(self) -> WireRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.bus_log.close()
        if self.log is not None:
            self.log.close()
        if self._events is not None:
            self._events.close()
        if self.sim is not None:
            self.sim.world.close()

    def go(self) -> int | None:
        """Runs to the end; the number of the signal that ended it, None if it ended by itself."""
        self.bus.forget_arrived()
        began_ns = self.clock.now_ns()
        self.end.waiting_since_ns = began_ns
        end_ns = None if self.options.duration_s is None else began_ns + round(1e9 * self.options.duration_s)
        self._report_ns = began_ns + REPORT_NS
        with (
            collector_off(),
            undisturbed(),
            ended_by(signal.SIGINT, signal.SIGTERM, at_once=self.clock.stop) as ending,
            self._shown(),
        ):
            self.power_on()
            while ending.signal is None and not self.end.reached(self.clock.now_ns()):
                now_ns = self.clock.now_ns()
                if end_ns is not None and now_ns >= end_ns:
                    break
                self.clock.run_until(now_ns + CHUNK_NS if end_ns is None else min(now_ns + CHUNK_NS, end_ns))
                if not self.end.began:
                    self._look()
        if self.end.failed:
            self.failure = "the mission has failed"
        self.elapsed_s = (self.clock.now_ns() - began_ns) * 1e-9
        if ending.signal is not None:
            self._on_event(Level.WARN, "run", "interrupted" if ending.signal == signal.SIGINT else "told to end")
        return ending.signal

    def _shown(self) -> contextlib.AbstractContextManager[None]:
        """The dashboard, where one is wanted: events go there then."""
        if not dashboard_wanted(self.options.dashboard, quiet=self.options.quiet, real_time=True):
            return contextlib.nullcontext()
        self._dashboard = Dashboard(self.scenario.name, self.robot.devices.values(), self._status)
        self.bus.observe(self._dashboard.on_frame)
        return self._dashboard.live()

    def _status(self) -> Status:
        traffic = self.bus.statistics()
        return Status(
            self.bus.now_ns(),
            traffic.load_mean,
            traffic.load_peak,
            self.watch.missed_cycles,
            self.clock.max_lateness_ns * 1e-3,
            () if self.planner is None else self.planner.cycle_ns,
        )

    def power_on(self) -> None:
        """Boots the nodes of this process."""
        if self.sim is not None:
            self.sim.power_on()
            self._sample()
        if self.strategic is not None:
            self.strategic.node.power_on()
        if self.planner is not None:
            self.planner.power_on()

    def _look(self) -> None:
        """Between two pieces of the run: what has become of the others."""
        if not self._forgotten and self.watch.began_ns is not None:
            self._forgotten = True
            self.clock.forget_lateness()  # late while the planner was loading: nobody was moving
        now_ns = self.clock.now_ns()
        if now_ns < self._report_ns:
            return
        watch, roles = self.watch, self.wire.roles
        for role, last_ns in (("planner", watch.planner_ns), ("strategic", watch.strategic_ns)):
            silence_ns = watch.silent_for_ns(last_ns, now_ns)
            if role not in roles and silence_ns and watch.finished_ns is None:
                since = "yet" if last_ns is None else f"for {silence_ns * 1e-9:.0f} s"
                self._on_event(Level.INFO, "-".join(roles), f"waits for the {role} node: not heard {since}")
        self._report_ns = now_ns + REPORT_NS

    def _on_frame(self, frame: Frame) -> None:
        """Truth at every SYNC, once the robot has taken notice of it."""
        if frame.can_id == SYNC_ID:
            self.clock.call_at(frame.t_ns, self._sample, LAST)

    def _sample(self) -> None:
        assert self.sim is not None and self.log is not None
        truth = self.sim.world.truth(self.clock.now_ns())
        self.first = self.first or truth
        self.last = truth
        self.log.on_truth(truth)
        for pair in self.sim.world.collisions.news():
            self._on_event(Level.ERROR, "collision", f"{pair} touch")
        self._note_computing(truth.t_ns - self.period_ns)

    def _note_computing(self, t_ns: int) -> None:
        """How long the planner of this process took in the cycle that began at `t_ns`, if it has computed one since the last call."""
        cycle_ns = [] if self.planner is None else self.planner.cycle_ns
        if self.log is not None and len(cycle_ns) > self._timed_cycles:
            self._timed_cycles = len(cycle_ns)
            self.log.on_timing(t_ns, cycle_ns[-1])

    def _fail(self, why: str) -> None:
        self.failure = why
        self._on_event(Level.ERROR, "-".join(self.wire.roles), why)

    def _on_event(self, level: Level, source: str, text: str) -> None:
        event = Event(self.clock.now_ns(), level, source, text)
        if self.log is not None:
            self.log.on_event(event.t_ns, level, source, text)
        elif self._events is not None:
            self._events.write(event)
        if level >= Level.ERROR:
            self.faults.append(f"{source}: {text}")
        if self._dashboard is not None:
            self._dashboard.on_event(event)
        elif not self.options.quiet and level >= Level.INFO:
            click.echo(event.line().strip(), err=True)

    def _on_log_error(self, error: OSError) -> None:
        self._on_event(Level.ERROR, "bus.log", f"{error.strerror}: frames from here on are not in bus.log")

    @property
    def platform_ratio(self) -> int:
        """Arm cycles in a platform cycle."""
        return round(self.scenario.planner.arm_cycle_hz / self.scenario.planner.platform_cycle_hz)
