"""The planner still sends what it sent: short runs, recorded once, whose feedback is played to it again.

A difference that is meant is recorded by `make golden`, and the commit says why.
"""

import lzma
from pathlib import Path

import pytest

from canipulator.replay import explain, read_run, replay
from config.load import scenario_names
from config.robot import load_robot
from tests.golden.record import EXCLUDED, FOLDER, golden_names

TOLERANCE = 1e-7
"""In SI, where one count of the wire is not more than that: other processors may round the last bit of a float the other way."""


def unpacked(name: str, folder: Path) -> Path:
    (folder / "scenario.toml").write_bytes((FOLDER / name / "scenario.toml").read_bytes())
    (folder / "bus.log").write_bytes(lzma.decompress((FOLDER / name / "bus.log.xz").read_bytes()))
    return folder


_FAST = ("sliding-door", "hold-still")
"""What `make check` replays; `make test` replays all."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in _FAST else pytest.mark.slow) for name in golden_names()]
)
def test_the_planner_sends_what_it_sent_when_this_was_recorded(name: str, tmp_path: Path) -> None:
    assert (FOLDER / name / "bus.log.xz").is_file(), f"no golden run of {name}: make golden"
    scenario, frames = read_run(unpacked(name, tmp_path))
    result = replay(scenario, frames, tolerance=TOLERANCE)
    first = result.first
    assert first is None, explain(first, load_robot(scenario.robot).devices.values())
    assert result.cycles > 150
    assert result.frames > 10 * result.cycles, "set points of ten drives and more in every cycle"


def test_golden_logs_stay_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.rglob("*.xz")) < 800_000


def test_every_golden_run_is_of_a_scenario_that_there_is() -> None:
    there = {path.parent.name for path in FOLDER.glob("*/bus.log.xz")}
    assert there <= set(golden_names())
    assert set(scenario_names()) >= EXCLUDED
