"""What the slip observer is worth, in physics and over the bus; and that a tracker that errs does not throw the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from canipulator.run import LockstepRun, RunOptions
from config.load import load_scenario
from config.robot import load_robot
from drivers.tables import slip as table
from logs.metrics import Metrics
from stack.messages import TrackedPose

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("slip")]

FAST = ("feedback.rate_hz=100", "feedback.latency_s=0.01")
NOISELESS = ("feedback.noise_m=0.0", "feedback.noise_rad=0.0")
Sight = Callable[[int, TrackedPose], TrackedPose | None]
"""(number of the message, what the tracker sees) -> what it says."""


def door(
    folder: Path, *overrides: str, seconds: float = 10.0, sight: Sight | None = None
) -> tuple[LockstepRun, Metrics]:
    """The pull of `sliding-door` for a while, the hand free: rails would hide what slip does. `sight` bends what the tracker says."""
    whole = load_scenario("sliding-door", overrides)
    free = tuple(step for step in whole.step if step.kind != "grip")
    scenario = whole.model_copy(update={"door": None, "step": free})
    robot = load_robot(scenario.robot)
    options = RunOptions(duration_s=seconds, record=False, quiet=True)
    with LockstepRun(scenario, robot, options, folder) as run:
        tracker = run.sim.tracker
        if sight is not None and tracker is not None:
            deliver, number = tracker._deliver, iter(range(10**6))

            def bent(t_ns: int) -> TrackedPose | None:
                seen = deliver(t_ns)
                return None if seen is None else sight(next(number), seen)

            tracker._deliver = bent
        run.go()
    return run, run.metrics(judged=False)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[LockstepRun, Metrics]:
    """With slip, and a fast sensor without noise."""
    return door(tmp_path_factory.mktemp("good"), *FAST, *NOISELESS)


def aside(seen: TrackedPose, by: float) -> TrackedPose:
    return replace(seen, position=seen.position + np.array([by, 0.0, 0.0]))


def unviolated(metrics: Metrics) -> bool:
    return (metrics.limit_violations.position, metrics.limit_violations.velocity) == (0, 0)


def millimetres(value: float | None) -> float:
    assert value is not None
    return 1e3 * value


def test_with_a_good_sensor_slip_costs_a_tenth_of_a_millimetre(good: tuple[LockstepRun, Metrics]) -> None:
    _, metrics = good
    assert millimetres(metrics.tcp_error_steady_rms_m) <= 0.3
    assert millimetres(metrics.tcp_error_steady_p99_m) <= 1.0
    assert unviolated(metrics)


def test_without_the_observer_it_costs_several_times_as_much(good: tuple[LockstepRun, Metrics], tmp_path: Path) -> None:
    _, on = good
    _, off = door(tmp_path, *FAST, *NOISELESS, "planner.slip_observer=false")
    assert millimetres(on.tcp_error_steady_rms_m) < 0.3 < millimetres(off.tcp_error_steady_rms_m)
    assert millimetres(off.tcp_error_steady_rms_m) > 3.0 * millimetres(on.tcp_error_steady_rms_m)


def test_with_half_a_millimetre_of_noise_it_stays_below_one(tmp_path: Path) -> None:
    run, metrics = door(tmp_path, *FAST)
    assert millimetres(metrics.tcp_error_rms_m) <= 0.6
    assert unviolated(metrics)
    planner = run.planner.node.dictionary
    told = [planner.get(table.SLIP_MODEL, i) for i in range(1, 6)]
    assert told == pytest.approx([0.0005, 0.0005, 0.01, 0.5, 4.0]), "what the scenario says has arrived by SDO"


def test_five_percent_of_slip_are_learned(tmp_path: Path) -> None:
    run, metrics = door(tmp_path, "slip.sigma=0.05", seconds=16.0)
    _, fixed = door(tmp_path, "slip.sigma=0.05", "planner.slip_learning_s=0.0", seconds=16.0)
    drift = run.planner._state.drift
    assert drift.now is not None
    assert drift.now.variance > 0.02**2
    assert millimetres(metrics.tcp_error_rms_m) < 0.85 * millimetres(fixed.tcp_error_rms_m)


def test_time_on_the_bus_is_no_error(tmp_path: Path) -> None:
    """Without slip and noise nothing is left but the arm's own lag: ages hold at the SYNC, however long the frames wait."""
    run, metrics = door(tmp_path, "feedback.rate_hz=100", "feedback.latency_s=0.013", *NOISELESS, "slip.sigma=0.0")
    assert millimetres(metrics.tcp_error_steady_rms_m) <= 0.05
    ages = run.log.table["tracker/age"].values
    assert np.ptp(ages) <= 2e-4, "what a SYNC may have to wait for the frame before it"
    assert np.median(ages) == pytest.approx(0.02, abs=1e-4)


