"""How a comparison opens: all robots in one scene, their errors and what made them over each other, joints and numbers in tabs."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from logs.blueprint import Stage
from stack.kinematics import ArmModel

TASK_TIME = "task_time"
"""Timeline of a comparison: 0 where the first motion of each run begins."""
TABLE = "table"
PLOTS = {
    "TCP error [mm]": "tcp_error_mm",
    "Distance of the TCP from that of A [mm]": "tcp_from_A_mm",
    "Platform v, true [m/s]": "platform_v_m_per_s",
    "Platform ω, true [rad/s]": "platform_omega_rad_per_s",
    "Manipulability, arm [SI]": "manipulability_arm_SI",
    "Manipulability, robot [SI]": "manipulability_robot_SI",
}
PATHS = ("path/commanded", "path/true", "path/platform")


def joint_plots(arm: ArmModel) -> dict[str, str]:
    """Title and entity of each joint's plot."""
    units = {row.name: "rad" if row.revolute else "m" for row in arm.description.joints}
    return {f"{name} [{unit}]": f"joints/{name}_{unit}" for name, unit in units.items()}


def view_contents(labels: Sequence[str], arm: ArmModel) -> dict[str, tuple[str, ...]]:
    """Entity paths of every view, by its title."""
    plots = {**PLOTS, **joint_plots(arm)}
    scene = {"Robots and paths": tuple(f"{label}/**" for label in labels)}
    return {**scene, **{title: tuple(f"{label}/{name}" for label in labels) for title, name in plots.items()}}


def comparison_blueprint(labels: Sequence[str], arm: ArmModel, stage: Stage) -> rrb.Blueprint:
    """The layout for runs under /`label`. `stage`: where the eye looks."""
    contents = view_contents(labels, arm)

    def plot(title: str, *, legend: bool = True) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(
            name=title,
            origin="/",
            contents=[f"/{path}" for path in contents[title]],
            axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        )

    titles = list(PLOTS)
    right = rrb.Vertical(
        plot(titles[0]),
        plot(titles[1]),
        rrb.Horizontal(*(plot(title, legend=False) for title in titles[2:4])),
        rrb.Horizontal(*(plot(title, legend=False) for title in titles[4:])),
    )
    numbers = rrb.TextDocumentView(name="Numbers", origin=f"/{TABLE}")
    overview = rrb.Horizontal(_scene(labels, stage, arm.name), right, column_shares=[1.2, 1], name="Overview")
    joints = rrb.Grid(
        *(plot(title, legend=i == 0) for i, title in enumerate(joint_plots(arm))), grid_columns=4, name="Joints"
    )
    return rrb.Blueprint(
        rrb.Tabs(overview, joints, numbers, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=TASK_TIME),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        collapse_panels=False,
    )


def _scene(labels: Sequence[str], stage: Stage, robot: str) -> rrb.Spatial3DView:
    target, eye = stage.target_and_eye()
    so_far = rrb.VisibleTimeRange(
        TASK_TIME, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    )
    return rrb.Spatial3DView(
        name="Robots and paths",
        origin="/",
        contents=[
            *(f"+ /{label}/{robot}/visual_geometries/**" for label in labels),
            *(f"+ /{label}/{path}" for label in labels for path in (*PATHS, "label")),
            *(f"+ /{label}/tf/**" for label in labels),
            *(f"+ /{label}/tf_static" for label in labels),
            "+ /tf/world",
        ],
        background=rrb.Background(color=(24, 27, 33)),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=(110, 118, 130, 90)),
        defaults=[
            rr.Boxes3D.from_fields(fill_mode=rr.components.FillMode.Solid),
            rr.Cylinders3D.from_fields(fill_mode=rr.components.FillMode.Solid),
            rr.Ellipsoids3D.from_fields(fill_mode=rr.components.FillMode.Solid),
        ],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={f"{label}/{path}": [rrb.VisibleTimeRanges(so_far)] for label in labels for path in PATHS},
    )
