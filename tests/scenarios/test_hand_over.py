"""Handing over: the posture is chosen, gone to within all limits, and the hand gives way to who takes the cup."""

import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner, run

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("hand-over")]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("given"), "hand-over")


def test_the_cup_is_brought_and_given_with_little_force(given: Outcome) -> None:
    assert given.exit_code == 0, given.metrics["expectations"]
    assert 4.0 < given.metrics["hand_force_max_n"] < 25.0
    assert given.metrics["limit_violations"] == {"position": 0, "velocity": 0}


def test_a_hand_that_does_not_give_way_fails(runner: Runner) -> None:
    outcome = runner("hand-over", "step.6.guidance.gain=0.0")
    assert outcome.exit_code == 1
    assert outcome.metrics["hand_force_max_n"] > 25.0


def test_point_to_point_reaches_its_goals_within_the_limits(runner: Runner) -> None:
    outcome = runner("point-to-point")
    assert outcome.exit_code == 0, outcome.metrics["expectations"]
    assert outcome.metrics["limit_violations"] == {"position": 0, "velocity": 0}
