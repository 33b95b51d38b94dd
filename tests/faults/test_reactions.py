"""How fast the defined reactions are (docs/faults.md), and that a bus that loses a tenth of its frames is no reason to fail."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from drivers.cia402.states import State
from tests.faults.harness import Record, scenario_with, watch

pytestmark = pytest.mark.slow

CYCLE_S, FAULT_S = 0.01, 2.0


def run_with(fault: str, tmp_path: Path, *overrides: str, duration_s: float = 3.0) -> Record:
    return watch(scenario_with("sliding-door", [fault], overrides), tmp_path, duration_s)


def cycles_until_brakes(record: Record) -> float:
    """SYNC periods from the fault until every joint that moved has lost a tenth of its speed."""
    before = record.dq[record.t < FAULT_S][-20:].mean(axis=0)
    moving = np.abs(before) > 0.02
    assert moving.sum() >= 3
    after = record.dq[record.after(FAULT_S)][:, moving]
    slower = np.all(np.abs(after) < 0.9 * np.abs(before[moving]), axis=1)
    return float(np.argmax(slower)) * 1e-3 / CYCLE_S


@pytest.mark.parametrize("fault", ["planner-killed@2", "frame-loss@2:node=2,probability=1", "bus-off@2:node=2"])
def test_without_the_planner_every_drive_acts_within_three_sync_periods(fault: str, tmp_path: Path) -> None:
    record = run_with(fault, tmp_path)
    last_s = max(frame.t_ns for frame in record.frames if frame.can_id == 0x080) * 1e-9
    for node in (11, 12, *range(21, 29)):
        told_s, _ = record.emergencies(node, FAULT_S)[0]
        assert told_s - last_s < 3 * CYCLE_S + 0.003
    before = np.abs(record.set_velocity[record.t <= last_s + 0.005][-1])
    braked = np.abs(record.set_velocity[record.after(last_s + 3 * CYCLE_S)][0])
    moved = before > 0.005
    assert moved.sum() >= 8
    assert np.all(braked[moved] < 0.95 * before[moved])  # every one of them, by its own set point
    assert cycles_until_brakes(record) < 4.0  # the body follows: a tenth of the speed takes its time
    states = {drive.state for drive in record.run.sim.drives}
    assert states == {State.SWITCH_ON_DISABLED}


@pytest.mark.parametrize("fault", ["over-current@2:node=24", "encoder-jump@2:node=11,amount=-8.9"])
def test_a_drive_that_fails_stops_the_nine_others_with_the_next_cycle(fault: str, tmp_path: Path) -> None:
    """Also where its position cannot be, and is left out: what its statusword says counts."""
    record = run_with(fault, tmp_path, duration_s=2.2)
    stops = [
        frame.t_ns * 1e-9
        for frame in record.frames
        if 0x200 < frame.can_id <= 0x200 + 28 and frame.data[0] == 0x02 and frame.t_ns > FAULT_S * 1e9
    ]
    assert len(stops) >= 9
    assert stops[8] - FAULT_S < 1.5 * CYCLE_S


def test_a_silent_drive_is_given_up_after_eleven_cycles(tmp_path: Path) -> None:
    record = run_with("bus-off@2:node=25", tmp_path)
    (late,) = record.said("feedback late")
    assert 10 * CYCLE_S < late.t_ns * 1e-9 - FAULT_S < 12.5 * CYCLE_S


def test_a_silent_strategic_node_stops_the_robot_within_its_time_out(tmp_path: Path) -> None:
    record = run_with("strategic-killed@2", tmp_path)
    (silent,) = record.said("has fallen silent: stops")
    assert silent.t_ns * 1e-9 - FAULT_S < 0.15 + 2 * CYCLE_S


@pytest.mark.parametrize(
    "seed", [1, pytest.param(2, marks=pytest.mark.faults), pytest.param(3, marks=pytest.mark.faults)]
)
def test_a_tenth_of_all_frames_may_get_lost(seed: int, tmp_path: Path) -> None:
    scenario = scenario_with("sliding-door", ["frame-loss@0:probability=0.1"], [f"seed={seed}"])
    outcome = run_scenario(scenario, RunOptions(out=tmp_path, record=False, quiet=True))
    missed = [check for check in outcome.metrics["expectations"] if not check["ok"]]
    assert missed == []
    assert outcome.exit_code == 0
    assert outcome.metrics["frames_dropped_by_faults"] > 0.09 * outcome.metrics["frames"]
