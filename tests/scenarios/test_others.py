"""hold-still and drive-square, and the three modes of operation that they need."""

import pytest

from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow


def test_hold_still_holds_still(runner: Runner) -> None:
    outcome = runner("hold-still")
    assert outcome.exit_code == 0
    assert outcome.metrics["tcp_error_max_m"] < 0.001
    assert outcome.metrics["platform_travel_m"] < 0.002
    assert max(map(abs, outcome.metrics["joint_travel"].values())) < 0.002


def test_drive_square_comes_back(runner: Runner) -> None:
    outcome = runner("drive-square")
    assert outcome.exit_code == 0
    assert outcome.metrics["platform_turn_rad"] == pytest.approx(6.283, abs=0.05)
    assert max(map(abs, outcome.metrics["joint_travel"].values())) < 0.002
