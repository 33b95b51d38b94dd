"""The signals of a run as one table: a row for every arm cycle, a column for every value, with names and units; as CSV or Parquet."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from drivers.frame import Frame
from drivers.objects import DeviceDef
from logs.decoder import SignalDecoder
from logs.signals import Signal, SignalTable
from logs.tape import Block, Tape
from stack.kinematics import ArmModel
from stack.kinematics.platform import platform_of
from stack.messages import Vector

_DUE = (
    "joints/position/target",
    "joints/effort/offset",
    "wheels/velocity/target",
    "platform/velocity/commanded",
    "reference/pose",
    "reference/segment",
)
HELD_PERIODS = 3.0
"""A value stands for so many of its own periods; after that its cells are empty."""
_XYZ = ("x", "y", "z")


def decode_frames(
    frames: Iterable[Frame], devices: Iterable[DeviceDef], arm: ArmModel, *, sync_period_ns: int, bitrate: int
) -> SignalTable:
    """All signals that the frames of a whole run tell; those that need the truth of the physics are not among them."""
    platform = platform_of(arm)
    decoder = SignalDecoder(
        devices,
        sync_period_ns=sync_period_ns,
        bitrate=bitrate,
        wheel_radius=platform.wheel_radius,
        track=platform.track,
    )
    blocks: list[Block] = []
    tape = Tape(blocks.append)
    for frame in frames:
        tape.on_frame(frame)
    tape.cut()
    return SignalTable(decoder.decode(block, last=block is blocks[-1]) for block in blocks)


def columns_of(table: SignalTable, joints: Sequence[str]) -> tuple[list[str], list[Vector]]:
    """Names with units, and values (cycles,) of all columns; the first are `time_s` and `arm_cycle`. NaN: nothing (any more) known.

    Set points and references stand in the row of the SYNC at which they shall be reached. What comes at other times than SYNC is
    held from the first row that is not earlier, for `HELD_PERIODS` of its own period. Raises KeyError for a run without SYNC.
    """
    sync = table["sync"]
    jitter_ns = int(np.median(np.diff(sync.t_ns))) // 4 if len(sync) > 1 else 0
    names, values = ["time_s", "arm_cycle"], [sync.t_s, sync.values]
    drives = ("wheel_left", "wheel_right", *joints)
    for name, (parts, unit) in _layouts(joints, drives).items():
        signal = table.get(name)
        if signal is not None:
            # times of set points are counted from their SYNC, which may have waited for a frame that was on the wire
            grid = held(signal, sync.t_ns, jitter_ns if name in _DUE else 0)
            for i, part in enumerate(parts):
                names.append("/".join(filter(None, (name, part))) + (f" [{unit(part)}]" if unit(part) else ""))
                values.append(grid[:, i])
    return names, values


def held(signal: Signal, t_ns: np.ndarray, early_ns: int = 0) -> np.ndarray:
    """(n, k): of each column the last value at or before each of the times (n,), NaN before the first and where the last is too old.

    Values up to `early_ns` later count as of that time.
    """
    grid = np.full((len(t_ns), signal.values.shape[1]), np.nan)
    for column in range(grid.shape[1]):
        there = ~np.isnan(signal.values[:, column])
        times, values = signal.t_ns[there], signal.values[there, column]
        if len(times):
            row = np.searchsorted(times, t_ns + early_ns, "right") - 1
            period_ns = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
            known = (row >= 0) & (t_ns - times[np.maximum(row, 0)] <= HELD_PERIODS * period_ns)
            grid[known, column] = values[row[known]]
    return grid


def write_csv(path: Path, names: Sequence[str], values: Sequence[Vector]) -> None:
    """One line per row, empty cells for NaN, twelve digits. Raises OSError."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in np.column_stack(values).tolist():
            writer.writerow(["" if value != value else f"{value:.12g}" for value in row])


def write_parquet(path: Path, names: Sequence[str], values: Sequence[Vector]) -> None:
    """Float columns, null for NaN, compressed. Raises OSError."""
    arrays = [pa.array(column, pa.float64(), from_pandas=True) for column in values]
    pq.write_table(pa.table(dict(zip(names, arrays, strict=True))), path, compression="zstd")


class _Unit:
    """The unit of a column: one for all, or another for the lift."""

    def __init__(self, usual: str = "", lift: str | None = None) -> None:
        self._usual, self._lift = usual, lift

    def __call__(self, part: str) -> str:
        return self._lift if self._lift is not None and part == "tower_lift" else self._usual


def _layouts(joints: Sequence[str], drives: Sequence[str]) -> dict[str, tuple[Sequence[str], _Unit]]:
    """Columns and units of each signal, see the table in `logs.signals`."""
    wheels, pose = ("left", "right"), (*_XYZ, "rx", "ry", "rz")
    angle, speed, effort = _Unit("rad", "m"), _Unit("rad/s", "m/s"), _Unit("N·m", "N")
    return {
        "joints/position/actual": (joints, angle),
        "joints/position/target": (joints, angle),
        "joints/velocity/actual": (joints, speed),
        "joints/effort": (joints, effort),
        "joints/effort/offset": (joints, effort),
        "wheels/position/actual": (wheels, _Unit("rad")),
        "wheels/velocity/actual": (wheels, _Unit("rad/s")),
        "wheels/velocity/target": (wheels, _Unit("rad/s")),
        "wheels/effort": (wheels, _Unit("N·m")),
        "platform/velocity/commanded": (("v [m/s]", "omega [rad/s]"), _Unit()),
        "platform/velocity/encoder": (("v [m/s]", "omega [rad/s]"), _Unit()),
        "reference/pose": ([f"{name} [{'m' if name in _XYZ else 'rad'}]" for name in pose], _Unit()),
        "reference/segment": (("",), _Unit()),
        "planner/state": (("phase", "status", "restrictions", "path_scale"), _Unit()),
        "slip/estimate": (("left", "right", "measured", "rejected"), _Unit()),
        "mission": (("mode", "step"), _Unit()),
        "twist/linear": (_XYZ, _Unit("m/s")),
        "twist/angular": (_XYZ, _Unit("rad/s")),
        "wrench/force": (_XYZ, _Unit("N")),
        "wrench/torque": (_XYZ, _Unit("N·m")),
        "tracker/position": (_XYZ, _Unit("m")),
        "tracker/rotation_vector": (_XYZ, _Unit("rad")),
        "tracker/age": (("",), _Unit("s")),
        "drives/statusword": (drives, _Unit()),
        "bus/load": (("",), _Unit()),
        "bus/frames": (("",), _Unit()),
    }
