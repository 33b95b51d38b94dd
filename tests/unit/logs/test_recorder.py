"""The recording: what is in it, that it survives, and that its faults stay its own."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from logs.blueprint import view_contents
from logs.columns import WallClock
from logs.detail import Detail
from logs.events import Level
from logs.optimise import optimise
from logs.run_log import RunInfo, RunLog
from logs.signals import SignalTable
from stack.kinematics import ArmModel
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Motion, play

ROOT = Path(__file__).resolve().parents[3]


def _rows(path: Path) -> Counter[str]:
    """Rows of every entity."""
    rows: Counter[str] = Counter()
    for chunk in RrdReader(str(path)).stream():
        rows[str(chunk.entity_path).lstrip("/")] += chunk.num_rows
    return rows


def _log(folder: Path, **options: object) -> RunLog:
    paths = {"recording": folder / "run.rrd", "event_log": folder / "events.log"} | options
    return RunLog(DEVICES.values(), "moma8", RunInfo("test"), sync_period_ns=PERIOD_NS, **paths)  # type: ignore[arg-type]


def test_every_view_has_data(recorded: Path) -> None:
    rows = _rows(recorded / "run.rrd")
    for title, paths in view_contents(ArmModel.load("moma8")).items():
        for path in paths:
            found = sum(n for name, n in rows.items() if name == path or name.startswith(path.removesuffix("**")))
            assert found > 1, f"{title}: {path} is empty"


def test_robot_paths_and_ellipsoids_are_there(recorded: Path) -> None:
    rows = _rows(recorded / "run.rrd")
    assert sum(name.startswith("world/moma8/visual_geometries/") for name in rows) > 10
    for path in ("tf/platform", "tf/joints/elbow", "tf/joints/wheel_left_joint"):
        assert rows[path] == pytest.approx(3.5 * 25, abs=3)
    assert rows["world/path/true"] == pytest.approx(3.5 * 5, abs=4)
    assert rows["world/ellipsoid/robot"] == 70


def test_values_and_timelines_come_back_exactly(recorded: Path, table: SignalTable) -> None:
    times, cycles, values = [], [], []
    for chunk in RrdReader(str(recorded / "run.rrd")).stream():
        if str(chunk.entity_path) == "/joints/position_rad_or_m/actual" and not chunk.is_static:
            batch = chunk.to_record_batch()
            times += batch["sim_time"].cast(pa.int64()).to_pylist()
            cycles += batch["arm_cycle"].to_pylist()
            values += batch["Scalars:scalars"].to_pylist()
    order = np.argsort(times)
    actual = table["joints/position/actual"]
    assert np.array(times)[order].tolist() == actual.t_ns.tolist()
    assert np.array(cycles)[order].tolist() == list(range(len(actual)))
    np.testing.assert_array_equal(np.array(values)[order], actual.values)


def test_properties_say_which_run_it_is(recorded: Path) -> None:
    properties = {}
    for chunk in RrdReader(str(recorded / "run.rrd")).stream():
        if str(chunk.entity_path) == "/__properties/run":
            batch = chunk.to_record_batch()
            properties = {name: batch[name].to_pylist()[0] for name in batch.schema.names}
    assert properties["seed"] == [7]
    assert properties["git_revision"] == ["0123abc"]
    assert properties["slip_sigma"] == [0.01]


def test_what_is_listened_to_is_not_changed(run: Motion, tmp_path: Path) -> None:
    """The table is the same with and without a recording, so nothing of the writing leaks back."""
    logs = [_log(tmp_path, compact=False), _log(tmp_path, recording=None, event_log=None)]
    tables = []
    for log in logs:
        play(run, log.on_frame, log.on_truth)
        tables.append(log.close())
    assert tables[0].names() == tables[1].names()
    for name in tables[0].names():
        np.testing.assert_array_equal(tables[0][name].values, tables[1][name].values)


@pytest.mark.slow
def test_without_waiting_late_blocks_are_counted_and_the_table_is_whole(run: Motion, tmp_path: Path) -> None:
    log = _log(tmp_path, wait=False, block_ns=PERIOD_NS, compact=False)
    play(run, log.on_frame, log.on_truth)
    table = log.close()
    assert log.written_blocks + log.dropped_blocks == len(run.truths)
    assert len(table["joints/position/actual"]) == len(run.truths)
    assert sum("cannot keep up" in event.text for event in table.events) == (log.dropped_blocks > 0)


def test_a_disk_that_is_full_costs_the_recording_not_the_run(run: Motion, tmp_path: Path) -> None:
    log = _log(tmp_path, recording=Path("/dev/full"))
    frames = play(run, log.on_frame, log.on_truth)
    table = log.close()
    assert log.recorder_fault is not None
    assert log.frames == frames
    assert len(table["truth/q"]) == len(run.truths)
    told = [event for event in table.events if event.source == "recorder"]
    assert [event.level for event in told] == [Level.ERROR]
    assert (tmp_path / "events.log").read_text().count("recording ended") == 1


FILLED_UP = """
import resource, sys
from pathlib import Path
from logs.run_log import RunInfo, RunLog
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, motion, play

