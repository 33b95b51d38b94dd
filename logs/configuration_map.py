"""A map of two joints: limits, optimum loci, singular points by kind, and the ways of several methods across it; as a PNG."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from contourpy import contour_generator
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from logs.palette import Color
from stack.messages import Vector

Points = NDArray[np.float64]
_SIZE_IN, _DPI = (11.0, 8.0), 130
_PAPER = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Locus:
    """Lines that belong together, each (k, 2)."""

    name: str
    color: Color
    lines: tuple[Points, ...]
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Points (k, 2) of one kind. `symbol` as Matplotlib has it."""

    name: str
    color: Color
    symbol: str
    points: Points


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A way over the map: t_s (k,), points (k, 2). It may leave the map on one side and come back on the other (see `wrapped`)."""

    name: str
    color: Color
    t_s: Vector
    points: Points
    dashed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class ConfigurationMap:
    """All of it. `span`: ((x from, to), (y from, to)); `limits`: where the horizontal joint has its limits; `ground`: x (a,), y (b,) and
    the measure (b, a) there, drawn as shades; `wraps`: whether the vertical axis is a full turn."""

    name: str
    title: str
    axes: tuple[str, str]
    span: tuple[tuple[float, float], tuple[float, float]]
    limits: tuple[float, ...]
    loci: tuple[Locus, ...]
    marks: tuple[Marks, ...]
    ways: tuple[Way, ...]
    ground: tuple[Vector, Vector, Points]
    wraps: bool = True

    def wrapped(self, points: Points) -> Points:
        """Points (k, 2) moved into the map by whole turns of the vertical axis."""
        if not self.wraps:
            return points
        low, high = self.span[1]
        moved = points.copy()
        moved[:, 1] = low + np.mod(points[:, 1] - low, high - low)
        return moved

    def pieces(self, way: Way) -> Iterator[Points]:
        """The way in pieces that do not jump from one edge to the other."""
        points = self.wrapped(way.points)
        jumps = np.flatnonzero(np.abs(np.diff(points[:, 1])) > 0.5 * (self.span[1][1] - self.span[1][0])) + 1
        for piece in np.split(points, jumps):
            if len(piece) > 1:
                yield piece


def zero_lines(x: Vector, y: Vector, values: Points) -> tuple[Points, ...]:
    """Lines (k, 2) along which values (b, a) at x (a,), y (b,) are zero."""
    return tuple(np.asarray(line) for line in contour_generator(x, y, values).lines(0.0))


def save_map(plane: ConfigurationMap, path: Path) -> None:
    """Draws it into a PNG file. Raises OSError when the file cannot be written."""
    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    shades = axes.contourf(*plane.ground, levels=24, cmap="Greys", alpha=0.55)
    figure.colorbar(shades, ax=axes, label="H", pad=0.01, aspect=40)
    _limits(axes, plane)
    for locus in plane.loci:
        for i, line in enumerate(locus.lines):
            style, label = "--" if locus.dashed else "-", locus.name if i == 0 else None
            axes.plot(line[:, 0], line[:, 1], style, color=_paper(locus.color), lw=1.3, label=label)
    for way in plane.ways:
        _way(axes, plane, way)
    for marks in plane.marks:
        axes.plot(
            marks.points[:, 0], marks.points[:, 1], marks.symbol, color=_paper(marks.color), ms=9.0, mec="black",
            mew=0.9, label=marks.name, zorder=6,
        )  # fmt: skip
    axes.set_xlim(*plane.span[0])
    axes.set_ylim(*plane.span[1])
    axes.set_xlabel(plane.axes[0])
    axes.set_ylabel(plane.axes[1])
    axes.set_title(plane.title, fontsize=10)
    axes.grid(alpha=0.25)
    figure.legend(loc="outside lower center", fontsize=8, ncols=5)
    figure.savefig(path)


def _limits(axes: Axes, plane: ConfigurationMap) -> None:
    """Limits as lines, what lies beyond them shaded."""
    (left, right), _ = plane.span
    if plane.limits:
        axes.axvspan(left, min(plane.limits), color="firebrick", alpha=0.10, lw=0)
        axes.axvspan(max(plane.limits), right, color="firebrick", alpha=0.10, lw=0)
    for i, at in enumerate(plane.limits):
        axes.axvline(at, color="firebrick", lw=1.4, label="limit" if i == 0 else None)


def _way(axes: Axes, plane: ConfigurationMap, way: Way) -> None:
    color = _paper(way.color)
    for i, piece in enumerate(plane.pieces(way)):
        style, label = ":" if way.dashed else "-", way.name if i == 0 else None
        axes.plot(piece[:, 0], piece[:, 1], style, color=color, lw=2.4, label=label, zorder=5)
    ends = plane.wrapped(way.points[[0, -1]])
    axes.plot(*ends[0], marker="o", ms=6.0, color=color, mec="white", zorder=7)
    axes.plot(*ends[1], marker="X", ms=7.0, color=color, mec="white", zorder=7)
    middle = len(way.points) // 4
    if middle + 1 < len(way.points):
        tail, head = plane.wrapped(way.points[middle : middle + 2])
        axes.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2.0}, zorder=6)


def _paper(color: Color) -> tuple[float, float, float]:
    """A colour of the palette, darkened for white paper."""
    r, g, b = (_PAPER * part / 255 for part in color)
    return (r, g, b)
