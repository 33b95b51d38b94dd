"""Signals as a table with a row per arm cycle: what is held, for how long, and what the files say."""

import csv
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from drivers.frame import Frame
from logs.signal_table_file import columns_of, decode_frames, held, write_csv, write_parquet
from logs.signals import Signal
from stack.kinematics import ArmModel
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Motion, play


def test_a_value_is_held_for_three_of_its_periods() -> None:
    signal = Signal(np.array([20, 40, 60]), np.array([[1.0, 5.0], [2.0, np.nan], [3.0, 7.0]]))
    grid = held(signal, np.array([10, 20, 35, 45, 119, 121]))
    np.testing.assert_array_equal(grid[:, 0], [np.nan, 1.0, 1.0, 2.0, 3.0, np.nan])
    np.testing.assert_array_equal(grid[:4, 1], [np.nan, 5.0, 5.0, 5.0])


def test_a_set_point_that_is_due_a_little_later_counts() -> None:
    signal = Signal(np.array([100, 203]), np.array([[1.0], [2.0]]))
    np.testing.assert_array_equal(held(signal, np.array([100, 200]))[:, 0], [1.0, 1.0])
    np.testing.assert_array_equal(held(signal, np.array([100, 200]), early_ns=25)[:, 0], [1.0, 2.0])


@pytest.fixture(scope="module")
def columns(run: Motion) -> dict[str, np.ndarray]:
    frames: list[Frame] = []
    play(run, frames.append, lambda truth: None)
    arm = ArmModel.load("moma8")
    table = decode_frames(frames, DEVICES.values(), arm, sync_period_ns=PERIOD_NS, bitrate=1_000_000)
    names, values = columns_of(table, arm.joint_names)
    assert len(names) == len(set(names))
    return dict(zip(names, values, strict=True))


def test_joint_positions_are_those_of_the_truth(columns: dict[str, np.ndarray], run: Motion) -> None:
    lift = np.array([truth.q[1] for truth in run.truths])
    decoded = columns["joints/position/actual/tower_lift [m]"]
    assert len(decoded) == len(run.truths)
    known = ~np.isnan(decoded)
    assert known.mean() > 0.98
    np.testing.assert_allclose(decoded[known], lift[known], atol=1e-6)
    assert "joints/position/actual/elbow [rad]" in columns


def test_files_hold_the_same(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    write_csv(tmp_path / "t.csv", list(columns), list(columns.values()))
    write_parquet(tmp_path / "t.parquet", list(columns), list(columns.values()))
    with (tmp_path / "t.csv").open(newline="") as file:
        head, *lines = csv.reader(file)
    parquet = pq.read_table(tmp_path / "t.parquet")
    assert head == parquet.column_names == list(columns)
    assert len(lines) == parquet.num_rows == len(columns["time_s"])
    for name in ("time_s", "wrench/force/x [N]", "mission/step"):
        from_csv = np.array([float(line[head.index(name)] or "nan") for line in lines])
        from_parquet = parquet.column(name).to_numpy()
        np.testing.assert_allclose(from_csv, columns[name], rtol=1e-11)
        np.testing.assert_array_equal(from_parquet, columns[name])
