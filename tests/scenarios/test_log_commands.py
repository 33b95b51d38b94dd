"""`canipulator metrics` and `canipulator plot` on a finished run."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow


def command(*arguments: object, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "canipulator", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False, cwd=folder)


def test_metrics_prints_every_number(standard_door: Outcome) -> None:
    answer = command("metrics", standard_door.directory)
    assert answer.returncode == 0
    lines = dict(line.split(None, 1) for line in answer.stdout.splitlines())
    assert float(lines["tcp_error_rms_m"]) == pytest.approx(standard_door.metrics["tcp_error_rms_m"], rel=1e-3)
    assert lines["limit_violations.position"].strip() == "0"


def test_signals_have_a_row_for_each_cycle_and_set_points_stand_where_they_are_reached(
    standard_door: Outcome, tmp_path: Path
) -> None:
    answer = command(
        "metrics", standard_door.directory, "--csv", tmp_path / "t.csv", "--parquet", tmp_path / "t.parquet"
    )
    assert answer.returncode == 0, answer.stderr
    with (tmp_path / "t.csv").open(newline="") as file:
        head, *lines = csv.reader(file)
    assert len(lines) == standard_door.metrics["arm_cycles"]
    pairs = []
    for name in ("joints/position/target/wrist_pan [rad]", "joints/position/actual/wrist_pan [rad]"):
        at = head.index(name)
        pairs.append(np.array([float(line[at] or "nan") for line in lines]))
    off = np.abs(pairs[0] - pairs[1])[400:-50]
    assert float(np.nanmax(off)) < 5e-3, "the drive is where it was told to be by then"
    assert (tmp_path / "t.parquet").stat().st_size > 100_000


def test_plot_writes_the_figures_beside_the_run(standard_door: Outcome, tmp_path: Path) -> None:
    answer = command("plot", standard_door.directory, "--out", tmp_path)
    assert answer.returncode == 0, answer.stderr
    written = [Path(line) for line in answer.stdout.splitlines()]
    assert {path.stem for path in written} == {"path", "error", "manipulability", "platform", "joints"}
    assert all(path.stat().st_size > 5_000 for path in written)


def test_what_is_wrong_gets_one_line_and_exit_code_2(runner: Runner) -> None:
    bare = runner("hold-still", duration_s=0.5).directory
    wrong = (
        (["plot", bare], "no run.rrd"),
        (["plot", "/nowhere"], "/nowhere"),
        (["metrics", "/nowhere"], "/nowhere"),
        (["metrics", "/nowhere", "--csv", bare / "t.csv"], "/nowhere"),
        (["metrics", bare, "--csv", "/proc/no/t.csv"], "/proc/no"),
    )
    for arguments, part in wrong:
        answer = command(*arguments)
        assert answer.returncode == 2, arguments
        assert answer.stderr.startswith("canipulator: ")
        assert answer.stderr.count("\n") == 1
        assert part in answer.stderr


@pytest.mark.parametrize("name", ["replay", "compare", "metrics", "plot"])
def test_each_has_a_help_page(name: str) -> None:
    answer = command(name, "--help")
    assert answer.returncode == 0
    assert "Usage:" in answer.stdout
    assert "RUN" in answer.stdout
