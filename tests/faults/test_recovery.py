"""After a fault: acknowledged over the bus, enabled again where the robot is, without a jump and without a restart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stack.strategic.mission import Stage
from tests.faults.harness import scenario_with, watch

pytestmark = pytest.mark.slow

FAULT_S, PAUSE_S = 2.0, 0.6


@pytest.mark.parametrize(
    "fault",
    [
        "over-current@2:node=24",
        "drive-reboot@2:node=23,for_s=0.2",
        "encoder-jump@2:node=23,for_s=0.3",
        "encoder-lost@2:node=11,for_s=0.2",
        "bus-off@2:node=25,for_s=0.3",
        "sync-loss@2:for_s=0.3",
        "babbling-idiot@2:for_s=0.1",
    ],
)
def test_acknowledged_and_enabled_from_where_it_is(fault: str, tmp_path: Path) -> None:
    recovery = (f"recovery.after_s={PAUSE_S}", "recovery.most=1")
    record = watch(scenario_with("sliding-door", [fault], recovery), tmp_path, 7.0)
    (stopped,) = record.said("will acknowledge it")
    (again,) = record.said("begins again")
    assert stopped.t_ns * 1e-9 < FAULT_S + 0.25
    assert again.t_ns - stopped.t_ns < 3.5e9
    assert record.run.planner.phase.name == "EXECUTING"
    assert record.run.strategic.stage is Stage.MOVING
    arm = record.run.robot.arm
    around = slice(int(again.t_ns / 1e6) - 200, int(again.t_ns / 1e6) + 20)
    assert np.ptp(record.q[around], axis=0).max() < 0.01  # rad, m: torque comes, and the arm stays where it is
    assert (np.abs(record.dq[around]) / arm.dq_max).max() < 0.1
    assert record.tcp_deceleration().max() < 10.0
    assert np.linalg.norm(record.tcp[-1] - record.tcp[-501]) > 0.05  # and it pulls on


def test_without_a_recovery_a_fault_ends_the_mission_and_torque_stays_off(tmp_path: Path) -> None:
    record = watch(scenario_with("sliding-door", ["over-current@2:node=24"]), tmp_path, 4.0)
    assert record.run.strategic.stage is Stage.FAILED
    assert record.said("acknowledged") == []
    assert record.run.planner.phase.name == "FAULT"
    assert not record.run.sim.bank.command.any()


def test_a_second_fault_beyond_the_allowed_number_ends_the_mission(tmp_path: Path) -> None:
    faults = ["over-current@2:node=24", "over-current@4:node=22"]
    record = watch(scenario_with("sliding-door", faults, [f"recovery.after_s={PAUSE_S}"]), tmp_path, 5.0)
    assert len(record.said("begins again")) == 1
    assert record.run.strategic.stage is Stage.FAILED
