"""Records the golden runs anew: `make golden`. The commit that contains them says why the planner's frames have changed.

Each is the begin of a scenario, as its resolved scenario.toml and its bus.log, compressed.
"""

from __future__ import annotations

import lzma
import tempfile
from pathlib import Path

from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.load import load_scenario
from config.scenario import Scenario

FOLDER = Path(__file__).parent
RUNS = {"sliding-door": 3.5, "hold-still": 2.0, "drive-square": 3.0}
"""Scenario and how many seconds of it: boot, enabling, and enough of the motion for every part of the planner to take part."""


def record(name: str, duration_s: float) -> int:
    """Runs it and replaces its golden files; the size of the log in bytes."""
    scenario = load_scenario(name)
    assert isinstance(scenario, Scenario)
    target = FOLDER / name
    target.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        run_scenario(scenario, RunOptions(out=Path(folder), duration_s=duration_s, record=False, quiet=True))
        (target / "scenario.toml").write_bytes((Path(folder) / "scenario.toml").read_bytes())
        packed = lzma.compress((Path(folder) / "bus.log").read_bytes(), preset=9 | lzma.PRESET_EXTREME)
    (target / "bus.log.xz").write_bytes(packed)
    return len(packed)


if __name__ == "__main__":
    for name, duration_s in RUNS.items():
        print(f"tests/golden/{name}: {record(name, duration_s) / 1e3:.0f} kB")
