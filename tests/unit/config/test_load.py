"""Scenario files: what is accepted, what is refused, and that the refusal names file, key, value and what would be right."""

import tomllib
from pathlib import Path

import pytest

from config.errors import ConfigError
from config.load import SCENARIO_DIR, dump_scenario, load_scenario, scenario_names, validate
from config.mission import build_mission
from config.scenario import Scenario
from stack.kinematics import ArmModel

ARM = ArmModel.load("moma8")


@pytest.mark.parametrize("name", scenario_names())
def test_shipped_scenarios_load_and_expect_something(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.expect, "a scenario that expects nothing judges nothing"


MISSIONS = [name for name in scenario_names() if isinstance(load_scenario(name), Scenario)]


@pytest.mark.parametrize("name", MISSIONS)
def test_scenarios_with_physics_become_missions(name: str) -> None:
    assert build_mission(load_scenario(name), ARM).steps


@pytest.mark.parametrize("name", MISSIONS)
def test_the_resolved_scenario_reproduces_itself(name: str) -> None:
    scenario = load_scenario(name, ["slip.sigma=0.025", "seed=7"])
    again = validate(Scenario, tomllib.loads(dump_scenario(scenario)), "dump")
    assert again == scenario
    assert again.slip.sigma == 0.025


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("slip.sigm=1.0", ["sliding-door.toml", "'slip.sigm'", "did you mean 'sigma'?"]),
        ("step.2.spede_m_s=1.0", ["'step.2.spede_m_s'", "did you mean 'speed_m_s'?"]),
        ("slip.sigma=nan", ["slip.sigma", "NaN", "finite"]),
        ("slip.sigma=-0.1", ["slip.sigma", "-0.1", "greater than or equal to 0"]),
        ("slip.sigma=fast", ["slip.sigma", '"fast"', "valid number"]),
        ("planner.method=pnx", ["planner.method", '"pnx"', "'pns'"]),
        ("planner.case=5", ["planner.case", "5", "less than or equal to 4"]),
        ("duration_s=0", ["duration_s", "0", "greater than 0"]),
        ("planner.arm_cycle_hz=130", ["planner.arm_cycle_hz", "130", "125 and 142.857 Hz"]),
        ("planner.platform_cycle_hz=200", ["must not exceed arm_cycle_hz = 100"]),
        ("step.7.name=x", ["'7' is not an index of the list (0 to 3)"]),
        ("nonsense", ["must be KEY=VALUE"]),
        ("duration_s.x=1", ["not a table"]),
        ("step.2.kind=drive", ["platform_only"]),
        ("step.2.direction=[0.0, 0.0, 0.0]", ["zero vector"]),
        ("expect.0.min={}", ["expect.0.min", "valid number"]),
    ],
)
def test_what_is_wrong_is_named(override: str, parts: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario("sliding-door", [override])
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_unknown_scenario_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'sliding-door'"):
        load_scenario("sliding-dor")


def test_a_missing_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text((SCENARIO_DIR / "hold-still.toml").read_text().replace('title = "', 'titel = "'))
    with pytest.raises(ConfigError, match=r"titel|title"):
        load_scenario(str(path))


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe", b"[step]\nname = 1"])
def test_broken_files_are_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"broken\.toml") as caught:
        load_scenario(str(path))
    assert "\n" not in str(caught.value)


def test_preferences_of_the_wrong_length_are_refused() -> None:
    scenario = load_scenario("sliding-door", ["cases.2.heights=[1.0, 2.0]"])
    with pytest.raises(ConfigError, match="heights has 2 values, must have 8"):
        build_mission(scenario, ARM)


def test_preferences_of_the_case_lie_over_the_common_ones() -> None:
    scenario = load_scenario("sliding-door", ["planner.case=1"])
    merged = scenario.case_preferences()
    assert merged.weights == scenario.preferences.weights
    assert merged.heights == (0.0,) * 8
