"""The platform bound to a circle while the hand traces two edges at a right angle."""

import struct
from pathlib import Path

import numpy as np
import pytest

from canipulator.run import LockstepRun, Outcome, RunOptions
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario
from tests.scenarios.conftest import Runner, run

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("workbench")]


def verdicts(outcome: Outcome) -> dict[str, bool]:
    return {verdict["name"]: verdict["ok"] for verdict in outcome.metrics["expectations"]}


@pytest.fixture(scope="module")
def workbench(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("workbench"), "workbench")


def test_hand_and_platform_keep_to_their_paths(workbench: Outcome) -> None:
    metrics = workbench.metrics
    assert workbench.exit_code == 0
    assert all(verdicts(workbench).values())
    assert metrics["max_wheel_slip"] > 0.01, "there was no slip to cope with"
    assert metrics["tcp_error_max_m"] <= 0.002
    assert metrics["platform_path_error_max_m"] <= 0.005
    assert metrics["tcp_travel_m"] == pytest.approx(0.5 * 2**0.5, abs=0.002), "not the diagonal of the two edges"


def test_it_goes_forwards_and_backwards_and_never_turns_round(workbench: Outcome) -> None:
    metrics = workbench.metrics
    forward, backward = metrics["platform_distance_forward_m"], metrics["platform_distance_backward_m"]
    assert forward > 0.3
    assert backward > 0.1
    assert metrics["platform_path_turn_max_rad"] < 0.05
    assert metrics["platform_turn_rad"] == pytest.approx((forward - backward) / 0.6, abs=0.02), (
        "heading is not the path's"
    )


def test_left_to_itself_the_platform_leaves_the_circle(runner: Runner) -> None:
    outcome = runner("workbench", "platform_path.follow=false")
    assert outcome.exit_code == 1
    assert not verdicts(outcome)["platform_path_error_max_m"]
    assert not verdicts(outcome)["platform_path_turn_max_rad"]
    assert outcome.metrics["platform_path_error_max_m"] > 0.05


@pytest.mark.parametrize(
    "method", [*(pytest.param(name, marks=pytest.mark.faults) for name in ("fsp", "gradient")), "qp"]
)
def test_every_method_keeps_what_is_expected(runner: Runner, method: str) -> None:
    outcome = runner("workbench", f"planner.method={method}")
    assert outcome.exit_code == 0, verdicts(outcome)


def test_the_same_seed_gives_the_same_bytes(runner: Runner, workbench: Outcome) -> None:
    again = runner("workbench", duration_s=4.0)
    frames = (again.directory / "bus.log").read_bytes().splitlines()
    assert len(frames) > 10_000
    assert frames[:-100] == (workbench.directory / "bus.log").read_bytes().splitlines()[: len(frames) - 100]


SPLINE = """
name = "spline"
title = "there and back on a spline"
duration_s = 30.0

[platform_path]
kind = "spline"
waypoints_m = [[0.4, 0.05], [0.8, 0.2], [1.2, 0.2]]

[preferences]
heights = [0.5, 0.1, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0]
platform_feed_forward = 1.0

[[step]]
name = "hold"
kind = "wait"
duration_s = 0.5

[[step]]
name = "there"
kind = "line"
direction = [1.0, 0.0, 0.0]
length_m = 1.0
speed_m_s = 0.2

[[step]]
name = "back"
kind = "line"
direction = [-1.0, 0.0, 0.0]
length_m = 0.9
speed_m_s = 0.2

[[expect]]
metric = "platform_path_error_max_m"
max = 0.005
"""


def test_a_spline_is_kept_as_well_in_both_directions(runner: Runner, tmp_path: Path) -> None:
    file = tmp_path / "spline.toml"
    file.write_text(SPLINE)
    outcome = runner(str(file))
    assert outcome.exit_code == 0
    assert outcome.metrics["platform_distance_forward_m"] > 0.7
    assert outcome.metrics["platform_distance_backward_m"] > 0.6
    assert outcome.metrics["tcp_path_error_max_m"] < 0.004
    assert outcome.metrics["limit_violations"] == {"position": 0, "velocity": 0}


def test_where_the_platform_is_on_its_path_can_be_read_in_mid_motion(tmp_path: Path) -> None:
    scenario = load_scenario("workbench")
    assert isinstance(scenario, Scenario)
    with LockstepRun(scenario, load_robot("moma8"), RunOptions(record=False, quiet=True), tmp_path) as going:
        answers: list[bytes] = []
        port = going.bus.attach("stranger", [0x582], lambda frame: answers.append(frame.data))
        going.power_on()
        going.clock.run_until(6_000_000_000)
        start, here = going.first.pose_WB, going.sim.world.truth(0).pose_WB
        answers.clear()  # of what the mission wrote
        for subindex in (1, 2, 3):
            port.send(0x602, bytes.fromhex(f"40 19 20 0{subindex} 00 00 00 00"))
            going.clock.run_until(going.clock.now_ns() + 10_000_000)
        s, aside, turn = (struct.unpack("<f", answer[4:])[0] for answer in answers)
    driven = 0.6 * np.arctan2(here[1, 0], here[0, 0]) - 0.6 * np.arctan2(start[1, 0], start[0, 0])
    assert 0.1 < driven < s < driven + 0.03, "seen ahead: where it will be when the wheels have obeyed"
    assert abs(aside) < 0.002
    assert abs(turn) < 0.02
