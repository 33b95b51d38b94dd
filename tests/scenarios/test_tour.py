"""Two cups from table to table to table: on the way, without a stop, and why it takes a platform that the arm makes up for."""

import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner, run

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("tour")]


@pytest.fixture(scope="module")
def tour(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("tour"), "pick-and-place-tour")


def test_the_cups_stand_where_they_belong_and_the_platform_never_stopped(tour: Outcome) -> None:
    assert tour.exit_code == 0, tour.metrics["expectations"]
    assert tour.metrics["object_goal_error_max_m"] < 0.01
    assert tour.metrics["platform_standing_s"] == 0
    assert tour.metrics["collisions"] == 0


def test_the_hand_stands_still_over_the_table_while_the_platform_drives(tour: Outcome) -> None:
    assert tour.metrics["tcp_error_max_m"] < 0.003
    assert tour.metrics["platform_distance_forward_m"] > 1.3


def test_with_the_arm_alone_it_fails(runner: Runner) -> None:
    outcome = runner("pick-and-place-tour", 'planner.coordination="arm-only"')
    assert outcome.exit_code == 1
    assert outcome.metrics["object_goal_error_max_m"] > 0.1
