"""All roles over python-can, without a kernel and without waiting: interface `virtual`, and time that jumps where the loop would wait."""

from __future__ import annotations

import itertools
import json
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from canipulator.outcome import Outcome, RunOptions
from canipulator.realtime import WireRun, run_on_wire
from canipulator.wire import ROLES, Wire, external_parts
from config.errors import ConfigError
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario
from drivers.bus.python_can import PythonCanBus
from drivers.canopen.nmt import NmtState
from drivers.cia402.states import State
from logs.bus_log import read_bus_log
from stack.messages import PlannerPhase
from stack.strategic.mission import Stage

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("wire")]

SHORT = ("step.2.length_m=0.4", "expect.5.min=0.38")
CHANNELS = (f"virtual:test_wire_{number}" for number in itertools.count())


class Time:
    """Goes on only when a bus waits."""

    ns = 0

    def __call__(self) -> int:
        return self.ns


class SteppedBus(PythonCanBus):
    """Where the loop would wait, time jumps: the same loop, as fast as the machine can."""

    def __init__(self, url: str, time: Time) -> None:
        super().__init__(url, time)
        self.time = time
        self.at: list[tuple[int, Callable[[], None]]] = []

    def wait(self, timeout_ns: int) -> None:
        self.time.ns += timeout_ns
        while self.at and self.time.ns >= self.at[0][0]:
            self.at.pop(0)[1]()


def door(*overrides: str) -> Scenario:
    scenario = load_scenario("sliding-door", (*SHORT, *overrides))
    assert isinstance(scenario, Scenario)
    return scenario


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    bus = SteppedBus(next(CHANNELS), Time())
    options = RunOptions(out=tmp_path_factory.mktemp("wire"), record=False, quiet=True)
    return run_on_wire(door(), options, Wire(bus.url), bus)


def test_the_door_over_a_python_can_bus_meets_its_expectations(whole: Outcome) -> None:
    assert whole.exit_code == 0
    assert {verdict["name"] for verdict in whole.metrics["expectations"]} >= {"mission_finished", "tcp_error_rms_m"}
    assert whole.metrics["tcp_travel_m"] == pytest.approx(0.4, abs=0.01)
    assert whole.metrics["path_progress"] == pytest.approx(1.0)


def test_no_cycle_is_missed_where_time_waits_for_the_loop(whole: Outcome) -> None:
    assert whole.metrics["missed_cycles"] == 0
    assert whole.metrics["overruns"] == 0
    assert whole.metrics["max_lateness_us"] == 0
    assert whole.metrics["incomplete_cycles"] == 0


def test_the_log_has_every_frame_and_the_strategic_node_has_said_that_it_is_done(whole: Outcome) -> None:
    frames = list(read_bus_log(whole.directory / "bus.log"))
    assert len(frames) == whole.metrics["frames"]
    heartbeats = [frame.data[0] for frame in frames if frame.can_id == 0x701]
    assert heartbeats[-1] == NmtState.STOPPED
    assert NmtState.OPERATIONAL in heartbeats