folder = Path(sys.argv[1])
log = RunLog(DEVICES.values(), "moma8", RunInfo("full"), sync_period_ns=PERIOD_NS,
             recording=folder / "run.rrd", event_log=folder / "events.log", compact=False)
resource.setrlimit(resource.RLIMIT_FSIZE, ((folder / "run.rrd").stat().st_size + 600_000,) * 2)
play(motion(600), log.on_frame, log.on_truth)
table = log.close()
print(len(table["truth/q"]), log.written_blocks, log.recorder_fault is not None)
"""


@pytest.mark.slow
def test_a_disk_that_fills_up_in_mid_run_leaves_what_was_written(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FILLED_UP, str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    samples, blocks, faulty = done.stdout.split()
    assert (samples, faulty) == ("600", "True")
    assert 1 <= int(blocks) < 5
    assert (tmp_path / "events.log").read_text().count("recording ended") == 1
    assert optimise(tmp_path / "run.rrd")
    assert _rows(tmp_path / "run.rrd")["joints/position_rad_or_m/actual"] >= 100 * int(blocks) - 2


def test_a_folder_that_is_not_there_costs_the_recording_not_the_run(run: Motion, tmp_path: Path) -> None:
    log = _log(tmp_path, recording=tmp_path / "nowhere" / "run.rrd")
    play(run, log.on_frame, log.on_truth)
    assert len(log.close()["truth/q"]) == len(run.truths)
    assert log.recorder_fault is not None


KILLED = """
import signal, sys, time
from pathlib import Path
from logs.run_log import RunInfo, RunLog
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, motion, play

folder = Path(sys.argv[1])
log = RunLog(DEVICES.values(), "moma8", RunInfo("killed"), sync_period_ns=PERIOD_NS,
             recording=folder / "run.rrd", event_log=folder / "events.log")
play(motion(350), log.on_frame, log.on_truth)
while log.written_blocks < 3:
    time.sleep(0.01)
print("written", flush=True)
signal.pause()
"""


@pytest.mark.slow
def test_a_killed_process_leaves_a_readable_file(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        process.kill()
    assert said == "written\n"
    with pytest.warns(RerunWarning, match="no footer"):
        assert _rows(tmp_path / "run.rrd")["joints/position_rad_or_m/actual"] >= 300
    assert optimise(tmp_path / "run.rrd")
    assert _rows(tmp_path / "run.rrd")["joints/position_rad_or_m/actual"] >= 300
    assert (tmp_path / "events.log").read_text().endswith("\n")


def test_optimise_makes_it_smaller_and_keeps_all_rows(recorded: Path, tmp_path: Path) -> None:
    path = tmp_path / "copy.rrd"
    path.write_bytes((recorded / "run.rrd").read_bytes())
    before = _rows(path)
    assert optimise(path)
    after = _rows(path)
    assert path.stat().st_size < (recorded / "run.rrd").stat().st_size
    assert {name: n for name, n in before.items() if name.startswith("joints/")} == {
        name: n for name, n in after.items() if name.startswith("joints/")
    }


def test_optimise_leaves_alone_what_is_no_recording(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_text("not a recording")
    assert not optimise(path)
    assert path.read_text() == "not a recording"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_minimal_recording_is_smaller_and_has_what_the_overview_shows(run: Motion, tmp_path: Path) -> None:
    for detail in Detail:
        (tmp_path / detail.value).mkdir()
        log = _log(tmp_path / detail.value, detail=detail, compact=False)
        play(run, log.on_frame, log.on_truth)
        log.close()
        assert log.recording_bytes == (tmp_path / detail.value / "run.rrd").stat().st_size
    rows = {detail: _rows(tmp_path / detail.value / "run.rrd") for detail in Detail}
    assert any(path.startswith("can/") for path in rows[Detail.FULL])
    assert not any(path.startswith("can/") for path in rows[Detail.MINIMAL])
    for path in (
        "tcp/error_mm",
        "joints/position_share",
        "platform/v_m_per_s/true",
        "tf/platform",
        "events",
        "states/planner/phase",
    ):
        assert rows[Detail.MINIMAL][path] == rows[Detail.FULL][path] > 1, path
    full, minimal = ((tmp_path / name / "run.rrd").stat().st_size for name in ("full", "minimal"))
    assert minimal < 0.5 * full


@pytest.mark.slow
def test_a_run_in_real_time_has_its_wall_clock(run: Motion, tmp_path: Path) -> None:
    epoch_ns = 1_790_000_000_000_000_000
    info = RunInfo("test", wall_clock=WallClock(epoch_ns, 0.5))
    log = RunLog(
        DEVICES.values(), "moma8", info, sync_period_ns=PERIOD_NS, recording=tmp_path / "run.rrd", event_log=None
    )
    play(run, log.on_frame, log.on_truth)
    log.close()
    for chunk in RrdReader(str(tmp_path / "run.rrd")).stream():
        if str(chunk.entity_path) == "/joints/position_share" and not chunk.is_static:
            batch = chunk.to_record_batch()
            t_ns = np.array(batch["sim_time"].cast(pa.int64()).to_pylist())
            wall_ns = np.array(batch["wall_clock"].cast(pa.int64()).to_pylist())
            assert np.all(wall_ns == epoch_ns + 2 * t_ns)
            return
    pytest.fail("no joints/position_share")
