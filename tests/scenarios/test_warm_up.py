"""No cycle of the planner waits for code that is loaded, or compiled, on its first call: that takes as long as a whole cycle."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("loaded_late.py")
ROOT = PROGRAM.parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sliding-door", "hinged-door"])
def test_everything_that_a_mission_calls_was_called_by_the_warm_up(name: str, tmp_path: Path) -> None:
    command = [sys.executable, str(PROGRAM), name, str(tmp_path)]
    answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert answer.returncode == 0, answer.stderr
    found = json.loads(answer.stdout.splitlines()[-1])
    assert found["before"] > 10
    assert found["late"] == []