class Stage3:
    """Three runs with one role each, on one channel and in one time, moved in turns."""

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        self.folder, self.scenario, self.robot = folder, scenario, load_robot(scenario.robot)
        self.url, self.time = next(CHANNELS), Time()
        self.runs: dict[str, WireRun] = {}

    def start(self, role: str) -> WireRun:
        folder = self.folder / f"{role}-{len(list(self.folder.iterdir()))}"
        folder.mkdir()
        bus = PythonCanBus(self.url, self.time)
        options = RunOptions(out=folder, record=False, quiet=True)
        run = self.runs[role] = WireRun(self.scenario, self.robot, options, Wire(self.url, (role,)), folder, bus)
        run.power_on()
        return run

    def kill(self, role: str) -> None:
        """As SIGKILL would: no word to anybody."""
        run = self.runs.pop(role)
        run.__exit__()
        run.bus.close()

    def go(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Moves everybody in steps of 0.1 ms; True as soon as `until` holds."""
        end_ns = self.time.ns + round(seconds * 1e9)
        while self.time.ns < end_ns:
            self.time.ns += 100_000
            for run in tuple(self.runs.values()):
                run.clock.run_until(self.time.ns)
            if until():
                return True
        return False

    def close(self) -> None:
        for role in tuple(self.runs):
            self.kill(role)


@pytest.fixture
def stage(tmp_path: Path):
    made = Stage3(tmp_path, door("step.2.length_m=0.1"))
    yield made
    made.close()


def finished(run: WireRun) -> Callable[[], bool]:
    return lambda: run.strategic is not None and run.strategic.stage in (Stage.FINISHED, Stage.FAILED)


@pytest.mark.parametrize("order", list(itertools.permutations(ROLES)), ids="-".join)
def test_roles_start_in_any_order_and_join_late(stage: Stage3, order: tuple[str, ...]) -> None:
    for role in order:
        stage.start(role)
        stage.go(0.6)
    strategic = stage.runs["strategic"]
    assert stage.go(10.0, finished(strategic))
    assert strategic.strategic.stage is Stage.FINISHED
    for run in stage.runs.values():
        assert run.faults == []


def test_the_planner_is_killed_everything_stands_and_another_one_takes_over(stage: Stage3) -> None:
    sim = stage.start("sim")
    stage.start("planner")
    strategic = stage.start("strategic")
    assert stage.go(8.0, lambda: strategic.strategic.stage is Stage.MOVING)
    stage.go(1.0)
    stage.kill("planner")
    stage.go(0.5)
    assert strategic.strategic.stage is Stage.FAILED, "a mission without a planner is over"
    velocity = sim.sim.world.truth(0).dq
    assert abs(velocity).max() < 1e-2, "drives that have lost their master stand"
    stage.kill("strategic")
    stage.start("planner")
    again = stage.start("strategic")
    assert stage.go(10.0, finished(again))
    assert again.strategic.stage is Stage.FINISHED


def test_the_strategic_node_is_killed_the_robot_stops_and_the_next_mission_succeeds(stage: Stage3) -> None:
    sim, planner = stage.start("sim"), stage.start("planner")
    strategic = stage.start("strategic")
    assert stage.go(8.0, lambda: strategic.strategic.stage is Stage.MOVING)
    stage.go(1.0)
    stage.kill("strategic")
    stage.go(4.0)
    assert abs(sim.sim.world.truth(0).dq).max() < 1e-2
    assert planner.planner.phase is PlannerPhase.READY
    again = stage.start("strategic")
    assert stage.go(10.0, finished(again))
    assert again.strategic.stage is Stage.FINISHED
    assert planner.faults == []


def test_a_role_ends_with_the_mission_and_not_before(stage: Stage3) -> None:
    sim, planner, strategic = (stage.start(role) for role in ROLES)
    assert stage.go(10.0, finished(strategic))
    assert not any(run.end.reached(stage.time.ns) for run in (sim, planner))
    states = [drive.state for drive in sim.sim.drives]
    assert set(states) == {State.OPERATION_ENABLED}
    ends: dict[str, int] = {}
    for _ in range(80):
        stage.go(0.1)
        for name, run in tuple(stage.runs.items()):
            if run.end.reached(stage.time.ns):
                ends[name] = stage.time.ns
                assert run.failure is None
                stage.kill(name)
    assert list(ends) == ["strategic", "planner", "sim"]
    states = [drive.state for drive in sim.sim.drives]
    assert State.OPERATION_ENABLED not in states, "the planner has left its drives without having switched them off"
    assert planner.faults == []


def test_who_is_missing_is_said_and_a_mission_does_not_wait_for_ever(tmp_path: Path) -> None:
    bus = SteppedBus(next(CHANNELS), Time())
    outcome = run_on_wire(
        door(), RunOptions(out=tmp_path, record=False, quiet=True), Wire(bus.url, ("strategic",)), bus
    )
    assert outcome.exit_code == 1
    assert 100 < outcome.metrics["wall_time_s"] < 130
    events = (tmp_path / "events.log").read_text()
    assert "waits for the planner node: not heard yet" in events
    assert "no planner got ready" in events
    assert json.loads((tmp_path / "timing.json").read_text())["failure"] == "no planner got ready"


def test_sigterm_ends_a_run_with_its_files_closed(tmp_path: Path) -> None:
    bus = SteppedBus(next(CHANNELS), Time())
    bus.at = [(2_000_000_000, lambda: signal.raise_signal(signal.SIGTERM))]
    outcome = run_on_wire(door(), RunOptions(out=tmp_path, record=False, quiet=True), Wire(bus.url), bus)
    assert outcome.exit_code == 128 + signal.SIGTERM
    assert outcome.metrics["frames"] == sum(1 for _ in read_bus_log(tmp_path / "bus.log"))
    assert "told to end" in (tmp_path / "events.log").read_text()


def test_ctrl_c_saves_everything_and_is_passed_on(tmp_path: Path) -> None:
    bus = SteppedBus(next(CHANNELS), Time())
    bus.at = [(1_500_000_000, lambda: signal.raise_signal(signal.SIGINT))]
    with pytest.raises(KeyboardInterrupt):
        run_on_wire(door(), RunOptions(out=tmp_path, record=False, quiet=True), Wire(bus.url), bus)
    assert json.loads((tmp_path / "metrics.json").read_text())["sim_time_s"] == pytest.approx(1.5, abs=0.1)


def test_an_external_drive_is_left_out(tmp_path: Path) -> None:
    bus = SteppedBus(next(CHANNELS), Time())
    wire = Wire(bus.url, *external_parts(("21,22",)))
    run_on_wire(door(), RunOptions(out=tmp_path, duration_s=1.0, record=False, quiet=True), wire, bus)
    booted = {frame.can_id - 0x700 for frame in read_bus_log(tmp_path / "bus.log") if frame.can_id > 0x700}
    assert booted == {1, 2, 11, 12, 23, 24, 25, 26, 27, 28, 31, 32, 33}


def test_external_parts_are_roles_or_drives() -> None:
    assert external_parts(("planner", "11, 12")) == (("sim", "strategic"), frozenset({11, 12}))
    with pytest.raises(ConfigError, match="'plannr'"):
        external_parts(("plannr",))
    with pytest.raises(ConfigError, match="'31'"):
        external_parts(("31",))
