"""What is around the robot in metrics and recordings: forces on a handle, the hand of a person, bodies that move."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from logs.around import FORCE_SCALE, Around, Body, Part, around_metrics, around_values
from logs.recorder import RerunRecorder, RunInfo
from logs.signals import DecodedBlock, Signal, SignalTable
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory

N = 200
T_NS = np.arange(N, dtype=np.int64) * 10_000_000


def signals() -> dict[str, Signal]:
    """A door that opens from 0 to 1 rad, held in the second half; a hand that pulls with up to 20 N."""
    door = np.column_stack([np.linspace(0.0, 1.0, N), np.full(N, 0.5)])
    handle = np.zeros((N, 3))
    handle[N // 2 :] = 10.0, 3.0, -4.0
    handle[-1] = -12.0, 6.0, 8.0
    hand = np.zeros((N, 6))
    hand[50:100, 3] = 12.0
    hand[50:100, 4] = -16.0
    poses = np.tile(np.eye(4), (N, 2, 1, 1))
    poses[:, 1, 0, 3] = np.linspace(0.0, 2.0, N)
    return {
        "truth/door": Signal(T_NS, door),
        "truth/handle_force": Signal(T_NS, handle),
        "truth/hand": Signal(T_NS, hand),
        "truth/body_poses": Signal(T_NS, poses),
        "truth/pose_WE": Signal(T_NS, np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (N, 1, 1))),
        "truth/pose_WB": Signal(T_NS, np.tile(np.eye(4), (N, 1, 1))),
        "truth/contact_wrench": Signal(T_NS, np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.0], (N, 1))),
    }


def test_metrics_are_those_of_the_handle_while_held_and_of_the_hand_while_it_pulls() -> None:
    table = SignalTable([DecodedBlock(signals())])
    metrics = around_metrics(table, "hinged")
    assert metrics["door_angle_rad"] == 1.0
    assert metrics["door_way_m"] is None
    assert metrics["handle_force_along_max_n"] == 12.0
    assert metrics["handle_force_across_max_n"] == 10.0
    assert metrics["handle_force_across_p99_n"] == pytest.approx(np.percentile([5.0] * 99 + [10.0], 99))
    assert metrics["hand_force_max_n"] == metrics["hand_force_p99_n"] == 20.0
    assert around_metrics(table, "sliding")["door_way_m"] == 1.0


def test_without_door_and_person_the_metrics_are_there_and_empty() -> None:
    assert set(around_metrics(SignalTable(), None).values()) == {None}


def test_curves_are_in_degrees_or_millimetres() -> None:
    for kind, end in (("hinged", 180.0 / np.pi), ("sliding", 1000.0)):
        values = dict(around_values(signals(), Around(door=kind)))  # type: ignore[arg-type]
        assert values["door/opening_deg" if kind == "hinged" else "door/opening_mm"].values[-1] == pytest.approx(end)
        assert values["hand/force_N"].values.max() == pytest.approx(20.0)


def test_the_recording_shows_bodies_at_their_poses_and_forces_as_arrows(tmp_path: Path) -> None:
    part = Part((0.1, 0.1, 0.2), (0.0, 0.0, 0.0), (1, 2, 3))
    tin = Part((0.1, 0.1, 0.2), (0.0, 0.0, 0.0), (1, 2, 3), "cylinder")
    still = np.eye(4)
    still[0, 3] = 3.0
    bodies = (Body("table", (part,), still), Body("door", (part,), np.eye(4), 0), Body("red cup", (tin,), np.eye(4), 1))
    around = Around(bodies, "hinged", person=True)
    path = tmp_path / "run.rrd"
    recorder = RerunRecorder(
        path,
        ArmModel.load("moma8"),
        robot_directory("moma8") / "robot.urdf",
        RunInfo("test", around=around),
        sync_period_ns=10_000_000,
    )
    recorder.write(DecodedBlock(signals()))
    recorder.close()
    rows: Counter[str] = Counter()
    last: dict[str, np.ndarray] = {}
    for chunk in RrdReader(str(path)).stream():
        name = str(chunk.entity_path).lstrip("/")
        rows[name] += chunk.num_rows
        batch = chunk.to_record_batch()
        for column, key in (("Transform3D:translation", "at"), ("Arrows3D:vectors", "arrow")):
            if column in batch.schema.names and batch.num_rows:
                last[f"{name} {key}"] = np.array(batch.column(column)[-1].as_py()[-1])
    for name in ("0_table/box", "1_door/box", "2_red_cup/cylinder"):
        assert rows[f"world/around/{name}"] == 1
    assert last["world/around/0_table at"] == pytest.approx([3.0, 0.0, 0.0])
    assert last["world/around/2_red_cup at"][0] == pytest.approx(2.0, abs=0.05)
    assert rows["world/around/2_red_cup"] == pytest.approx(2.0 * 25, abs=3)
    assert last["world/force/gripper arrow"] == pytest.approx(FORCE_SCALE * np.array([1.0, -2.0, -3.0]))
    for path_of_curve in (
        "door/opening_deg",
        "door/handle_force_N",
        "hand/force_N",
        "world/around/hand",
        "world/force/hand",
    ):
        assert rows[path_of_curve] > 10
