"""Figures of finished runs, from their recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from canipulator.compare import read_recorded, run_titles, scenario_of
from canipulator.outcome import progress_bar
from config.errors import ConfigError
from config.scenario import Scenario
from logs.comparison import LABELS
from logs.figures import FigureRun, save_figures
from stack.kinematics import ArmModel


def plot_runs(run_dirs: Sequence[Path], out: Path | None, *, quiet: bool = False) -> list[Path]:
    """Writes the figures into `out`, by default RUN/figures for one run and `figures` for several; what was written.

    Raises ConfigError for what is no run with physics, bus and recording, for runs of different robots and for more than eight,
    OSError where the figures cannot be written.
    """
    if len(run_dirs) > len(LABELS):
        raise ConfigError(f"plot: {len(run_dirs)} runs; at most {len(LABELS)}")
    robots = []
    for run_dir in run_dirs:
        scenario = scenario_of(run_dir)
        if not isinstance(scenario, Scenario):
            raise ConfigError(f"{run_dir}: a kinematic run; its plots are in its recording")
        if not (run_dir / "run.rrd").is_file():
            raise ConfigError(f"{run_dir}: has no run.rrd (it was run with --no-rerun)")
        robots.append(scenario.robot)
    if len(set(robots)) > 1:
        raise ConfigError(f"plot: runs of different robots ({', '.join(sorted(set(robots)))})")
    folder = out or (run_dirs[0] if len(run_dirs) == 1 else Path()) / "figures"
    with progress_bar("plot", len(run_dirs) + 1, quiet=quiet) as advance:
        runs = []
        for i, (run_dir, title) in enumerate(zip(run_dirs, run_titles(run_dirs), strict=True)):
            advance(i, f"reads {title}")
            runs.append(FigureRun(title, read_recorded(run_dir)))
        advance(len(run_dirs), "draws")
        return save_figures(runs, ArmModel.load(robots[0]), folder)
