"""Same seed, same frames: every scenario with physics, run twice. (Another process and hash seed: see test_bus_of_a_run.)"""

from pathlib import Path

import pytest

from config.load import load_scenario, scenario_names
from config.scenario import Scenario
from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow

NAMES = [name for name in scenario_names() if isinstance(load_scenario(name), Scenario)]
DURATION_S = 3.0


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_gives_the_same_frames(name: str, runner: Runner) -> None:
    first, second = (runner(name, duration_s=DURATION_S).directory / "bus.log" for _ in range(2))
    assert Path(first).read_bytes() == Path(second).read_bytes()
