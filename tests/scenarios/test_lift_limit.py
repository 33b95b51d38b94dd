"""A vertical line that is longer than the lift: the rule base lets the rest of the arm do it."""

import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner, run

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("lift")]


@pytest.fixture(scope="module")
def lift_limit(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("lift"), "lift-limit")


def verdicts(outcome: Outcome) -> list[tuple[str, bool]]:
    return [(verdict["name"], verdict["ok"]) for verdict in outcome.metrics["expectations"]]


def test_the_lift_stops_inside_its_limit_and_the_hand_goes_on(lift_limit: Outcome) -> None:
    metrics = lift_limit.metrics
    assert lift_limit.exit_code == 0
    assert all(ok for _, ok in verdicts(lift_limit))
    assert 0.24 < metrics["joint_travel"]["tower_lift"] < 0.25
    assert metrics["tcp_travel_m"] == pytest.approx(0.4, abs=1e-3)
    assert metrics["tcp_error_max_m"] < 0.002
    assert metrics["path_progress"] == pytest.approx(1.0), "the path had to wait"
    assert metrics["limit_violations"] == {"position": 0, "velocity": 0}


def test_its_acceleration_is_continuous(lift_limit: Outcome) -> None:
    assert lift_limit.metrics["joint_acceleration_step_max"]["tower_lift"] < 0.1


def test_without_the_rule_base_the_lift_runs_into_its_limit_and_the_hand_leaves_its_line(runner: Runner) -> None:
    outcome = runner("lift-limit", "planner.joint_limit_rules=false")
    assert outcome.exit_code == 1
    failed = {name for name, ok in verdicts(outcome) if not ok}
    assert {"tcp_error_max_m", "tcp_travel_m", "joint_acceleration_step_max.tower_lift"} <= failed
    assert outcome.metrics["tcp_error_max_m"] > 0.02
    assert outcome.metrics["joint_travel"]["tower_lift"] < 0.2501, "nothing held the lift"
    assert outcome.metrics["faults"] == ()


@pytest.mark.parametrize("method", ["fsp", "gradient", "qp"])
def test_every_method_does_it(runner: Runner, method: str) -> None:
    outcome = runner("lift-limit", f"planner.method={method}")
    assert outcome.exit_code == 0, verdicts(outcome)


def test_the_same_seed_gives_the_same_bytes(runner: Runner, lift_limit: Outcome) -> None:
    again = runner("lift-limit")
    assert (again.directory / "bus.log").read_bytes() == (lift_limit.directory / "bus.log").read_bytes()
