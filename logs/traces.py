"""What a kinematic experiment leaves behind: a robot's way under one or more methods, plots, lanes of states, numbers.

Plain data, made by the experiments and read by the runner (metrics) and by the recorder (Rerun).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from logs.configuration_map import ConfigurationMap
from logs.events import Event
from logs.palette import Color
from logs.signals import StateChange
from stack.messages import Vector

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """The way of the robot under one method, one row per cycle: t_s (k,), q (k, n), TCP pose (k, 4, 4) in the arm's base frame.

    dq, ddq (k, n): velocity and acceleration with which each row was reached; None: backward differences of q, from rest.
    """

    name: str
    t_s: Vector
    q: Array
    pose: Array
    dq: Array | None = None
    ddq: Array | None = None

    def __post_init__(self) -> None:
        k = len(self.t_s)
        shapes = {"q": len(self.q), "pose": len(self.pose)}
        for name, length in shapes.items():
            if length != k:
                raise ValueError(f"trace {self.name}: {name} has {length} rows, t_s has {k}")

    @property
    def velocity(self) -> Array:
        """(k, n) in 1/s."""
        if self.dq is not None:
            return self.dq
        return _rate(self.q, self.t_s)

    @property
    def acceleration(self) -> Array:
        """(k, n) in 1/s²."""
        return self.ddq if self.ddq is not None else _rate(self.velocity, self.t_s)


def _rate(values: Array, t_s: Vector) -> Array:
    """Backward difference quotient, 0 in the first row."""
    rate = np.zeros_like(values)
    step_s = np.diff(t_s)[:, None]
    # Ticks that were late in real time are sampled together, at one time.
    np.divide(np.diff(values, axis=0), step_s, out=rate[1:], where=step_s > 0.0)
    return rate


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One line of a plot: values (k,) at t_s (k,), NaN where there is none. `color` None: the next of the palette."""

    label: str
    t_s: Vector
    values: Vector
    color: Color | None = None
    width: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """One view of curves.

    `title` carries the unit in brackets and is unique; `limits`: horizontal lines, `limit_label` what they are; `span`: fixed y range;
    `tab` None: on the overview, else on the tab of that name.
    """

    title: str
    curves: tuple[Curve, ...]
    limits: tuple[float, ...] = ()
    limit_label: str = "limit"
    span: tuple[float, float] | None = None
    tab: str | None = None
    legend: bool = True
    legend_right: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A whole experiment.

    `robot`: name under config/robots. `traces`: the first is the one that is judged, the others stand beside it for comparison.
    `commanded` (k, 4, 4): TCP poses that the rows of the first trace should have; None where no pose is commanded.
    `method`, `coordination`: as in metrics.json. `metrics`: the experiment's own numbers beside the contract's.
    `maps`: of two joints; each becomes `<name>.png` beside the recording and a view in it.
    `cycle_us` (k,): computing time of each cycle. `faults`: what went wrong, by name; empty for a run that went well.
    """

    robot: str
    method: str
    cycle_s: float
    traces: tuple[Trace, ...]
    commanded: Array | None = None
    plots: tuple[Plot, ...] = ()
    states: tuple[StateChange, ...] = ()
    events: tuple[Event, ...] = ()
    metrics: Mapping[str, float | None] = field(default_factory=dict)
    cycle_us: Vector = field(default_factory=lambda: np.empty(0))
    maps: tuple[ConfigurationMap, ...] = ()
    coordination: str = "arm-only"
    faults: tuple[str, ...] = ()

    @property
    def judged(self) -> Trace:
        """The trace that metrics and expectations are about."""
        return self.traces[0]
