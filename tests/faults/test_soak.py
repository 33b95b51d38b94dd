"""The soak finds what breaks, makes it small, and writes it down so that it can be run again."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from canipulator import soak
from config.load import load_scenario
from config.scenario import Scenario
from tests.faults.harness import scenario_with

pytestmark = pytest.mark.slow


def test_the_same_seed_gives_the_same_cases() -> None:
    first, second = ([soak.random_case(draw) for _ in range(20)] for draw in (random.Random(5), random.Random(5)))
    assert first == second
    assert len({case.text for case in first}) == 20


def test_a_case_that_holds_is_no_failure() -> None:
    assert soak.run_case(soak.Case(scenario_with("hold-still", ["over-current@1:node=24"]), 1.5)) is None


def test_a_failing_case_is_made_small_and_can_be_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak, "VELOCITY_SHARE", 0.02)  # so strict that the motion of the task itself breaks it
    monkeypatch.setattr(soak, "SHOCK_SHARE", 0.02)
    breaking = soak.Case(scenario_with("sliding-door", ["feedback-lost@0.5", "force-stuck@0.6"]), 4.0)
    monkeypatch.setattr(soak, "random_case", lambda draw: breaking)
    assert soak.soak(1e-3, 3, tmp_path, quiet=True) == 1
    (path,) = tmp_path.glob("soak-3-*.toml")
    again = load_scenario(str(path))
    assert isinstance(again, Scenario)
    assert again.fault == ()
    assert again.duration_s < 3.0
    assert soak.run_case(soak.Case(again, again.duration_s)) is not None


def test_a_joint_that_stays_too_fast_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak, "VELOCITY_SHARE", 0.5)  # the task is faster for longer than a shock
    failure = soak.run_case(soak.Case(scenario_with("point-to-point", []), 2.6))
    assert failure is not None
    monkeypatch.setattr(soak, "SHOCK_STEPS", 3000)
    assert soak.run_case(soak.Case(scenario_with("point-to-point", []), 2.6)) is None


@pytest.mark.parametrize(
    "fault",
    [
        "encoder-frozen@2.44:node=25",
        "encoder-frozen@2.392:node=23,for_s=0.053",
        "drive-stuck@0.655:node=26,for_s=0.276",
    ],
)
def test_what_the_soak_has_found_does_not_come_back(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Elbow or shoulder blind at full speed: one ran away for 10 ms, the other was stopped so hard that the elbow got what it had. A
    joint that was held catches up, with what its loop had wound up while it was."""
    monkeypatch.setattr(soak, "SHOCK_STEPS", 0)
    case = soak.Case(scenario_with("point-to-point", [fault]), 2.6)
    assert soak.run_case(case) is None
