"""What an engineer looks at after a pass of the wrist singularity."""

from __future__ import annotations

import numpy as np

from logs import palette
from logs.traces import Array, Curve, Plot, Trace
from stack.kinematics import ArmModel
from stack.messages import Vector

_AXES_4_6 = (3, 5)


def wrist_plots(
    arm: ArmModel, judged: Trace, closed: Trace, error: Array, theta: Vector, error_bound: float
) -> tuple[Plot, ...]:
    """Errors and ϑ of the judged trace; wrist axes and velocities of both. error (k, 6): position, rotation vector; theta (k,)."""
    t_s = judged.t_s
    rotation, distance = np.linalg.norm(error[:, 3:], axis=1), np.linalg.norm(error[:, :3], axis=1)
    bound = () if np.isinf(error_bound) else (float(np.degrees(error_bound)),)
    names = ("about x", "about y", "about z")
    turns = tuple(Curve(name, t_s, np.degrees(error[:, 3 + i]), palette.AXES[i], 1.0) for i, name in enumerate(names))
    return (
        Plot(
            "Orientation error [°]",
            (Curve("angle", t_s, np.degrees(rotation), palette.COMMANDED, 3.0), *turns),
            limits=bound,
            limit_label="bound",
            legend_right=True,
        ),
        Plot(
            "Translation error [µm]",
            (Curve("distance", t_s, 1e6 * distance, palette.TRUE),),
            legend=False,
        ),
        Plot(
            "Time scaling ϑ [1]",
            (Curve("ϑ", t_s, theta, palette.VIOLET),),
            span=(-0.05, 1.05),
            legend=False,
        ),
        Plot("Axes 4 and 6 [°]", _wrist_axes(arm, judged, closed)),
        Plot(
            "Axis 5 [°]",
            (
                Curve("closed form", closed.t_s, np.degrees(closed.q[:, 4]), palette.NEUTRAL, 3.5),
                Curve(judged.name, t_s, np.degrees(judged.q[:, 4]), palette.MEASURED),
            ),
            limits=(0.0,),
            limit_label="singular",
            legend_right=True,
        ),
    )


def _wrist_axes(arm: ArmModel, judged: Trace, closed: Trace) -> tuple[Curve, ...]:
    curves = []
    for i in _AXES_4_6:
        color = palette.JOINTS[i]
        pale = tuple(round(0.5 * part) for part in color)
        curves.append(Curve(f"{i + 1}, closed form", closed.t_s, np.degrees(closed.q[:, i]), pale, 4.0))  # type: ignore[arg-type]
        curves.append(Curve(f"{i + 1}, {judged.name}", judged.t_s, np.degrees(judged.q[:, i]), color, 1.8))
    return tuple(curves)
