"""The main job: what coordination is worth, what slip costs, and that no limit is ever broken."""

import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("door")]

IDEAL = ("slip.sigma=0.0", "feedback.rate_hz=0.0")


def unviolated(outcome: Outcome) -> bool:
    return outcome.metrics["limit_violations"] == {"position": 0, "velocity": 0}


def test_the_scenario_meets_its_own_expectations(standard_door: Outcome) -> None:
    assert standard_door.exit_code == 0
    assert all(verdict["ok"] for verdict in standard_door.metrics["expectations"])


def test_with_slip_and_feedback_the_tcp_stays_within_three_millimetres(standard_door: Outcome) -> None:
    assert standard_door.metrics["tcp_error_rms_m"] <= 0.003
    assert standard_door.metrics["max_wheel_slip"] > 0.01, "there was no slip to cope with"


def test_the_tcp_goes_all_of_the_way_and_the_platform_turns_along(standard_door: Outcome) -> None:
    assert standard_door.metrics["tcp_travel_m"] == pytest.approx(4.0, abs=0.01)
    assert standard_door.metrics["path_progress"] == pytest.approx(1.0)
    assert standard_door.metrics["platform_turn_rad"] == pytest.approx(1.5708, abs=0.15)
    assert standard_door.metrics["platform_travel_m"] > 3.0


def test_coordination_is_five_times_better_than_sending_it_all_at_once(runner: Runner) -> None:
    abc = runner("sliding-door", *IDEAL)
    unified = runner("sliding-door", *IDEAL, 'planner.coordination="unified"')
    assert unified.metrics["path_progress"] == pytest.approx(1.0), "the baseline must have done the same task"
    assert abc.metrics["tcp_error_rms_m"] <= unified.metrics["tcp_error_rms_m"] / 5
    assert unviolated(abc)
    assert unviolated(unified)
    assert (abc.exit_code, unified.exit_code) == (0, 1), "the rails have to bear what coordination spares them"


def test_the_arm_alone_does_not_reach_and_keeps_its_limits(runner: Runner) -> None:
    outcome = runner("sliding-door", 'planner.coordination="arm-only"', duration_s=12.0)
    assert outcome.metrics["path_progress"] < 0.5
    assert outcome.metrics["platform_travel_m"] < 0.02
    assert unviolated(outcome)


@pytest.mark.parametrize("case", [1, pytest.param(3, marks=pytest.mark.faults), 4])
def test_every_preference_case_keeps_the_path_and_the_limits(runner: Runner, case: int) -> None:
    outcome = runner("sliding-door", f"planner.case={case}")
    assert outcome.metrics["tcp_error_rms_m"] <= 0.003
    assert outcome.metrics["mission_finished"] == 1
    assert unviolated(outcome)


@pytest.mark.parametrize("method", ["gradient", "fsp", "qp"])
def test_every_method_keeps_the_path_and_the_limits(runner: Runner, method: str) -> None:
    outcome = runner("sliding-door", f"planner.method={method}", duration_s=8.0)
    assert outcome.metrics["method"] == method
    assert outcome.metrics["tcp_error_rms_m"] <= 0.003
    assert unviolated(outcome)


def test_without_preferences_the_arm_is_stretched(runner: Runner, standard_door: Outcome) -> None:
    outcome = runner("sliding-door", "planner.case=1")
    assert outcome.metrics["min_manipulability_arm"] < standard_door.metrics["min_manipulability_arm"]
