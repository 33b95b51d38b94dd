"""The numbers of a finished run: its metrics on the terminal, its signals in a file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from rich.console import Console
from rich.table import Table

from canipulator.compare import read_metrics
from canipulator.outcome import progress_bar
from canipulator.replay import read_run
from config.errors import ConfigError
from config.robot import load_robot
from logs.comparison_table import metric_rows, shown
from logs.signal_table_file import columns_of, decode_frames, write_csv, write_parquet
from stack.messages import Vector


def print_metrics(run_dir: Path) -> None:
    """Every metric of metrics.json, a line each. Raises ConfigError where there is none."""
    table = Table.grid(padding=(0, 2))
    for row in metric_rows([read_metrics(run_dir)]):
        table.add_row(row.name, shown(row.values[0]))
    Console().print(table, highlight=False)


def write_signals(run_dir: Path, path: Path, *, parquet: bool) -> tuple[int, int]:
    """Numbers of rows and columns written. Raises ConfigError for what is no run with a bus, OSError where `path` cannot be written."""
    names, values = _columns(run_dir)
    path.parent.mkdir(parents=True, exist_ok=True)
    (write_parquet if parquet else write_csv)(path, names, values)
    return len(values[0]), len(names)


@lru_cache(maxsize=1)  # both formats of one call
def _columns(run_dir: Path) -> tuple[list[str], list[Vector]]:
    with progress_bar(f"metrics {run_dir.name}", 2, quiet=False) as advance:
        advance(0, "reads and decodes")
        scenario, frames = read_run(run_dir)
        robot = load_robot(scenario.robot)
        table = decode_frames(
            frames,
            robot.devices.values(),
            robot.arm,
            sync_period_ns=round(1e9 / scenario.planner.arm_cycle_hz),
            bitrate=scenario.bus.bitrate,
        )
        advance(1, "writes")
        try:
            return columns_of(table, robot.arm.joint_names)
        except KeyError:
            raise ConfigError(
                f"{run_dir / 'bus.log'}: holds no SYNC, so there is no arm cycle to make rows of"
            ) from None
