"""A scenario fails its own expectations once what it shows is switched off.

Here those that no other file shows without it; hinged-door, sliding-door, workbench, lift-limit, adjusting-movement, force-guided,
hand-over, semi-algorithmic and the wrist singularities (test_kinematic.py) have it among their own tests.
"""

import pytest

from canipulator.run import Outcome
from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow

FAR_OFF = "preferences.preferred=[0.6, 0.65, -1.3, 0.9, -0.9, 0.7, 1.1, 0.4]"
EVERY_JOINT = "preferences.heights=[1.0, 0.1, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]"
OFF = {
    # A straight way begins at rest: the goal that is announced on the way cannot be taken.
    "point-to-point": (('step.1.objective="straight"',), {"mission_finished"}),
    # With slip the wheels cannot know where the platform is.
    "drive-square": (("slip.sigma=0.01",), {"platform_return_error_m"}),
    # Not held, but coordinated with a posture elsewhere: hand and platform move.
    "hold-still": (('step.0.mode="coordinated"', FAR_OFF, EVERY_JOINT), {"tcp_error_max_m", "platform_return_error_m"}),
    # The second table is out of the arm's reach. With the platform the mission takes 32.3 s.
    "pick-and-place-tour": (
        ('planner.coordination="arm-only"', "duration_s=36.0"),
        {"mission_finished", "object_goal_error_max_m", "platform_distance_forward_m", "tcp_error_rms_m"},
    ),
}


def failed(outcome: Outcome) -> set[str]:
    return {verdict["name"] for verdict in outcome.metrics["expectations"] if not verdict["ok"]}


@pytest.mark.parametrize("name", OFF)
def test_without_what_it_shows_the_scenario_fails(runner: Runner, name: str) -> None:
    overrides, misses = OFF[name]
    outcome = runner(name, *overrides)
    assert outcome.exit_code == 1
    assert misses <= failed(outcome)
