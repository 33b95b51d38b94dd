"""Figures of one or more runs for print: paths from above, error, manipulability, joints against their limits, platform velocity.

Each is written as vector PDF (fonts embedded) and as PNG. Several runs lie over each other, the joints of each have a figure of their own.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from logs.palette import JOINTS, Color
from logs.recording_reader import Recording
from logs.signals import Signal
from stack.kinematics import ArmModel

_WIDE_IN, _TALL_IN = (6.3, 3.0), (6.3, 4.6)
_DPI = 200
_STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "pdf.fonttype": 42,  # text stays text
}
_PNG_PDF = ("pdf", "png")


@dataclass(frozen=True, slots=True)
class FigureRun:
    """A run to be drawn; `label` is what the legend calls it when there are several."""

    label: str
    recording: Recording

    def signal(self, name: str) -> Signal | None:
        """A plotted entity of the recording."""
        return self.recording.series.get(name)

    def path(self, name: str) -> Signal | None:
        """Points of a path; None where there is none."""
        strips = self.recording.paths.get(f"world/path/{name}")
        positions = strips.positions() if strips is not None else None
        return positions if positions is not None and len(positions) else None


def save_figures(runs: Sequence[FigureRun], arm: ArmModel, folder: Path) -> list[Path]:
    """Writes `path`, `error`, `manipulability`, `platform` and `joints`, each as .pdf and .png; what was not measured has no figure.

    Of several runs there is `joints-1`, `joints-2`, … Makes `folder`. Raises OSError when a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    with mpl.rc_context(_STYLE):
        for name, (draw, size) in _TOGETHER.items():
            figure = Figure(figsize=size, layout="constrained")
            if draw(figure, runs):
                written += _save(figure, folder / name)
        for number, run in enumerate(runs, start=1):
            figure = Figure(figsize=_TALL_IN, layout="constrained")
            if _joints(figure, run, arm, title=len(runs) > 1):
                written += _save(figure, folder / (f"joints-{number}" if len(runs) > 1 else "joints"))
    return written


def figure_png(name: str, runs: Sequence[FigureRun], arm: ArmModel) -> bytes | None:
    """One of the figures of `save_figures` as a PNG file's bytes; None where nothing of it was measured.

    Raises KeyError for a name that is none of `path`, `error`, `manipulability`, `platform`.
    """
    draw, size = _TOGETHER[name]
    stored = io.BytesIO()
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size, layout="constrained")
        if not draw(figure, runs):
            return None
        figure.savefig(stored, format="png", dpi=_DPI)
    return stored.getvalue()


def _save(figure: Figure, stem: Path) -> list[Path]:
    paths = [stem.parent / f"{stem.name}.{kind}" for kind in _PNG_PDF]
    for path in paths:
        metadata = {"CreationDate": None} if path.suffix == ".pdf" else {}  # same run, same file
        figure.savefig(path, dpi=_DPI, metadata=metadata)
    return paths


def _path(figure: Figure, runs: Sequence[FigureRun]) -> bool:
    """TCP and platform from above, with the platform's heading and the arm's reach at some instants."""
    axes = figure.add_subplot()
    for i, run in enumerate(runs):
        tcp, base, commanded = run.path("true"), run.signal("tf/platform"), run.path("commanded")
        if base is not None:
            _trace(axes, base.values, _colour(i), f"{_of(run, runs)}platform", lw=0.9, ls="-.")
            _postures(axes, base, tcp, i)
        if tcp is not None:
            _trace(axes, tcp.values, _colour(i), f"{_of(run, runs)}TCP", lw=1.5)
        if commanded is not None:
            _trace(axes, commanded.values, "black", "TCP commanded" if i == 0 else None, lw=0.7, ls="--")
    axes.set_aspect("equal", adjustable="datalim")
    return _finish(axes, "x [m]", "y [m]")


def _postures(axes: Axes, base: Signal, tcp: Signal | None, i: int) -> None:
    """A few times: where the platform looks, and how far the arm reaches from it."""
    for row in np.linspace(0, len(base) - 1, 9).astype(int):
        x, y, *_, sine, cosine = base.values[row]
        heading = 2.0 * float(np.arctan2(sine, cosine))
        marker = (3, 0, np.degrees(heading) - 90.0)
        axes.plot([x], [y], marker=marker, color=_colour(i), ms=6.0, ls="")
        if tcp is not None:
            reach = [np.interp(base.t_ns[row], tcp.t_ns, tcp.values[:, column]) for column in (0, 1)]
            axes.plot([x, reach[0]], [y, reach[1]], color="0.6", lw=0.5, zorder=0)


