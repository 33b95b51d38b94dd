"""Two cups from table to table to table: on the way, without a stop."""

import pytest

from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow


def test_the_cups_stand_where_they_belong_and_the_platform_never_stopped(runner: Runner) -> None:
    tour = runner("pick-and-place-tour")
    assert tour.exit_code == 0, tour.metrics["expectations"]
    assert tour.metrics["object_goal_error_max_m"] < 0.01
    assert tour.metrics["platform_standing_s"] == 0
    assert tour.metrics["collisions"] == 0
    assert tour.metrics["platform_distance_forward_m"] > 1.3
    # over a table the path waits for the damper, and the planner's patience is 10 mm
    assert tour.metrics["tcp_error_max_m"] < 0.01
