"""The terminal's view of a run, rendered to text."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from canipulator.dashboard import Dashboard, Status, wanted
from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario
from drivers.catalogue import devices
from drivers.frame import Frame
from logs.events import Event, Level


def text_of(dashboard: Dashboard) -> str:
    console = Console(file=io.StringIO(), width=140, force_terminal=False)
    console.print(dashboard.render())
    output = console.file
    assert isinstance(output, io.StringIO)
    return output.getvalue()


def test_before_anything_was_heard_it_says_so() -> None:
    shown = text_of(Dashboard("door", devices().values(), lambda: Status(0)))
    assert shown.count("not heard") == 11, "ten drives and the planner"
    assert "no mission" in shown


def test_a_drive_that_stops_talking_is_called_silent() -> None:
    dashboard = Dashboard("door", devices().values(), lambda: Status(2_000_000_000))
    dashboard.on_frame(Frame(0x199, bytes.fromhex("3716000000000000"), 1_000_000_000))
    dashboard.on_frame(Frame(0x19A, bytes.fromhex("3716000000000000"), 1_900_000_000))
    rows = {line.split()[1]: line for line in text_of(dashboard).splitlines() if line[:2].isdigit()}
    assert "silent" in rows["elbow"]
    assert "operation enabled" in rows["lower_arm"]


def test_a_frame_of_the_wrong_length_does_not_end_it() -> None:
    dashboard = Dashboard("door", devices().values(), lambda: Status(0))
    dashboard.on_frame(Frame(0x199, b"\x01", 0))
    dashboard.on_frame(Frame(0x182, b"\x01", 0))
    dashboard.on_frame(Frame(0x481, b"", 0))
    assert "25 elbow" in text_of(dashboard)


@pytest.mark.slow
def test_a_run_is_shown_with_its_drives_cycle_load_and_fault(tmp_path: Path) -> None:
    scenario = load_scenario("sliding-door", (), ["over-current@1.5:node=23"])
    assert isinstance(scenario, Scenario)
    robot = load_robot(scenario.robot)
    options = RunOptions(out=tmp_path, duration_s=1.7, record=False, quiet=True)
    with LockstepRun(scenario, robot, options, tmp_path) as run:
        dashboard = run.dashboard()
        run.bus.observe(dashboard.on_frame)
        run.power_on()
        run.clock.run_until(1_400_000_000)
        well = text_of(dashboard)
        run.clock.run_until(1_700_000_000)
        ill = text_of(dashboard)
    assert well.count("operation enabled") == 10
    assert "executing" in well
    assert "computes " in well
    assert "1.4 s" in well
    assert " mrad" in well
    assert "fault" in next(line for line in ill.splitlines() if "23 shoulder" in line)
    assert "operation enabled" not in next(line for line in ill.splitlines() if "23 shoulder" in line)
    load = float(well.split(" %, ")[0].split()[-1])
    assert 20.0 < load < 60.0


def test_events_are_the_last_ones_from_info_on() -> None:
    dashboard = Dashboard("door", devices().values(), lambda: Status(0))
    for i in range(20):
        dashboard.on_event(Event(i, Level.INFO if i % 2 else Level.DEBUG, "planner", f"number {i}."))
    shown = text_of(dashboard)
    assert "number 19." in shown
    assert "number 18." not in shown
    assert "number 3." not in shown


def test_it_is_shown_where_it_is_wanted() -> None:
    assert wanted(True, quiet=False, real_time=False)
    assert not wanted(True, quiet=True, real_time=True)
    assert not wanted(False, quiet=False, real_time=True)
    assert not wanted(None, quiet=False, real_time=False)
