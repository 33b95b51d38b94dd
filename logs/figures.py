"""Figures of a run for a report: paths from above, error, manipulability, joints against their limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from logs.palette import JOINTS, Color
from logs.signals import SignalTable
from stack.kinematics import ArmModel

_SIZE_IN = (7.0, 4.2)
_DPI = 130


def save_figures(table: SignalTable, arm: ArmModel, folder: Path, title: str = "") -> list[Path]:
    """Writes `path.png`, `error.png`, `manipulability.png`, `joints.png`; what was not measured has no figure.

    Makes `folder`. `title` (scenario, method, preset) is put on every figure. Raises OSError when a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawings: tuple[tuple[str, str, Callable[[Axes], None]], ...] = (
        ("path", "truth/pose_WE", lambda axes: _path(axes, table)),
        ("error", "tcp/error", lambda axes: _error(axes, table)),
        ("manipulability", "manipulability", lambda axes: _manipulability(axes, table)),
        ("joints", "truth/q", lambda axes: _joints(axes, table, arm)),
    )
    written = []
    for name, needed, draw in drawings:
        if needed in table:
            figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
            axes = figure.add_subplot()
            draw(axes)
            axes.set_title(title, fontsize=9)
            axes.grid(alpha=0.25)
            axes.legend(fontsize=7, ncols=2)
            path = folder / f"{name}.png"
            figure.savefig(path)
            written.append(path)
    return written


def _path(axes: Axes, table: SignalTable) -> None:
    tcp, base = table["truth/pose_WE"].values, table["truth/pose_WB"].values
    axes.plot(base[:, 0, 3], base[:, 1, 3], color="0.55", label="platform")
    axes.plot(tcp[:, 0, 3], tcp[:, 1, 3], color=_hex(JOINTS[0]), label="TCP")
    commanded = table.get("tcp/commanded")
    if commanded is not None:
        axes.plot(commanded.values[:, 0], commanded.values[:, 1], "--", color="black", lw=0.9, label="TCP commanded")
    for pose in base[:: max(1, len(base) // 12)]:
        axes.plot(*(pose[:2, 3:4] + pose[:2, :1] * [[0.0, 0.15]]), color="0.4", lw=1.0)  # where it looks
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def _error(axes: Axes, table: SignalTable) -> None:
    error = table["tcp/error"]
    axes.plot(error.t_s, 1e3 * error.values[:, 0], color=_hex(JOINTS[0]), label="distance")
    axes.plot(error.t_s, 1e3 * error.values[:, 1], color=_hex(JOINTS[1]), lw=0.9, label="across the path")
    axes.set_xlabel("t [s]")
    axes.set_ylabel("TCP error [mm]")


def _manipulability(axes: Axes, table: SignalTable) -> None:
    dexterity = table["manipulability"]
    for column, (name, style) in enumerate(
        (("arm", "-"), ("robot", "-"), ("arm, wrist centre", "--"), ("robot, wrist centre", "--"))
    ):
        if not np.isnan(dexterity.values[:, column]).all():
            axes.plot(dexterity.t_s, dexterity.values[:, column], style, color=_hex(JOINTS[column % 2]), label=name)
    axes.set_xlabel("t [s]")
    axes.set_ylabel("manipulability")
    axes.set_ylim(bottom=0.0)


def _joints(axes: Axes, table: SignalTable, arm: ArmModel) -> None:
    q = table["truth/q"]
    share = (q.values - 0.5 * (arm.q_max + arm.q_min)) / (0.5 * (arm.q_max - arm.q_min))
    pad = 1.0 - 2.0 * float(np.mean(arm.padding / (arm.q_max - arm.q_min)))
    for side in (-1.0, 1.0):
        axes.axhline(side, color="firebrick", lw=1.0)
        axes.axhspan(side * pad, side, color="goldenrod", alpha=0.15, lw=0)
    for i, name in enumerate(arm.joint_names):
        axes.plot(q.t_s, share[:, i], color=_hex(JOINTS[i % len(JOINTS)]), lw=1.2, label=name)
    axes.set_xlabel("t [s]")
    axes.set_ylabel("share of range, limits at ±1")


def _hex(color: Color) -> tuple[float, float, float]:
    """A colour of the palette, darkened for white paper."""
    r, g, b = (0.8 * part / 255 for part in color)
    return (r, g, b)
