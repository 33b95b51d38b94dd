"""Manipulability maps as figures: the wrist centre's over its radius with the TL and φ that reach it, the hand's as slices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stack.kinematics.manipulability_map import PoseMap, RadiusMap

_DPI = 150


def draw_radius_map(wrist: RadiusMap, path: Path) -> None:
    """Manipulability, height of D above the shoulder and elbow angle over the radius of D."""
    figure = Figure(figsize=(7.0, 7.5), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    series = (
        (wrist.manipulability, "manipulability of the\nwrist centre (3×5)"),
        (wrist.height, "height of D\nabove the shoulder (m)"),
        (np.degrees(wrist.phi), "elbow angle φ (°)"),
    )
    for axes, (values, label) in zip(rows, series, strict=True):
        axes.plot(wrist.radius, values, ".-", color="#1f4e79", markersize=3, linewidth=1.2)
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    best = int(np.nanargmax(wrist.manipulability))
    rows[0].axvline(wrist.radius[best], color="#c0504d", linewidth=0.8)
    rows[0].set_title(f"Best posture for each radius: {wrist.manipulability[best]:.4f} at {wrist.radius[best]:.3f} m")
    rows[2].set_xlabel("radius of the wrist centre D from the tower (m)")
    figure.savefig(path, dpi=_DPI)


def draw_pose_map(hand: PoseMap, path: Path) -> None:
    """One panel per elevation of the tool's axis: radius against azimuth, best manipulability as colour."""
    count = hand.elevation.size - 1
    columns = 4
    figure = Figure(figsize=(13.0, 2.9 * ((count + columns - 1) // columns)), layout="constrained")
    panels = figure.subplots((count + columns - 1) // columns, columns, sharex=True, sharey=True, squeeze=False).ravel()
    top = float(np.nanmax(hand.manipulability))
    mesh = None
    for i, axes in enumerate(panels):
        if i >= count:
            axes.set_visible(False)
            continue
        mesh = axes.pcolormesh(
            np.degrees(hand.azimuth), hand.radius, hand.manipulability[:, i, :], vmin=0.0, vmax=top, cmap="viridis"
        )
        low, high = np.degrees(hand.elevation[i : i + 2])
        axes.set_title(f"tool axis {low:+.0f}° to {high:+.0f}° up", fontsize=9)
    for axes in panels[::columns]:
        axes.set_ylabel("radius of the TCP (m)")
    for axes in panels[max(count - columns, 0) : count]:
        axes.set_xlabel("azimuth against the radius (°)")
    if mesh is not None:
        figure.colorbar(mesh, ax=list(panels), label="largest manipulability (6×8)", shrink=0.7)
    figure.savefig(path, dpi=_DPI)
