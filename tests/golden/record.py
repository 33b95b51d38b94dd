"""Records the golden runs anew: `make golden`. The commit that contains them says why the planner's frames have changed.

Each is the begin of a scenario, as its resolved scenario.toml and its bus.log, compressed. Every scenario with a bus has one.
With names, only those: `python -m tests.golden.record workbench`.
"""

from __future__ import annotations

import lzma
import sys
import tempfile
from pathlib import Path

from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.load import load_scenario, scenario_names
from config.scenario import Scenario

FOLDER = Path(__file__).parent
EXCLUDED: frozenset[str] = frozenset()
"""Scenarios without a golden run, each with a reason beside it."""
SECONDS = {"sliding-door": 3.5, "hold-still": 2.0, "drive-square": 3.0}
"""How much of a scenario, where it is not `DEFAULT_S`: boot, enabling, and enough motion for every part of the planner to take part."""
DEFAULT_S = 2.5


def golden_names() -> list[str]:
    """Every scenario with a bus but those in EXCLUDED. Kinematic ones have no frames that could be played."""
    return [name for name in scenario_names() if name not in EXCLUDED and isinstance(load_scenario(name), Scenario)]


def record(name: str) -> int:
    """Runs it and replaces its golden files; the size of the log in bytes."""
    scenario = load_scenario(name)
    assert isinstance(scenario, Scenario)
    target = FOLDER / name
    target.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        duration_s = SECONDS.get(name, DEFAULT_S)
        run_scenario(scenario, RunOptions(out=Path(folder), duration_s=duration_s, record=False, quiet=True))
        (target / "scenario.toml").write_bytes((Path(folder) / "scenario.toml").read_bytes())
        packed = lzma.compress((Path(folder) / "bus.log").read_bytes(), preset=9 | lzma.PRESET_EXTREME)
    (target / "bus.log.xz").write_bytes(packed)
    return len(packed)


if __name__ == "__main__":
    for name in sys.argv[1:] or golden_names():
        print(f"tests/golden/{name}: {record(name) / 1e3:.0f} kB")
