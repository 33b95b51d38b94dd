"""A run that is watched while it goes on, and one whose viewer goes away."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun, run_scenario
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario
from logs.recording_reader import read_recording
from logs.viewer import is_torn, live_viewer, viewer_command
from tests.viewer.headless import headless_viewer, spread

pytestmark = [pytest.mark.slow, pytest.mark.viewer]


def test_a_run_streams_into_a_viewer_that_listens_and_saves_the_file_all_the_same(tmp_path: Path) -> None:
    with headless_viewer() as viewer:
        address = live_viewer(viewer.port)
        assert address == viewer.url
        run_scenario(
            load_scenario("sliding-door"), RunOptions(out=tmp_path, duration_s=4.0, quiet=True, viewer=address)
        )
        state = viewer.wait_for(lambda state: bool(state.recordings), "the run")
        ends = {timeline.name: timeline.end for timeline in state.recordings[0].timelines}
        assert ends["sim_time"] > 3.5e9
        assert spread(viewer.picture("TCP error [mm]")) > 2.0
        assert viewer.complaints() == []
    saved = read_recording(tmp_path / "run.rrd")
    assert saved.series["joints/position_rad_or_m/actual"].t_ns[-1] > 3.9e9


def test_a_viewer_that_is_closed_in_mid_run_costs_the_recording_nothing(tmp_path: Path) -> None:
    with headless_viewer() as viewer:
        options = RunOptions(out=tmp_path, duration_s=8.0, quiet=True, viewer=viewer.url)
        scenario = load_scenario("sliding-door")
        assert isinstance(scenario, Scenario)
        run = LockstepRun(scenario, load_robot(scenario.robot), options, tmp_path)
        with run:
            run.power_on()
            run.clock.run_until(3_000_000_000)
            viewer.kill()
            run.clock.run_until(8_000_000_000)
    assert run.log.recorder_fault is None
    assert not is_torn(tmp_path / "run.rrd")
    assert "the viewer is gone" in (tmp_path / "events.log").read_text()
    assert read_recording(tmp_path / "run.rrd").series["joints/position_rad_or_m/actual"].t_ns[-1] > 7.9e9


def test_frames_are_the_same_with_a_viewer_with_a_file_and_with_nothing(tmp_path: Path) -> None:
    with headless_viewer() as viewer:
        for name, record, address in (("live", True, viewer.url), ("file", True, None), ("none", False, None)):
            options = RunOptions(out=tmp_path / name, duration_s=3.0, quiet=True, record=record, viewer=address)
            run_scenario(load_scenario("sliding-door"), options)
    logs = [(tmp_path / name / "bus.log").read_bytes() for name in ("live", "file", "none")]
    assert logs[0] == logs[1] == logs[2]


def test_the_web_viewer_is_served_on_this_machine_alone(tmp_path: Path) -> None:
    run_scenario(load_scenario("hold-still"), RunOptions(out=tmp_path, duration_s=1.0, quiet=True))
    command = viewer_command(tmp_path / "run.rrd", web=True)
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    ports = ["--port", "19876", "--web-viewer-port", "19090"]
    server = subprocess.Popen([*command, *ports], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        page = _page("http://127.0.0.1:19090")
        assert "rerun" in page.lower()
        sockets = subprocess.run(["ss", "-ltnH"], capture_output=True, text=True, check=False).stdout
        listening = [line.split()[3] for line in sockets.splitlines() if ":19876" in line or ":19090" in line]
        assert all(address.startswith("127.0.0.1:") for address in listening), listening
    finally:
        server.kill()
        server.wait(20)
        if server.stderr is not None:
            server.stderr.close()


def _page(address: str) -> str:
    script = (
        "import sys, time, urllib.request\n"
        "for _ in range(100):\n"
        "    try:\n"
        "        print(urllib.request.urlopen(sys.argv[1], timeout=5).read(4000).decode()); break\n"
        "    except OSError:\n"
        "        time.sleep(0.2)\n"
    )
    answer = subprocess.run(
        [sys.executable, "-c", script, address], capture_output=True, text=True, timeout=60, check=False
    )
    return answer.stdout
