"""The planner still sends what it sent: short runs, recorded once, whose feedback is played to it again.

A difference that is meant is recorded by `make golden`, and the commit says why.
"""

import lzma
from pathlib import Path

import pytest

from canipulator.replay import explain, read_run, replay
from config.robot import load_robot
from tests.golden.record import FOLDER, RUNS

TOLERANCE = 1e-7
"""In SI, where one count of the wire is not more than that: other processors may round the last bit of a float the other way."""


def unpacked(name: str, folder: Path) -> Path:
    (folder / "scenario.toml").write_bytes((FOLDER / name / "scenario.toml").read_bytes())
    (folder / "bus.log").write_bytes(lzma.decompress((FOLDER / name / "bus.log.xz").read_bytes()))
    return folder


@pytest.mark.parametrize("name", RUNS)
def test_the_planner_sends_what_it_sent_when_this_was_recorded(name: str, tmp_path: Path) -> None:
    scenario, frames = read_run(unpacked(name, tmp_path))
    result = replay(scenario, frames, tolerance=TOLERANCE)
    first = result.first
    assert first is None, explain(first, load_robot(scenario.robot).devices.values())
    assert result.cycles > 150
    assert result.frames > 10 * result.cycles, "set points of ten drives and more in every cycle"


def test_golden_logs_stay_small() -> None:
    assert sum(path.stat().st_size for path in FOLDER.rglob("*.xz")) < 300_000
