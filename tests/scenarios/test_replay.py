"""`canipulator replay`: the planner again, from nothing but the run's folder."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from canipulator.replay import drive_set_points, explain, read_run, replay, replay_run
from canipulator.run import Outcome, RunOptions, run_scenario
from config.errors import ConfigError
from config.load import load_scenario
from config.robot import load_robot
from logs.bus_log import read_bus_log
from tests.scenarios.conftest import Runner, run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def door(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first seconds of `sliding-door`, the TCP already moving."""
    return run(tmp_path_factory.mktemp("replay"), "sliding-door", duration_s=3.0).directory


def command(*arguments: object) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "canipulator", "replay", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)


def changed(door: Path, folder: Path, can_id: str, number: int, place: int) -> Path:
    """A copy of the run with one hexadecimal digit of one frame changed: the `number`-th with this identifier."""
    shutil.copytree(door, folder)
    lines = (door / "bus.log").read_text().splitlines()
    row = [i for i, line in enumerate(lines) if f" {can_id}#" in line][number]
    at = lines[row].index("#") + 1 + place
    lines[row] = lines[row][:at] + ("0" if lines[row][at] != "0" else "1") + lines[row][at + 1 :]
    (folder / "bus.log").write_text("\n".join(lines) + "\n")
    return folder


def test_a_whole_run_replays_bit_for_bit(standard_door: Outcome) -> None:
    _, result = replay_run(standard_door.directory, quiet=True)
    assert result.identical
    assert result.cycles == standard_door.metrics["arm_cycles"]


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("hold-still", ["bus.bitrate=500000"]),
        ("sliding-door", ["bus.bitrate=800000"]),  # a bit takes 1.25 µs: times on the wire are not those of the log
        ("sliding-door", ["planner.arm_cycle_hz=200", "feedback.latency_s=0.0123456"]),
        ("drive-square", []),
    ],
)
def test_other_buses_and_scenarios_replay_too(name: str, overrides: list[str], runner: Runner) -> None:
    outcome = runner(name, *overrides, duration_s=3.0)
    _, result = replay_run(outcome.directory, quiet=True)
    assert result.frames > 1000
    assert result.identical, explain(result.first, load_robot("moma8").devices.values()) if result.first else ""


@pytest.mark.parametrize(
    "fault",
    [
        "frame-loss@0:probability=0.1",
        pytest.param("frame-corruption@0:probability=0.1", marks=pytest.mark.faults),
    ],
)
def test_frames_that_a_fault_has_swallowed_or_changed_do_not_hinder_a_replay(fault: str, tmp_path: Path) -> None:
    scenario = load_scenario("sliding-door", (), [fault])
    outcome = run_scenario(scenario, RunOptions(out=tmp_path / "run", duration_s=3.0, record=False, quiet=True))
    _, result = replay_run(outcome.directory, quiet=True)
    assert result.identical, explain(result.first, load_robot("moma8").devices.values()) if result.first else ""
    assert result.frames > 3000
    (outcome.directory / "faults.log").unlink()  # without it the planner's own lost frames are not known
    if fault.startswith("frame-loss"):
        assert not replay_run(outcome.directory, quiet=True)[1].identical


def test_identical_is_exit_code_0(door: Path) -> None:
    answer = command(door)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.startswith("identical: ")
    assert answer.stdout.count("\n") == 1


def test_a_changed_byte_of_the_planner_is_found_and_explained(door: Path, tmp_path: Path) -> None:
    answer = command(changed(door, tmp_path / "run", "219", 150, 4))  # lowest byte of the elbow's target
    assert answer.returncode == 1
    assert "different: 1 of " in answer.stdout
    assert "219h set point to elbow (node 25)" in answer.stdout
    assert "arm cycle " in answer.stdout
    assert "Target position: expected " in answer.stdout
    assert "Torque offset" not in answer.stdout, "that field is the same"


def test_a_changed_byte_of_a_drive_shows_in_what_the_planner_makes_of_it(door: Path, tmp_path: Path) -> None:
    folder = changed(door, tmp_path / "run", "18B", 200, 6)  # position of the left wheel
    scenario, result = replay_run(folder, quiet=True)
    assert result.differing > 10
    assert result.first is not None
    assert 190 < result.first.sync_count < 240
    assert "expected" in explain(result.first, load_robot(scenario.robot).devices.values())


def test_a_frame_that_is_missing_is_said_to_be(door: Path, tmp_path: Path) -> None:
    shutil.copytree(door, tmp_path / "run")
    lines = (door / "bus.log").read_text().splitlines()
    row = [i for i, line in enumerate(lines) if " 182#" in line][100]
    (tmp_path / "run" / "bus.log").write_text("\n".join(lines[:row] + lines[row + 1 :]) + "\n")
    answer = command(tmp_path / "run")
    assert answer.returncode == 1
    assert "182h state of planner (node 2)" in answer.stdout
    assert "expected  nothing: it is not in the log" in answer.stdout


