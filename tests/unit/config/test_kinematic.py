"""Kinematic scenario files: told apart by `kind`, checked as strictly as the others, refused in one line."""

import tomllib
from pathlib import Path

import pytest

from config.errors import ConfigError
from config.kinematic import KinematicScenario, WristSingularityScenario
from config.load import SCENARIO_DIR, dump_scenario, load_scenario, validate
from config.scenario import Scenario

PASS = "wrist-singularity-pass"


def test_the_kind_decides_what_is_loaded() -> None:
    assert isinstance(load_scenario(PASS), WristSingularityScenario)
    assert isinstance(load_scenario("sliding-door"), Scenario)
    assert not isinstance(load_scenario("sliding-door"), KinematicScenario)


def test_the_resolved_scenario_reproduces_itself() -> None:
    scenario = load_scenario(PASS, ["experiment.optimisation.beta=1.5", "seed=7"])
    again = validate(WristSingularityScenario, tomllib.loads(dump_scenario(scenario)), "dump")
    assert again == scenario
    assert again.experiment.optimisation.beta == 1.5


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("experiment.optimisation.bets=1.0", ["wrist-singularity-pass.toml", "experiment.optimisation.bets", "'beta'"]),
        ("experiment.strat=[0.0]", ["'experiment.strat'", "did you mean 'start'?"]),
        ("cycle_s=nan", ["cycle_s", "NaN", "finite"]),
        ("cycle_s=0", ["cycle_s", "greater than 0"]),
        ("experiment.leg.0.duration_s=-1.0", ["experiment.leg.0.duration_s", "-1.0", "greater than 0"]),
        ("experiment.leg=[]", ["at least one [[experiment.leg]]"]),
        ("experiment.leg.0.translation_m=[0.0, inf, 0.0]", ["experiment.leg.0.translation_m.1", "finite"]),
        ("experiment.optimisation.iterations=0", ["experiment.optimisation.iterations", "greater than or equal to 1"]),
        ("experiment.type=wrist-singularty", ["experiment.type", "did you mean 'wrist-singularity'?"]),
        ("kind=kinematics", ["kind", "'kinematics'", "'kinematic'"]),
        ("slip.sigma=0.1", ["unknown key 'slip'"]),
        ("duration_s=3.0", ["unknown key 'duration_s'"]),
    ],
)
def test_what_is_wrong_is_named(override: str, parts: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario(PASS, [override])
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_an_experiment_without_type_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text((SCENARIO_DIR / f"{PASS}.toml").read_text().replace('type = "wrist-singularity"\n', ""))
    with pytest.raises(ConfigError, match=r"experiment\.type' is missing"):
        load_scenario(str(path))