def _error(figure: Figure, runs: Sequence[FigureRun]) -> bool:
    axes = figure.add_subplot()
    for i, run in enumerate(runs):
        error = run.signal("tcp/error_mm")
        if error is not None:
            _curve(axes, error, 0, _colour(i), f"{_of(run, runs)}distance")
            _curve(axes, error, 1, _colour(i), f"{_of(run, runs)}across the path", lw=0.7, ls=":")
    axes.set_ylim(bottom=0.0)
    return _finish(axes, "t [s]", "TCP error [mm]")


def _manipulability(figure: Figure, runs: Sequence[FigureRun]) -> bool:
    above, below = figure.subplots(2, 1, sharex=True)
    for axes, name in ((above, "arm"), (below, "robot")):
        for i, run in enumerate(runs):
            signal = run.signal(f"manipulability/{name}_SI")
            if signal is not None:
                _curve(axes, signal, 0, _colour(i), f"{_of(run, runs)}TCP")
                if signal.values.shape[1] > 1 and not np.isnan(signal.values[:, 1]).all():
                    _curve(axes, signal, 1, _colour(i), f"{_of(run, runs)}wrist centre", lw=0.7, ls="--")
        axes.set_ylim(bottom=0.0)
    drawn = [_finish(above, "", "manipulability, arm"), _finish(below, "t [s]", "manipulability, robot")]
    return any(drawn)


def _platform(figure: Figure, runs: Sequence[FigureRun]) -> bool:
    """Commanded velocity thin and dark, the true one in colour."""
    above, below = figure.subplots(2, 1, sharex=True)
    for axes, name in ((above, "v_m_per_s"), (below, "omega_rad_per_s")):
        for i, run in enumerate(runs):
            true, commanded = run.signal(f"platform/{name}/true"), run.signal(f"platform/{name}/commanded")
            if true is not None:
                _curve(axes, true, 0, _colour(i), f"{_of(run, runs)}actual")
            if commanded is not None:
                dark = "black" if len(runs) == 1 else _colour(i)
                _curve(axes, commanded, 0, dark, f"{_of(run, runs)}commanded", lw=0.7, ls="--")
    drawn = [_finish(above, "", "v [m/s]"), _finish(below, "t [s]", "ω [rad/s]")]
    return any(drawn)


def _joints(figure: Figure, run: FigureRun, arm: ArmModel, *, title: bool) -> bool:
    """Every joint in its own unit, with its limits and the padding before them."""
    q = run.signal("joints/position_rad_or_m/actual")
    if q is None:
        return False
    panels = figure.subplots((arm.n + 1) // 2, 2, sharex=True, squeeze=False).T.ravel()
    for i, (axes, row) in enumerate(zip(panels, arm.description.joints, strict=False)):
        low, high, pad = arm.q_min[i], arm.q_max[i], arm.padding[i]
        axes.axhline(low, color="firebrick", lw=0.8)
        axes.axhline(high, color="firebrick", lw=0.8)
        axes.axhspan(low, low + pad, color="goldenrod", alpha=0.2, lw=0)
        axes.axhspan(high - pad, high, color="goldenrod", alpha=0.2, lw=0)
        axes.plot(q.t_s, q.values[:, i], color=_colour(0))
        axes.set_ylabel(f"{row.name.replace('_', ' ')}\n[{'rad' if row.revolute else 'm'}]")
        axes.grid(True)
    for axes in panels[arm.n :]:
        axes.set_visible(False)
    for axes in (panels[(arm.n + 1) // 2 - 1], panels[arm.n - 1]):
        axes.set_xlabel("t [s]")
    if title:
        figure.suptitle(run.label, fontsize=8)
    return True


def _trace(axes: Axes, points: np.ndarray, color: object, label: str | None, *, lw: float, ls: str = "-") -> None:
    axes.plot(points[:, 0], points[:, 1], color=color, label=label, lw=lw, ls=ls)


def _curve(
    axes: Axes, signal: Signal, column: int, color: object, label: str, *, lw: float = 1.1, ls: str = "-"
) -> None:
    axes.plot(signal.t_s, signal.values[:, column], color=color, label=label, lw=lw, ls=ls)


def _finish(axes: Axes, x: str, y: str) -> bool:
    """Labels, grid and legend; False when nothing was drawn."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(True)
    if axes.lines:
        axes.legend(ncols=2)
    return bool(axes.lines)


def _of(run: FigureRun, runs: Sequence[FigureRun]) -> str:
    return f"{run.label}: " if len(runs) > 1 else ""


def _colour(i: int) -> tuple[float, float, float]:
    """Of the palette, darkened for white paper."""
    color: Color = JOINTS[i % len(JOINTS)]
    r, g, b = (0.75 * part / 255 for part in color)
    return (r, g, b)


_TOGETHER: dict[str, tuple[Callable[[Figure, Sequence[FigureRun]], bool], tuple[float, float]]] = {
    "path": (_path, _TALL_IN),
    "error": (_error, _WIDE_IN),
    "manipulability": (_manipulability, _TALL_IN),
    "platform": (_platform, _TALL_IN),
}
