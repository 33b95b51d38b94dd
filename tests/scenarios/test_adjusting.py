"""A new preferred height of the lift with nothing commanded: the null space moves, the hand does not."""

import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner, run

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("lift")]


@pytest.fixture(scope="module")
def adjusting(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("adjusting"), "adjusting-movement")


def verdicts(outcome: Outcome) -> dict[str, bool]:
    return {verdict["name"]: verdict["ok"] for verdict in outcome.metrics["expectations"]}


def test_the_lift_moves_and_the_hand_stays(adjusting: Outcome) -> None:
    metrics = adjusting.metrics
    assert adjusting.exit_code == 0
    assert metrics["joint_travel"]["tower_lift"] >= 0.09
    assert metrics["tcp_error_max_m"] <= 0.0005
    assert metrics["tcp_travel_m"] <= 0.0005
    assert metrics["platform_travel_m"] <= 0.0005
    assert metrics["limit_violations"] == {"position": 0, "velocity": 0}


def test_it_begins_and_ends_without_a_jerk(adjusting: Outcome) -> None:
    assert adjusting.metrics["joint_acceleration_step_max"]["tower_lift"] < 0.1


def test_without_null_space_motion_nothing_moves(runner: Runner) -> None:
    outcome = runner("adjusting-movement", "planner.null_space_motion=false")
    assert outcome.exit_code == 1
    assert not verdicts(outcome)["joint_travel.tower_lift"]
    assert outcome.metrics["joint_travel"]["tower_lift"] < 0.001


@pytest.mark.parametrize("method", ["fsp", "qp"])
def test_every_method_that_knows_weights_does_it(runner: Runner, method: str) -> None:
    outcome = runner("adjusting-movement", f"planner.method={method}")
    assert outcome.exit_code == 0, verdicts(outcome)


def test_the_same_seed_gives_the_same_bytes(runner: Runner, adjusting: Outcome) -> None:
    again = runner("adjusting-movement")
    assert (again.directory / "bus.log").read_bytes() == (adjusting.directory / "bus.log").read_bytes()
