"""`canipulator compare`: the table, and the one recording that holds all runs."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from canipulator.compare import compare_runs, task_start_ns
from canipulator.replay import read_run
from canipulator.run import Outcome
from logs.comparison_blueprint import TASK_TIME, view_contents
from logs.recording_reader import read_recording
from stack.kinematics import ArmModel
from tests.scenarios.conftest import run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """The same task with another seed and a robot that obeys; cut short."""
    folder = tmp_path_factory.mktemp("other")
    overrides = ("seed=2", 'planner.coordination="unified"', "step.0.duration_s=1.0")
    return run(folder, "sliding-door", *overrides, duration_s=6.0, record=True)


@pytest.fixture(scope="module")
def compared(standard_door: Outcome, other: Outcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("compare") / "both.rrd"
    found = compare_runs([standard_door.directory, other.directory], out, quiet=True)
    assert found.recording == out, found.reason
    return out


def entities(path: Path) -> dict[str, int]:
    rows: dict[str, int] = {}
    for chunk in RrdReader(str(path)).stream():
        name = str(chunk.entity_path).lstrip("/")
        rows[name] = rows.get(name, 0) + (0 if chunk.is_static else chunk.num_rows)
    return rows


def test_every_view_has_both_runs(compared: Path) -> None:
    rows = entities(compared)
    for title, paths in view_contents("AB", ArmModel.load("moma8")).items():
        for path in paths:
            if path == "A/tcp_from_A_mm":  # nothing is away from itself
                continue
            if path.endswith("/**"):
                assert any(name.startswith(path[:-2]) and count for name, count in rows.items()), title
            else:
                assert rows.get(path, 0) > 100, (title, path)
    for label in "AB":
        assert rows[f"{label}/tf/platform"] > 100
        assert rows[f"{label}/tf/joints/elbow"] > 100
        assert f"{label}/moma8/visual_geometries/tower/visual_0" in rows


def test_runs_are_aligned_at_the_begin_of_their_first_motion(
    compared: Path, standard_door: Outcome, other: Outcome
) -> None:
    """The second run waits longer before it pulls; on the time of the task both begin to move together."""
    began = []
    for outcome in (standard_door, other):
        scenario, _ = read_run(outcome.directory)
        began.append(task_start_ns(outcome.directory, scenario))
    assert began[1] - began[0] == pytest.approx(0.5e9, abs=0.05e9)
    speeds = {}
    for chunk in RrdReader(str(compared)).stream():
        name = str(chunk.entity_path).lstrip("/")
        if name.endswith("/platform_v_m_per_s") and not chunk.is_static:
            batch = chunk.to_record_batch()
            t_s = batch.column(TASK_TIME).to_numpy(zero_copy_only=False).astype(np.int64) * 1e-9
            speeds.setdefault(name[0], []).extend(zip(t_s, batch.column("Scalars:scalars").flatten(), strict=True))
    first = [min(float(t) for t, v in speeds[label] if v.as_py() > 0.05) for label in "AB"]
    assert first[0] == pytest.approx(first[1], abs=0.3)
    assert 0.0 < first[0] < 2.0


def test_a_run_beside_itself_has_no_distance(standard_door: Outcome, tmp_path: Path) -> None:
    out = tmp_path / "same.rrd"
    found = compare_runs([standard_door.directory] * 2, out, quiet=True)
    assert not any(row.differs for row in found.rows)
    apart = [
        chunk.to_record_batch().column("Scalars:scalars").flatten().to_numpy()
        for chunk in RrdReader(str(out)).stream()
        if str(chunk.entity_path) == "/B/tcp_from_A_mm" and not chunk.is_static
    ]
    assert np.concatenate(apart).max() == 0.0


def test_the_true_path_reads_back_as_positions(standard_door: Outcome) -> None:
    recording = read_recording(standard_door.directory / "run.rrd")
    positions = recording.paths["world/path/true"].positions()
    assert np.all(np.diff(positions.t_ns) > 0)
    length = float(np.linalg.norm(positions.values[-1] - positions.values[0]))
    assert length == pytest.approx(standard_door.metrics["tcp_travel_m"], abs=0.01)


def command(*arguments: object) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "canipulator", "compare", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)


def test_the_table_marks_what_differs(standard_door: Outcome, other: Outcome, tmp_path: Path) -> None:
    out = tmp_path / "compare.rrd"
    answer = command(standard_door.directory, other.directory, "--out", out)
    assert answer.returncode == 0, answer.stderr
    lines = {line.strip(" *").split("  ")[0]: line for line in answer.stdout.splitlines()}
    assert lines["coordination"].startswith(" *")
    assert "unified" in lines["coordination"]
    assert lines["scenario"].startswith("  "), "the same in both"
    assert " %" in lines["tcp_error_rms_m"]
    assert str(out) in answer.stdout
    assert out.stat().st_size > 300_000


def test_without_a_recording_there_is_still_the_table(standard_door: Outcome, tmp_path: Path) -> None:
    bare = run(tmp_path / "bare", "sliding-door", duration_s=1.0)
    answer = command(standard_door.directory, bare.directory, "--out", tmp_path / "no.rrd")
    assert answer.returncode == 0
    assert "tcp_error_rms_m" in answer.stdout
    assert "no run.rrd" in answer.stdout
    assert not (tmp_path / "no.rrd").exists()


def test_what_is_wrong_gets_one_line_and_exit_code_2(standard_door: Outcome) -> None:
    for arguments, part in (([standard_door.directory], "2 to 8"), (["/nowhere", "/nowhere"], "/nowhere")):
        answer = command(*arguments)
        assert answer.returncode == 2
        assert answer.stderr.startswith("canipulator: ")
        assert answer.stderr.count("\n") == 1
        assert part in answer.stderr
