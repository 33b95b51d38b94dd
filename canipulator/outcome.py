"""What every kind of run has in common: its options, its folder, its expectations, how it ends and what the terminal shows."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from config.errors import ConfigError
from config.scenario import ExpectTable
from logs.detail import Detail
from logs.expectations import Expectation
from logs.metrics import Metrics
from logs.summary import summary

if TYPE_CHECKING:
    from canipulator.serving import ServedRun

OK, EXPECTATION_MISSED, INTERRUPTED = 0, 1, 130


@dataclass(frozen=True)
class RunOptions:
    """How to run, beside what the scenario says. `duration_s` cuts it short and leaves the expectations unjudged.

    `record`: whether there is a recording, `detail`: how much is in it, `viewer`: address of one that shows it while the run goes on.
    `dashboard`: in the terminal while the run goes on; None: in real time, where there is a terminal.
    `served`: the run's bus is open to CAN tools, and virtual time keeps to real time.
    """

    out: Path | None = None
    duration_s: float | None = None
    record: bool = True
    detail: Detail = Detail.FULL
    viewer: str | None = None
    quiet: bool = False
    served: ServedRun | None = None
    dashboard: bool | None = None


@dataclass(frozen=True)
class Outcome:
    """What is left of a run: its folder, its metrics as in metrics.json, and the exit code."""

    directory: Path
    metrics: dict[str, Any]
    exit_code: int


def run_directory(name: str, options: RunOptions) -> Path:
    """The run's folder, made; `runs/<name>-<n>` with the next free n unless one was asked for.

    Raises OSError where it cannot be made, ConfigError after a million runs.
    """
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        return options.out
    for n in range(1, 1_000_000):
        directory = Path("runs") / f"{name}-{n}"
        with contextlib.suppress(FileExistsError):
            directory.mkdir(parents=True)
            return directory
    raise ConfigError("runs/: too many runs; remove some, or give --out")


def expectations(tables: Iterable[ExpectTable]) -> list[Expectation]:
    """The scenario's [[expect]] tables, one expectation for each bound."""
    found = []
    for expect in tables:
        if expect.max is not None:
            found.append(Expectation(expect.metric, "<=", expect.max))
        if expect.min is not None:
            found.append(Expectation(expect.metric, ">=", expect.min))
    return found


def flat(values: dict[str, Any], prefix: str = "") -> dict[str, str | int | float | bool]:
    """The resolved scenario as flat properties of the recording."""
    found: dict[str, str | int | float | bool] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            found |= flat(value, f"{prefix}{key}.")
        elif isinstance(value, str | int | float | bool):
            found[prefix + key] = value
    return found


def revision() -> str:
    """The project's git revision, empty outside a checkout."""
    with contextlib.suppress(OSError):
        answer = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"],
            capture_output=True,
            text=True,
            check=False,
        )
        return answer.stdout.strip()
    return ""


@contextlib.contextmanager
def progress_bar(title: str, total: float, *, quiet: bool) -> Iterator[Callable[[float, str], None]]:
    """A bar on stderr for people, nothing for pipes; call what it gives with what is done and a word about it."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[at]}"), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task(title, total=total, at="")
        yield lambda done, at: bar.update(task, completed=done, at=at)


def show(metrics: Metrics, directory: Path, options: RunOptions) -> None:
    """The summary on stdout, and where the files are."""
    console = Console()
    console.print(summary(metrics))
    console.print(f"files      {directory}/  (bus.log, events.log, metrics.json, scenario.toml)", highlight=False)
    if options.record:
        console.print(f"recording  {directory / 'run.rrd'}  (canipulator view {directory})", highlight=False)
