"""A hinged door opened from a wrong guess, in physics and over the bus: angle, radius, forces; and what happens without identification."""

from pathlib import Path

import numpy as np
import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner, run

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("hinged")]
RADIUS, HEADING = 0.7, 2.268928
GUESSES = [
    (0.7, 0.3, 0.24, 0.17),
    (1.3, -0.3, -0.12, 0.22),
    (1.3, 0.3, 0.19, 0.18),
    (0.7, -0.3, -0.12, -0.13),
    (1.3, 0.18, 0.07, 0.29),
    (0.7, -0.18, 0.12, -0.18),
    (0.83, -0.2, 0.07, -0.27),
    (0.72, 0.0, 0.0, 0.25),
    (1.08, 0.0, 0.0, -0.15),
    (0.85, 0.0, 0.0, 0.0),
]
"""Radius over the true one; direction to the hinge beside the true one (rad: 0.3 of the radius); tilts of the axis about x and y (rad)."""


def guess(radius: float, beside: float, tilt_x: float, tilt_y: float) -> tuple[str, ...]:
    heading = HEADING + beside
    axis = np.array([tilt_x, tilt_y, -1.0]) / np.linalg.norm([tilt_x, tilt_y, -1.0])
    return (
        f"step.2.pull.radius_m={RADIUS * radius:.4f}",
        f"step.2.pull.hinge_direction=[{np.cos(heading):.5f}, {np.sin(heading):.5f}, 0.0]",
        f"step.2.pull.axis=[{axis[0]:.5f}, {axis[1]:.5f}, {axis[2]:.5f}]",
    )


def failed(outcome: Outcome) -> set[str]:
    return {verdict["name"] for verdict in outcome.metrics["expectations"] if not verdict["ok"]}


@pytest.fixture(scope="module")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("door"), "hinged-door")


def test_all_expectations_hold(standard: Outcome) -> None:
    assert standard.exit_code == 0, failed(standard)
    assert standard.metrics["faults"] == ()
    assert standard.metrics["door_axis_tilt_found_rad"] < 0.01


def test_the_platform_went_back_on_its_line_meanwhile(standard: Outcome) -> None:
    assert standard.metrics["platform_distance_backward_m"] > 0.3
    assert standard.metrics["platform_path_error_max_m"] < 0.002


def test_the_log_says_what_was_found(standard: Outcome) -> None:
    log = (standard.directory / "events.log").read_text()
    assert f"radius {standard.metrics['door_radius_found_m']:.4f} m" in log


LONG = [pytest.param(wrong, marks=pytest.mark.faults) for wrong in GUESSES[1:]]
"""Seven of the ten only in `make faults`: a quarter of a minute each."""


@pytest.mark.parametrize("wrong", [*GUESSES[:1], *LONG])
def test_ten_wrong_guesses(runner: Runner, wrong: tuple[float, float, float, float]) -> None:
    outcome = runner("hinged-door", *guess(*wrong))
    assert outcome.exit_code == 0, failed(outcome)
    assert np.degrees(outcome.metrics["door_angle_rad"]) == pytest.approx(80.0, abs=1.0)
    assert outcome.metrics["door_radius_found_m"] == pytest.approx(RADIUS, rel=0.02)
    assert outcome.metrics["handle_force_across_max_n"] <= 15.0


def test_without_identification_the_scenario_fails(runner: Runner) -> None:
    """The hand gives way to the door's own circle all the same, but the angle that is believed is not the door's."""
    outcome = runner("hinged-door", "step.2.pull.identification=false")
    assert outcome.exit_code == 1
    assert {"door_angle_rad", "door_radius_found_m"} <= failed(outcome)


def test_a_door_that_nobody_can_open_ends_the_mission_with_a_reason(runner: Runner) -> None:
    outcome = runner("hinged-door", "door.friction=60.0")
    assert outcome.exit_code == 1
    assert "mission_finished" in failed(outcome)
    assert "the door is stuck at" in (outcome.directory / "events.log").read_text()


def test_a_heavy_door_with_a_closer_opens_too(runner: Runner) -> None:
    outcome = runner("hinged-door", "door.mass_kg=30.0", "door.closer_preload=4.0", "door.closer_stiffness=2.0")
    assert outcome.metrics["mission_finished"] == 1.0
    assert outcome.metrics["door_radius_found_m"] == pytest.approx(RADIUS, rel=0.02)
    assert "door open by 79.9 degrees" in (outcome.directory / "events.log").read_text()
    assert 70.0 < np.degrees(outcome.metrics["door_angle_rad"]) < 80.5  # once let go of it begins to close


def test_the_same_seed_gives_the_same_frames(tmp_path: Path) -> None:
    logs = [
        (run(tmp_path / name, "hinged-door", f"seed={seed}", duration_s=5.0).directory / "bus.log").read_bytes()
        for name, seed in (("a", 3), ("b", 3), ("c", 4))
    ]
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]
