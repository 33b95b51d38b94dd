"""What an engineer looks at after Park's test case: the plane of joints 2 and 3, measures, margins, multipliers, states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from logs import palette
from logs.configuration_map import ConfigurationMap, Locus, Marks, Way, zero_lines
from logs.signals import StateChange
from logs.traces import Array, Curve, Plot
from stack.messages import Matrix, Vector
from stack.planner.kuhn_tucker import Track
from stack.planner.monitor import Kind, Margins
from stack.planner.singular_points import PlaneSearch, SingularPoint
from stack.planner.velocity_qp import VelocityTrack

MARGINS_TAB = "Singularities"
NEAR = 0.02
"""Margin from which on the lanes name a kind."""
_GRID = 241
_KINDS: dict[Kind, tuple[str, palette.Color, str]] = {
    Kind.KINEMATIC: ("KS", palette.LIMIT, "s"),
    Kind.ALGORITHMIC: ("AS", palette.COMMANDED, "D"),
    Kind.SEMI: ("SS", palette.MEASURED, "^"),
    Kind.SEMI_ALGORITHMIC: ("SAS", palette.VIOLET, "o"),
}
_NAMES = ("tracker, maximise", "tracker, minimise", "velocity QP, maximise", "velocity QP, minimise")
_COLORS = (palette.JOINTS[0], palette.JOINTS[2], palette.JOINTS[3], palette.JOINTS[6])


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """The four runs: the tracker's maximum and minimum, the velocity QP's."""

    best: Track
    least: Track
    climbing: VelocityTrack
    falling: VelocityTrack

    def named(self) -> Iterator[tuple[str, Vector, Matrix]]:
        """(name, t, q) of each."""
        ways: tuple[Track | VelocityTrack, ...] = (self.best, self.least, self.climbing, self.falling)
        for name, way in zip(_NAMES, ways, strict=True):
            yield name, way.t, way.q


def plane_of(
    ways: Ways,
    points: Sequence[SingularPoint],
    search: PlaneSearch,
    bounds: Mapping[int, tuple[float, float]],
    title: str,
) -> ConfigurationMap:
    """The picture: θ2 across, θ3 up, in degrees."""
    ((low, high),) = bounds.values()
    theta2 = np.radians(np.linspace(20.0, 300.0, _GRID))
    theta3 = np.radians(np.linspace(-180.0, 180.0, _GRID))
    measure, optimality, curvature = search.optimality_on(theta2, theta3)
    x, y = np.degrees(theta2), np.degrees(theta3)
    return ConfigurationMap(
        name="configuration",
        title=title,
        axes=("θ2 [°]", "θ3 [°]"),
        span=((20.0, 300.0), (-180.0, 180.0)),
        limits=(float(np.degrees(low)), float(np.degrees(high))),
        loci=tuple(_loci(x, y, optimality, curvature)),
        marks=tuple(_marks(points)),
        ways=tuple(
            Way(name, color, t_s, np.degrees(q[:, 1:]), dashed=name.startswith("velocity"))
            for (name, t_s, q), color in zip(ways.named(), _COLORS, strict=True)
        ),
        ground=(x, y, measure),
    )


def _loci(x: Vector, y: Vector, optimality: Array, curvature: Array) -> Iterator[Locus]:
    """Where H is stationary along the self-motion, largest or smallest."""
    along = RegularGridInterpolator((y, x), curvature)
    parts: dict[bool, list[Array]] = {False: [], True: []}
    for line in zero_lines(x, y, optimality):
        least = along(line[:, ::-1]) > 0.0
        turns = np.flatnonzero(np.diff(least)) + 1
        for first, last in zip([0, *turns], [*turns, len(line)], strict=True):
            parts[bool(least[first])].append(line[max(0, first - 1) : last])
    yield Locus("H largest", palette.TRUE, tuple(parts[False]))
    yield Locus("H smallest", palette.NEUTRAL, tuple(parts[True]), dashed=True)


def _marks(points: Sequence[SingularPoint]) -> Iterator[Marks]:
    for kind, (short, color, symbol) in _KINDS.items():
        chosen = [point for point in points if point.kind is kind and point.regular]
        inside = sum(point.inside for point in chosen)
        if chosen:
            text = kind.name.lower().replace("_", " ")
            yield Marks(f"{short} {text}, {inside} inside", color, symbol, np.degrees([point.q for point in chosen]))
    still = [point.q for point in points if point.kind is Kind.ALGORITHMIC and not point.regular]
    if still:
        yield Marks("AS* H constant along the self-motion", palette.NEUTRAL, "d", np.degrees(still))


def plots_of(
    ways: Ways, margins_of: Mapping[str, Sequence[Margins]], bounds: Mapping[int, tuple[float, float]]
) -> tuple[Plot, ...]:
    """H and joint 2 of all four on the overview; margins by kind and multipliers in a tab."""
    limits = tuple(float(np.degrees(limit)) for limit in next(iter(bounds.values())))
    rows = list(ways.named())
    measure = tuple(
        Curve(name, t_s, np.array([m.measure for m in margins_of[name]]), color)
        for (name, t_s, _), color in zip(rows, _COLORS, strict=True)
    )
    second = tuple(
        Curve(name, t_s, np.degrees(q[:, 1]), color) for (name, t_s, q), color in zip(rows, _COLORS, strict=True)
    )
    multipliers = (
        Curve("maximise", ways.best.t, ways.best.multiplier, _COLORS[0]),
        Curve("minimise", ways.least.t, ways.least.multiplier, _COLORS[1]),
    )
    return (
        Plot("Manipulability H [SI]", measure),
        Plot("Bounded joint, all four [°]", second, limits=limits),
        *(_margin_plot(name, t_s, margins_of[name]) for name, t_s, _ in rows),
        Plot("Multiplier of the limit, tracker [SI]", multipliers, limits=(0.0,), tab=MARGINS_TAB),
    )


def _margin_plot(name: str, t_s: Vector, margins: Sequence[Margins]) -> Plot:
    curves = tuple(
        Curve(short, t_s, np.array([m.of(kind) for m in margins]), color) for kind, (short, color, _) in _KINDS.items()
    )
    return Plot(f"Singularity margins, {name} [1]", curves, limits=(NEAR,), span=(-0.02, 1.02), tab=MARGINS_TAB)


def states_of(ways: Ways, margins_of: Mapping[str, Sequence[Margins]]) -> tuple[StateChange, ...]:
    """One lane for each run: the kind that it is near to."""
    found = []
    for name, t_s, _ in ways.named():
        last = ""
        for t, m in zip(t_s.tolist(), margins_of[name], strict=True):
            kind = m.kind(NEAR)
            state = "none" if kind is Kind.NONE else kind.name.lower().replace("_", " ")
            if state != last:
                found.append(StateChange(round(1e9 * t), name.replace(", ", "/").replace(" ", "_"), state))
                last = state
    return tuple(sorted(found, key=lambda change: change.t_ns))