def test_the_estimate_is_on_the_bus_and_follows_the_truth(good: tuple[LockstepRun, Metrics]) -> None:
    run, _ = good
    estimate, truth = run.log.table["slip/estimate"], run.log.table["truth/wheel_slip"]
    moving = estimate.t_ns > 4_000_000_000
    for wheel in range(2):
        true = np.interp(estimate.t_ns, truth.t_ns, truth.values[:, wheel])
        assert np.corrcoef(estimate.values[moving, wheel], true[moving])[0, 1] > 0.85
    assert len(estimate) == pytest.approx(20 * 10, abs=15)


def test_outliers_do_not_throw_the_robot(tmp_path: Path) -> None:
    def sight(number: int, seen: TrackedPose) -> TrackedPose:
        return aside(seen, 0.3) if number % 97 < 3 and number > 100 else seen

    run, metrics = door(tmp_path, *FAST, sight=sight)
    assert millimetres(metrics.tcp_error_max_m) < 2.0
    assert run.planner._state.drift.rejected > 20
    assert unviolated(metrics)
    assert "does not fit" in (tmp_path / "events.log").read_text(encoding="utf-8")


def test_a_tracker_that_has_moved_takes_the_path_along(tmp_path: Path) -> None:
    """Some seconds on everything is 100 mm aside: the TCP goes on where it was, without a jump."""
    run, metrics = door(tmp_path, sight=lambda number, seen: aside(seen, 0.1) if number > 350 else seen)
    assert run.planner._state.drift.placements == 2
    truth = run.log.table["truth/pose_WE"]
    moving = truth.t_ns > 4_000_000_000
    speed = np.linalg.norm(np.diff(truth.values[moving, :3, 3], axis=0), axis=1) / 0.01
    assert speed.max() < 0.23, "commanded are 0.2 m/s"
    assert np.abs(truth.values[moving, 0, 3] - truth.values[moving, 0, 3][0]).max() < 0.005
    assert unviolated(metrics)
    assert "elsewhere for good" in (tmp_path / "events.log").read_text(encoding="utf-8")


def test_a_tracker_that_falls_silent_costs_accuracy_not_the_motion(tmp_path: Path) -> None:
    run, metrics = door(tmp_path, sight=lambda number, seen: seen if number < 300 else None)
    assert abs(run.planner._state.drift.slip).max() < 1e-3
    assert millimetres(metrics.tcp_error_max_m) < 40.0
    assert unviolated(metrics)
    truth = run.log.table["truth/pose_WE"]
    assert truth.values[-1, 1, 3] - truth.values[0, 1, 3] > 1.3


def test_unified_coordination_goes_without_it(tmp_path: Path) -> None:
    """It takes the platform to be where it was told to be; lag is no slip, and must not be taken for it."""
    errors = []
    for observer in ("true", "false"):
        unified = ('planner.coordination="unified"', f"planner.slip_observer={observer}")
        run, metrics = door(tmp_path, *FAST, *NOISELESS, *unified, seconds=5.0)
        errors.append(metrics.tcp_error_rms_m)
        assert not run.planner._state.drift.slip.any()
    assert errors[0] == errors[1]
