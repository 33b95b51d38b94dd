"""What another planner would have sent, beside what was sent: set points of every drive, their differences, and a figure of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from drivers.objects import DeviceDef, PdoKind
from logs.frame_batch import PdoLayout
from stack.messages import Vector

_TARGET = 1
"""Place of the target in a drive's RPDO1: controlword, target, torque offset."""


@dataclass(frozen=True, slots=True, eq=False)
class SetPoints:
    """Set points of one drive, t_s (n,), as they were sent and as the other planner would have sent them, in `unit`."""

    name: str
    unit: str
    t_s: Vector
    recorded: Vector
    other: Vector

    @property
    def difference(self) -> Vector:
        """(n,) other minus recorded."""
        return self.other - self.recorded

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.difference**2))) if len(self.difference) else 0.0

    @property
    def largest(self) -> float:
        """Largest absolute difference."""
        return float(np.abs(self.difference).max(initial=0.0))


def set_points(device: DeviceDef, t_ns: Sequence[int], recorded: Sequence[bytes], other: Sequence[bytes]) -> SetPoints:
    """Those of one drive, from the bytes of its RPDO1; frames of another length than the RPDO's are left out."""
    pdo = next(pdo for pdo in device.pdos if pdo.kind is PdoKind.RPDO and pdo.number == 1)
    layout = PdoLayout.of(device, pdo)
    rows = [i for i, (a, b) in enumerate(zip(recorded, other, strict=True)) if len(a) == len(b) == layout.length]
    values = [
        layout.values(
            np.frombuffer(b"".join(data[i].ljust(8, b"\0") for i in rows), np.uint8).reshape(-1, 8), [_TARGET]
        )[:, 0]
        for data in (recorded, other)
    ]
    t_s = 1e-9 * np.array([t_ns[i] for i in rows], np.float64)
    return SetPoints(device.name, device.object(*pdo.mapping[_TARGET]).unit, t_s, values[0], values[1])


def difference_table(drives: Sequence[SetPoints], method: str) -> Table:
    """Root mean square and largest difference of every drive's set points."""
    table = Table(
        box=None, padding=(0, 2), title=f"set points of {method} minus those of the run", title_justify="left"
    )
    table.add_column("drive")
    table.add_column("rms", justify="right")
    table.add_column("largest", justify="right")
    table.add_column("unit")
    for drive in drives:
        table.add_row(drive.name, f"{drive.rms:.6f}", f"{drive.largest:.6f}", drive.unit)
    return table


def save_open_loop(drives: Sequence[SetPoints], path: Path, recorded: str, other: str) -> None:
    """Writes a PNG with one panel per drive, both over each other. Raises OSError when it cannot be written."""
    rows = (len(drives) + 1) // 2
    figure = Figure(figsize=(9.0, 1.5 * rows + 0.8), dpi=130, layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, squeeze=False).T.ravel()
    for axes, drive in zip(panels, drives, strict=False):
        axes.plot(drive.t_s, drive.recorded, color="0.35", lw=1.8, label=f"{recorded} (the run)")
        axes.plot(drive.t_s, drive.other, color="tab:red", lw=0.9, label=f"{other} (open loop)")
        axes.set_ylabel(f"{drive.name}\n[{drive.unit}]", fontsize=7)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.25)
    for axes in panels[len(drives) :]:
        axes.set_visible(False)
    for axes in figure.axes[-2:]:
        axes.set_xlabel("t [s]", fontsize=8)
    figure.axes[0].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