def test_another_method_differs_where_methods_differ(runner: Runner, tmp_path: Path) -> None:
    """An arm that is pulled to its limits by itself: programs with bounds and closed forms part ways."""
    folder = runner("sliding-door", "planner.coordination=arm-only", duration_s=5.0).directory
    devices = load_robot("moma8").devices
    _, own = replay_run(folder, "pns", quiet=True)
    assert all(drive.largest == 0.0 for drive in drive_set_points(own, devices))
    answer = command(folder, "--with", "qp", "--out", tmp_path / "qp.png")
    assert answer.returncode == 0, answer.stderr
    assert "wrist_tilt" in answer.stdout
    assert (tmp_path / "qp.png").stat().st_size > 20_000
    _, other = replay_run(folder, "qp", quiet=True)
    joints = drive_set_points(other, devices)[2:]
    assert max(drive.largest for drive in joints) > 0.01
    assert all(drive.largest < 3.0 for drive in joints)


def test_a_tolerance_forgives_one_count_of_a_set_point(door: Path) -> None:
    scenario, frames = read_run(door)
    row = [i for i, frame in enumerate(frames) if frame.can_id == 0x219][200]
    data = bytearray(frames[row].data)
    data[2] ^= 1
    frames[row] = frames[row]._replace(data=bytes(data))
    assert not replay(scenario, frames).identical
    assert replay(scenario, frames, tolerance=1e-7).identical


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["/nowhere"], "/nowhere/scenario.toml"),
        (["{door}", "--with", "pnx"], "pnx"),
        (["{door}", "--out", "x"], "--with"),
    ],
)
def test_what_is_wrong_gets_one_line_and_exit_code_2(arguments: list[str], part: str, door: Path) -> None:
    answer = command(*(argument.format(door=door) for argument in arguments))
    assert answer.returncode == 2
    assert answer.stderr.startswith("canipulator: ")
    assert answer.stderr.count("\n") == 1
    assert part in answer.stderr


def in_real_time(door: Path, folder: Path, change: int = 0) -> Path:
    """The run as a machine in real time would leave it: SYNC up to 3 ms late, one cycle skipped; `change`: added to a joint's targets."""
    shutil.copytree(door, folder)
    random, late_ns, skipped_ns, last_ns, lines = np.random.default_rng(3), 0, 0, 0, []
    for frame in read_bus_log(door / "bus.log"):
        if frame.can_id == 0x080:
            late_ns = int(random.integers(0, 3_000_000))
            skipped_ns = 10_000_000 if frame.t_ns > 2_000_000_000 else 0
        data = bytearray(frame.data)
        if change and frame.can_id == 0x219:
            data[2:6] = (int.from_bytes(data[2:6], "little", signed=True) + change).to_bytes(4, "little", signed=True)
        last_ns = max(last_ns, frame.t_ns + skipped_ns + min(late_ns, 10_000_000 - frame.t_ns % 10_000_000 - 1))
        lines.append(f"({last_ns // 1000 / 1e6:017.6f}) can0 {frame.can_id:03X}#{data.hex().upper()}\n")
    (folder / "bus.log").write_text("".join(lines))
    (folder / "timing.json").write_text("{}")
    return folder


def test_a_run_in_real_time_replays_within_a_tolerance(door: Path, tmp_path: Path) -> None:
    folder = in_real_time(door, tmp_path / "run")
    with pytest.raises(ConfigError, match="real time"):
        replay_run(folder, quiet=True)
    answer = command(folder)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert answer.stdout.startswith("alike: ")


def test_a_run_in_real_time_whose_set_points_are_others_is_different(door: Path, tmp_path: Path) -> None:
    answer = command(in_real_time(door, tmp_path / "run", change=30_000))
    assert answer.returncode == 1
    assert answer.stdout.startswith("different: ")
    assert "elbow          0.03" in answer.stdout
    assert "wrist_pan      0\n" in answer.stdout


@pytest.mark.parametrize(("name", "text"), [("timing.json", "{}"), ("metrics.json", '{"max_lateness_us": 12.5}')])
def test_another_method_is_for_lockstep_runs(name: str, text: str, door: Path, tmp_path: Path) -> None:
    shutil.copytree(door, tmp_path / "run")
    (tmp_path / "run" / name).write_text(text)
    answer = command(tmp_path / "run", "--with", "qp")
    assert answer.returncode == 2
    assert "real time" in answer.stderr


def test_a_kinematic_run_has_nothing_to_replay(runner: Runner, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    source = Path(__file__).parents[2] / "config/scenarios/wrist-singularity-pass.toml"
    shutil.copy(source, tmp_path / "run" / "scenario.toml")
    (tmp_path / "run" / "bus.log").touch()
    with pytest.raises(ConfigError, match="kinematic"):
        read_run(tmp_path / "run")
