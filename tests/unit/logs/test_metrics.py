"""metrics.json against numbers worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from logs.expectations import Expectation
from logs.metrics import RunFacts, evaluate, limit_violations
from logs.signals import DecodedBlock, Signal, SignalTable
from logs.summary import summary
from stack.kinematics import ArmModel

ARM = ArmModel.load("moma8")
FACTS = RunFacts("sliding-door", 3, "qp", "unified", sim_time_s=10.0, wall_time_s=4.0, frames=21_000, frames_lost=2)


def _table(**signals: np.ndarray) -> SignalTable:
    block = {
        name.replace("__", "/"): Signal(np.arange(len(values), dtype=np.int64), np.asarray(values, float))
        for name, values in signals.items()
    }
    return SignalTable([DecodedBlock(block, counts={"bad_checksums": 4})])


def test_statistics_of_the_error() -> None:
    table = _table(tcp__error=[[0.003, 0.001, 0.01], [0.004, 0.002, 0.03], [0.0, 0.0, 0.02]])
    metrics = evaluate(table, ARM, FACTS)
    assert metrics.tcp_error_rms_m == pytest.approx(np.sqrt(25e-6 / 3))
    assert metrics.tcp_error_max_m == 0.004
    assert metrics.tcp_error_final_m == 0.0
    assert metrics.tcp_lateral_error_max_m == 0.002
    assert metrics.tcp_orientation_error_max_rad == 0.03
    assert metrics.real_time_factor == 2.5
    assert (metrics.frames, metrics.frames_lost, metrics.bad_checksums) == (21_000, 2, 4)


def test_cycles_load_and_manipulability() -> None:
    facts = replace(FACTS, arm_cycle_us=np.arange(1.0, 102.0), platform_ratio=5)
    table = _table(
        sync=np.arange(12.0),
        bus__load=[[0.25], [0.35]],
        manipulability=[[0.2, 1.0, 0.1, 0.5], [0.1, 1.2, 0.15, np.nan]],
    )
    metrics = evaluate(table, ARM, facts)
    assert (metrics.arm_cycles, metrics.platform_cycles) == (12, 3)
    assert (metrics.arm_cycle_us.p50, metrics.arm_cycle_us.p99, metrics.arm_cycle_us.max) == (51.0, 100.0, 101.0)
    assert (metrics.bus_load_mean, metrics.bus_load_peak) == (pytest.approx(0.3), 0.35)
    assert (metrics.min_manipulability_arm, metrics.min_manipulability_robot) == (0.1, 1.0)


def test_limit_violations_count_samples_beyond_the_limits() -> None:
    q, dq = np.tile(ARM.home, (4, 1)), np.zeros((4, 8))
    q[1, 1] = ARM.q_max[1] + 1e-5
    q[2, 2] = ARM.q_min[2] - 1e-5
    q[3, 3] = ARM.q_max[3] + 1e-7  # below the resolution of the wire
    dq[0, :2] = -1.01 * ARM.dq_max[:2]
    dq[1, 4] = ARM.dq_max[4]
    found = limit_violations(_table(truth__q=q, truth__dq=dq), ARM)
    assert (found.position, found.velocity) == (2, 2)


def test_travel_of_joints_and_platform() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    for i, angle in enumerate(np.linspace(0.0, 5.0, 5)):  # further than half a turn, in steps below one
        poses[i, :2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    poses[-1, :3, 3] = [3.0, 4.0, 0.0]
    q = np.vstack([ARM.home, ARM.home + 0.1])
    metrics = evaluate(_table(truth__pose_WB=poses, truth__q=q), ARM, FACTS)
    assert metrics.platform_travel_m == pytest.approx(5.0)
    assert metrics.platform_turn_rad == pytest.approx(5.0)
    assert metrics.joint_travel["tower_lift"] == pytest.approx(0.1)


def test_an_empty_run_is_strict_json_with_nulls() -> None:
    values = json.loads(evaluate(SignalTable(), ARM, FACTS).to_json())
    assert values["tcp_error_rms_m"] is None
    assert values["bus_load_peak"] is None
    assert values["limit_violations"] == {"position": 0, "velocity": 0}
    assert values["expectations"] == []


def test_the_keys_of_the_contract_are_there() -> None:
    keys = (
        "scenario seed method coordination sim_time_s wall_time_s real_time_factor physics_only_real_time_factor arm_cycles "
        "platform_cycles arm_cycle_us tcp_error_rms_m tcp_error_p99_m tcp_error_max_m tcp_orientation_error_max_rad "
        "bus_load_mean bus_load_peak frames frames_lost limit_violations min_manipulability_arm min_manipulability_robot "
        "faults expectations"
    )
    assert set(keys.split()) <= set(json.loads(evaluate(SignalTable(), ARM, FACTS).to_json()))


def test_expectations_are_judged_dotted_and_with_the_scenarios_own_numbers() -> None:
    facts = replace(FACTS, extra={"door_angle_rad": 1.2})
    table = _table(tcp__error=[[0.003, 0.001, 0.01]])
    metrics = evaluate(table, ARM, facts).judged(
        [
            Expectation("tcp_error_max_m", "<=", 0.003),
            Expectation("limit_violations.position", "==", 0),
            Expectation("door_angle_rad", ">=", 1.3),
            Expectation("bus_load_peak", "<", 1.0),
        ]
    )
    assert [verdict.ok for verdict in metrics.expectations] == [True, True, False, False]
    assert not metrics.ok
    assert json.loads(metrics.to_json())["expectations"][2] == {
        "name": "door_angle_rad", "value": 1.2, "op": ">=", "bound": 1.3, "ok": False,
    }  # fmt: skip


def test_an_unknown_metric_names_the_nearest() -> None:
    with pytest.raises(ValueError, match=r"'tcp_eror_max_m'.*did you mean 'tcp_error_max_m'"):
        evaluate(SignalTable(), ARM, FACTS).judged([Expectation("tcp_eror_max_m", "<=", 1.0)])


def test_a_metric_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="'qp' is not a number"):
        evaluate(SignalTable(), ARM, FACTS).judged([Expectation("method", "==", 1.0)])


def test_an_operator_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match=r"must be one of <=, >=, <, >, =="):
        Expectation("frames", "~", 1.0)  # type: ignore[arg-type]


def test_a_whole_run(table: SignalTable) -> None:
    metrics = evaluate(table, ARM, FACTS)
    assert metrics.tcp_error_max_m == pytest.approx(0.004 * 2.47, abs=5e-5)
    assert metrics.limit_violations.position == 0
    assert metrics.min_manipulability_arm is not None
    assert 0.05 < metrics.min_manipulability_arm < metrics.min_manipulability_robot  # type: ignore[operator]


def test_the_summary_shows_numbers_verdicts_and_faults() -> None:
    facts = replace(FACTS, faults=("shoulder: following error",), recorder_fault="disk full")
    metrics = evaluate(_table(tcp__error=[[0.003, 0.001, 0.01]]), ARM, facts)
    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        console.print(summary(metrics.judged([Expectation("frames_lost", "==", 0)])))
        text = console.export_text()
    assert "3.00  mm rms" in text
    assert "no" in text
    assert "frames_lost" in text
    assert "shoulder: following error" in text
    assert "disk full" in text
