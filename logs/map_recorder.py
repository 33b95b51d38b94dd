"""A map of two joints as a 2-D view of a recording: what stands still as statics, the robot's places on it over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from logs import palette
from logs.configuration_map import ConfigurationMap, Points, Way
from logs.signals import Ints

Send = Callable[[str, Ints, Any], None]
_MARGIN = 0.09
_TICKS = 5


def log_map(stream: rr.RecordingStream, origin: str, plane: ConfigurationMap) -> None:
    """Everything of the map that does not move. The vertical axis points up: Rerun's points down, so y is logged with its sign changed."""
    (left, right), (low, high) = plane.span
    frame = np.array([[left, low], [right, low], [right, high], [left, high], [left, low]])
    _lines(stream, f"{origin}/frame", [frame], palette.NEUTRAL, 0.6)
    limits = [np.array([[at, low], [at, high]]) for at in plane.limits]
    _lines(stream, f"{origin}/limits", limits, palette.LIMIT, 1.6)
    for i, locus in enumerate(plane.loci):
        _lines(stream, f"{origin}/loci/{i}", list(locus.lines), locus.color, 0.8)
    for i, way in enumerate(plane.ways):
        _lines(stream, f"{origin}/ways/{i}", list(plane.pieces(way)), way.color, 1.8)
    for i, marks in enumerate(plane.marks):
        inside = (marks.points >= [left, low]).all(axis=1) & (marks.points <= [right, high]).all(axis=1)
        labels = [marks.name.split(" ")[0]] * int(inside.sum())
        dots = rr.Points2D(_up(marks.points[inside]), colors=[marks.color], radii=[-5.5], labels=labels)
        stream.log(f"{origin}/marks/{i}", dots, static=True)
    _ticks(stream, f"{origin}/ticks", plane)


def send_places(plane: ConfigurationMap, origin: str, times: Ints, send: Send) -> None:
    """Where each way is at `times` (k,) in ns; it stays at its end."""
    for i, way in enumerate(plane.ways):
        places = _up(plane.wrapped(_places(way, times)))
        columns = rr.Points2D.columns(
            positions=places, colors=[way.color] * len(places), radii=[-8.0] * len(places), labels=[way.name] * len(places)
        )  # fmt: skip
        send(f"{origin}/places/{i}", times, columns)


def map_view(plane: ConfigurationMap, origin: str) -> rrb.Spatial2DView:
    """The view of one map."""
    (left, right), (low, high) = plane.span
    wide, tall = _MARGIN * (right - left), _MARGIN * (high - low)
    bounds = rrb.VisualBounds2D(x_range=[left - wide, right + wide], y_range=[-high - tall, -low + tall])
    return rrb.Spatial2DView(
        name=plane.title,
        origin=f"/{origin}",
        contents=["+ $origin/**"],
        background=(24, 27, 33),
        visual_bounds=bounds,
    )


def _places(way: Way, times: Ints) -> Points:
    rows = np.clip(np.searchsorted(np.round(1e9 * way.t_s), times, "right") - 1, 0, len(way.points) - 1)
    return way.points[rows]


def _up(points: Points) -> Points:
    return points * [1.0, -1.0]


def _lines(stream: rr.RecordingStream, path: str, lines: Sequence[Points], color: palette.Color, radius: float) -> None:
    if lines:
        strips = rr.LineStrips2D([_up(line) for line in lines], colors=[color], radii=[-radius])
        stream.log(path, strips, static=True)


def _ticks(stream: rr.RecordingStream, path: str, plane: ConfigurationMap) -> None:
    """Numbers along both axes, their names at the ends."""
    (left, right), (low, high) = plane.span
    x, y = np.linspace(left, right, _TICKS), np.linspace(low, high, _TICKS)
    points = np.vstack(
        [
            np.column_stack([x, np.full(_TICKS, low - 0.5 * _MARGIN * (high - low))]),
            np.column_stack([np.full(_TICKS, left - 0.5 * _MARGIN * (right - left)), y]),
        ]
    )
    texts = [f"{value:.0f}" for value in (*x, *y)]
    texts[_TICKS - 1] = f"{plane.axes[0]} {texts[_TICKS - 1]}"
    texts[-1] = f"{plane.axes[1]} {texts[-1]}"
    stream.log(path, rr.Points2D(_up(points), colors=[palette.NEUTRAL], radii=[-0.5], labels=texts), static=True)
