"""Plots that every kinematic recording has: all joints against their limits, for each method."""

from __future__ import annotations

import numpy as np

from logs import palette
from logs.palette import Color
from logs.traces import Array, Curve, Plot, Recorded, Trace
from stack.kinematics import ArmModel

JOINTS_TAB = "Joints"
TRACE_COLORS: tuple[Color, ...] = (palette.MEASURED, palette.NEUTRAL, palette.COMMANDED, palette.VIOLET)
_UNITS = {True: "rad", False: "m"}


def joint_plots(arm: ArmModel, recorded: Recorded) -> tuple[Plot, ...]:
    """Velocities as shares of their limits, one plot a method, then each joint's position with its limits, then accelerations."""
    velocities = tuple(
        Plot(
            f"Velocities, {trace.name} [share of limit]",
            _each_joint(arm, trace, trace.velocity / arm.dq_max),
            limits=(-1.0, 1.0),
            legend=i == 0,
            legend_right=True,
        )
        for i, trace in enumerate(recorded.traces)
    )
    positions = tuple(_position(arm, recorded, i) for i in range(arm.n))
    judged = recorded.judged
    acceleration = Plot(
        f"Accelerations, {judged.name} [share of limit]",
        _each_joint(arm, judged, judged.acceleration / arm.ddq_max),
        limits=(-1.0, 1.0),
        span=(-1.15, 1.15),
        tab=JOINTS_TAB,
    )
    return (*velocities, *positions, acceleration)


def _each_joint(arm: ArmModel, trace: Trace, values: Array) -> tuple[Curve, ...]:
    return tuple(
        Curve(name, trace.t_s, values[:, i], palette.JOINTS[i % len(palette.JOINTS)])
        for i, name in enumerate(arm.joint_names)
    )


def _position(arm: ArmModel, recorded: Recorded, i: int) -> Plot:
    """One joint under every method; its limits where they are near enough not to flatten the curves."""
    unit = _UNITS[arm.description.joints[i].revolute]
    traces = tuple(reversed(list(enumerate(recorded.traces))))  # the judged one lies on top
    curves = tuple(
        Curve(trace.name, trace.t_s, trace.q[:, i], TRACE_COLORS[k % len(TRACE_COLORS)], 1.8 if k == 0 else 3.5)
        for k, trace in traces
    )
    low, high = min(c.values.min() for c in curves), max(c.values.max() for c in curves)
    room = max(high - low, 0.2)
    limits = tuple(float(x) for x in (arm.q_min[i], arm.q_max[i]) if low - room <= x <= high + room)
    span = (float(low - 0.1 * room), float(high + 0.1 * room)) if not limits and np.isfinite(room) else None
    return Plot(f"{arm.joint_names[i]} [{unit}]", curves, limits=limits, span=span, tab=JOINTS_TAB, legend=i == 0)
