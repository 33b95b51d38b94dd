"""Same seed, same frames: every scenario with physics, run twice in two processes with different hash seeds."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from config.load import load_scenario, scenario_names
from config.scenario import Scenario

pytestmark = pytest.mark.slow

NAMES = [name for name in scenario_names() if isinstance(load_scenario(name), Scenario)]
DURATION_S = 4.0


def bus_of(name: str, out: Path, hash_seed: str) -> str:
    command = [
        sys.executable,
        "-m",
        "canipulator",
        "run",
        name,
        "--no-rerun",
        "--json",
        "--duration",
        str(DURATION_S),
        "--out",
        str(out),
    ]
    environment = os.environ | {"PYTHONHASHSEED": hash_seed}
    subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=True, timeout=300)
    return hashlib.sha256((out / "bus.log").read_bytes()).hexdigest()


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_frames(name: str, tmp_path: Path) -> None:
    assert bus_of(name, tmp_path / "a", "1") == bus_of(name, tmp_path / "b", "2")
