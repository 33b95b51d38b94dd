"""Whole runs, in physics and over the bus; the expensive ones once per session."""

from collections.abc import Callable
from pathlib import Path

import pytest

from canipulator.run import Outcome, RunOptions, run_scenario
from config.load import load_scenario

Runner = Callable[..., Outcome]


def run(out: Path, name: str, *overrides: str, duration_s: float | None = None, record: bool = False) -> Outcome:
    """One run of `name` with `--set` overrides into `out`."""
    return run_scenario(
        load_scenario(name, overrides), RunOptions(out=out, duration_s=duration_s, record=record, quiet=True)
    )


@pytest.fixture
def runner(tmp_path: Path) -> Runner:
    def start(name: str, *overrides: str, **options: object) -> Outcome:
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        return run(folder, name, *overrides, **options)  # type: ignore[arg-type]

    return start


@pytest.fixture(scope="session")
def standard_door(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """`sliding-door` as it ships, with a recording."""
    return run(tmp_path_factory.mktemp("door"), "sliding-door", record=True)
