"""Commands that look at finished runs: replay, compare, metrics, plot, why."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from canipulator.replay import Replayed
    from config.scenario import Scenario

RUN = click.Path(path_type=Path)


@click.command()
@click.argument("run_dir", metavar="RUN", type=RUN)
@click.option("--with", "method", metavar="METHOD", help="Another method instead: pns, fsp, gradient, qp.")
@click.option("--out", type=RUN, help="With --with: the figure [default: RUN/replay-METHOD.png].")
def replay(run_dir: Path, method: str | None, out: Path | None) -> None:
    """Feed the recorded bus of RUN (its directory) to a planner and compare what it sends with the log, frame by frame.

    Exit code 0: every identifier, every byte and the order are those of the log. 1: they differ; the first difference is explained.
    2: bad input.

    A run in real time does not repeat to the bit: its frames are moved to the grid of SYNC, and of the planner's set points 99 % must
    agree within 0.02 rad, m or rad/s.

    With --with, the planner works by another method on the same recorded feedback (open loop: its commands move nothing). Its set
    points are compared with those of the run in numbers and in a figure; exit code 0.
    """
    from canipulator.replay import replay_run, was_in_real_time

    if method is None:
        if out is not None:
            raise click.UsageError("--out is for the figure of --with METHOD")
        if was_in_real_time(run_dir):
            raise SystemExit(_real_time(run_dir))
        scenario, result = replay_run(run_dir)
        raise SystemExit(_verdict(scenario, result))
    scenario, result = replay_run(run_dir, method)
    _show_other(run_dir, scenario, result, out or run_dir / f"replay-{method}.png")


def _verdict(scenario: Scenario, result: Replayed) -> int:
    """One line for a replay that is identical, an explanation for one that is not; the exit code."""
    from canipulator.replay import explain
    from config.robot import load_robot

    if result.first is None:
        click.echo(f"identical: {result.frames} frames of the planner in {result.cycles} arm cycles, bit for bit")
        return 0
    click.echo(f"different: {result.differing} of {result.frames} frames of the planner; the first:")
    click.echo(explain(result.first, load_robot(scenario.robot).devices.values()))
    return 1


def _real_time(run_dir: Path) -> int:
    """One line for set points that agree, one for each drive where they do not; the exit code."""
    from canipulator.replay_realtime import LEAST_SHARE, replay_run_in_real_time

    result = replay_run_in_real_time(run_dir)
    text = f"{100 * result.agreeing:.2f} % of {result.compared} set points in {result.cycles} arm cycles agree"
    click.echo(f"{'alike' if result.ok else 'different'}: {text} within {result.tolerance:g} rad, m or rad/s")
    if not result.ok:
        click.echo(f"  at least {100 * LEAST_SHARE:g} % must; the largest difference of each drive:")
        for name, largest in result.largest.items():
            click.echo(f"  {name:<14} {largest:.4g}")
    return 0 if result.ok else 1


def _show_other(run_dir: Path, scenario: Scenario, result: Replayed, figure: Path) -> None:
    from rich.console import Console

    from canipulator.replay import drive_set_points
    from config.load import load_scenario
    from config.robot import load_robot
    from config.scenario import Scenario
    from logs.open_loop import difference_table, save_open_loop

    recorded = load_scenario(str(run_dir / "scenario.toml"))
    assert isinstance(recorded, Scenario)  # it has been replayed
    drives = drive_set_points(result, load_robot(scenario.robot).devices)
    save_open_loop(drives, figure, recorded.planner.method, scenario.planner.method)
    console = Console()
    console.print(difference_table(drives, scenario.planner.method))
    if all(drive.largest == 0.0 for drive in drives):
        console.print(
            f"{scenario.planner.method} would have sent the same set points: nothing in this run tells the two apart"
        )
    console.print(f"figure  {figure}", highlight=False)


@click.command()
@click.argument("run_dirs", metavar="RUN RUN [...]", nargs=-1, required=True, type=RUN)
@click.option("--out", type=RUN, default=Path("compare.rrd"), show_default=True, help="Where the recording goes.")
def compare(run_dirs: tuple[Path, ...], out: Path) -> None:
    """Compare runs: their metrics side by side (* and the change against the first: what differs), and one recording with all of them.

    In the recording the first robot is solid, the others are ghosts; curves lie over each other. Time 0 is where the first step that
    moves anything begins. Open it with `canipulator view compare.rrd`.
    """
    from rich.console import Console

    from canipulator.compare import compare_runs
    from logs.comparison_table import comparison_table

    found = compare_runs(run_dirs, out)
    console = Console(width=None if sys.stdout.isatty() else 200)
    console.print(comparison_table(found.labels, found.titles, found.rows))
    if found.recording is None:
        console.print(f"recording  none: {found.reason}", highlight=False)
    else:
        console.print(f"recording  {found.recording}  (canipulator view {found.recording})", highlight=False)


@click.command()
@click.argument("run_dir", metavar="RUN", type=RUN)
@click.option("--csv", "csv_file", type=RUN, help="Write the signals to this file, as CSV.")
@click.option("--parquet", "parquet_file", type=RUN, help="Write the signals to this file, as Parquet.")
def metrics(run_dir: Path, csv_file: Path | None, parquet_file: Path | None) -> None:
    """Print the metrics of RUN, or write its signals as a table.

    The table is decoded from the run's bus.log: a row for each arm cycle, a column for each value, SI units in their names. What comes
    at other times than SYNC is held; empty cells are values that were not known (any more).
    """
    from canipulator.signals_of_run import print_metrics, write_signals

    if csv_file is None and parquet_file is None:
        print_metrics(run_dir)
    for path in (csv_file, parquet_file):
        if path is not None:
            rows, columns = write_signals(run_dir, path, parquet=path is parquet_file)
            click.echo(f"{path}  {rows} rows, {columns} columns")


@click.command()
@click.argument("run_dirs", metavar="RUN [RUN ...]", nargs=-1, required=True, type=RUN)
@click.option("--out", type=RUN, help="Folder of the figures [default: RUN/figures; of several runs ./figures].")
def plot(run_dirs: tuple[Path, ...], out: Path | None) -> None:
    """Draw the figures of a report, as PDF and PNG: paths from above, TCP error, manipulability, platform velocity, joints and limits.

    Several runs are drawn over each other.
    """
    from canipulator.plot import plot_runs

    for path in plot_runs(run_dirs, out):
        click.echo(path)


@click.command()
@click.argument("run_dir", metavar="RUN", type=RUN)
def why(run_dir: Path) -> None:
    """Say why RUN (its directory, or the .rrd file) stopped, from its recording alone.

    What came first and whom it befell, how the robot stood just before, the events around it, and what followed. Exit code 0 for a run
    that did not stop before its time, 1 for one that did.
    """
    from config.errors import ConfigError
    from logs.optimise import optimise
    from logs.story import tell
    from logs.viewer import is_torn

    path = run_dir / "run.rrd" if run_dir.is_dir() else run_dir
    if not path.is_file():
        raise ConfigError(f"{path}: no recording there (a run with --no-rerun has none)")
    if is_torn(path):
        optimise(path)
    try:
        story = tell(path)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    click.echo(story.text())
    raise SystemExit(0 if story.stopped_ns is None else 1)


COMMANDS = (replay, compare, metrics, plot, why)
