"""Two or more runs side by side: one table of their metrics, one recording of all of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canipulator.outcome import progress_bar
from config.errors import ConfigError
from config.kinematic import KinematicScenario
from config.load import load_scenario
from config.scenario import Scenario
from drivers.codec import MISSION
from drivers.frame_codec import CodecError
from logs.bus_log import BusLogError, read_bus_log
from logs.comparison import LABELS, ComparedRun, record_comparison
from logs.comparison_table import Row, markdown, metric_rows
from logs.optimise import optimise
from logs.recording_reader import Recording, read_recording
from logs.viewer import is_torn
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.messages import Mode


@dataclass(frozen=True, slots=True)
class Comparison:
    """Labels (A, B, …), names and metrics of the runs; `recording` is None with a `reason` where there could be none."""

    labels: tuple[str, ...]
    titles: tuple[str, ...]
    rows: list[Row]
    recording: Path | None
    reason: str = ""


def compare_runs(run_dirs: Sequence[Path], out: Path, *, quiet: bool = False) -> Comparison:
    """Reads the runs and writes `out`.

    Raises ConfigError for a folder that is no run, for fewer than two and more than eight of them, OSError where `out` cannot be written.
    """
    if not 2 <= len(run_dirs) <= len(LABELS):
        raise ConfigError(f"compare: {len(run_dirs)} run{'s' * (len(run_dirs) != 1)}; must be 2 to {len(LABELS)}")
    scenarios = [scenario_of(run_dir) for run_dir in run_dirs]
    labels, titles = tuple(LABELS[: len(run_dirs)]), run_titles(run_dirs)
    rows = metric_rows([read_metrics(run_dir) for run_dir in run_dirs])
    reason = _obstacle(run_dirs, scenarios)
    if reason:
        return Comparison(labels, titles, rows, None, reason)
    with progress_bar("compare", len(run_dirs) + 1, quiet=quiet) as advance:
        runs = []
        for i, (run_dir, scenario, title) in enumerate(zip(run_dirs, scenarios, titles, strict=True)):
            advance(i, title)
            assert isinstance(scenario, Scenario)  # `_obstacle` has looked
            runs.append(ComparedRun(title, read_recorded(run_dir), task_start_ns(run_dir, scenario)))
        advance(len(run_dirs), "writes")
        robot = scenarios[0].robot
        out.parent.mkdir(parents=True, exist_ok=True)
        urdf = robot_directory(robot) / "robot.urdf"
        record_comparison(out, runs, ArmModel.load(robot), urdf, markdown(labels, titles, rows))
    return Comparison(labels, titles, rows, out)


def task_start_ns(run_dir: Path, scenario: Scenario) -> int:
    """When the first step that moves anything began, from the mission frames on the bus; 0 when no step ever did.

    For a mission that only waits, it is the begin of its first step. Raises ConfigError for a log that cannot be read.
    """
    moving = (i for i, step in enumerate(scenario.step) if step.kind != "wait")
    wanted = next(moving, 0)
    assembler = MISSION.assembler()
    try:
        for frame in read_bus_log(run_dir / "bus.log"):
            if frame.can_id not in MISSION.can_ids:
                continue
            try:
                mission = assembler.feed(frame.can_id, frame.data)
            except CodecError:
                continue
            if mission is not None and mission.mode is not Mode.OFF and mission.step >= wanted:
                return frame.t_ns
    except BusLogError as error:
        raise ConfigError(str(error)) from None
    return 0


def read_recorded(run_dir: Path) -> Recording:
    """The recording of a run; one that was torn off is mended first. Raises ConfigError where it cannot be read."""
    path = run_dir / "run.rrd"
    if is_torn(path):  # of a run that was killed
        optimise(path)
    try:
        return read_recording(path)
    except ValueError as error:
        raise ConfigError(str(error)) from None


def _obstacle(run_dirs: Sequence[Path], scenarios: Sequence[Scenario | KinematicScenario]) -> str:
    """Why these runs cannot be in one recording, or nothing."""
    for run_dir, scenario in zip(run_dirs, scenarios, strict=True):
        if not isinstance(scenario, Scenario):
            return f"{run_dir} is a kinematic run; only runs with physics and bus are drawn together"
        if not (run_dir / "run.rrd").is_file():
            return f"{run_dir} has no run.rrd (it was run with --no-rerun)"
        if scenario.robot != scenarios[0].robot:
            return f"{run_dir} is of another robot ({scenario.robot}, not {scenarios[0].robot})"
    return ""


def run_titles(run_dirs: Sequence[Path]) -> tuple[str, ...]:
    """The folders' names, with the folders above them as far as it takes to tell them apart."""
    parts = [run_dir.resolve().parts for run_dir in run_dirs]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return tuple(names)
    return tuple("/".join(part[-1:]) for part in parts)


def scenario_of(run_dir: Path) -> Scenario | KinematicScenario:
    """The scenario of a run. Raises ConfigError for a folder that is none."""
    path = run_dir / "scenario.toml"
    if not path.is_file():
        raise ConfigError(f"{path}: no such file; RUN must be the folder of a run")
    return load_scenario(str(path))


def read_metrics(run_dir: Path) -> dict[str, Any]:
    """metrics.json of a run. Raises ConfigError where there is none or it cannot be read."""
    path = run_dir / "metrics.json"
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; the run was killed, or RUN is not the folder of a run") from None
    except ValueError as error:
        raise ConfigError(f"{path}: not JSON: {error}") from None
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: must hold an object")
    return values
