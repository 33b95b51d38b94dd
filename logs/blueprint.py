"""How a recording opens: the robot and what an engineer looks at first; what is of second rank waits in tabs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from logs.around import NOTHING, Around, around_views
from logs.columns import TIMELINE
from logs.detail import Detail
from logs.plots import WHEELS
from logs.scene import ELLIPSOID_SCALE, PATHS
from stack.kinematics import ArmModel
from stack.messages import Vector

_OVERVIEW_STATES = ("drives/all", "mission/step", "planner/phase", "planner/restrictions", "planner/singularity")


def view_contents(arm: ArmModel, around: Around = NOTHING) -> dict[str, tuple[str, ...]]:
    """Entity paths of every view, by the view's title; a path that ends in `/**` stands for all below it."""
    each = {
        title: (f"joints/each_rad_or_m/{name}",)
        for title, name in zip(_joint_titles(arm), arm.joint_names, strict=True)
    }
    return {
        f"{arm.name}, ellipsoids {ELLIPSOID_SCALE:g} m per m/s": ("world/**",),
        "TCP error [mm]": ("tcp/error_mm",),
        "Joint positions [share of range, limits at ±1]": ("joints/position_share", "joints/limits_share"),
        "Manipulability, arm [SI]": ("manipulability/arm_SI",),
        "Manipulability, robot [SI]": ("manipulability/robot_SI",),
        "Platform v [m/s]": ("platform/v_m_per_s/commanded", "platform/v_m_per_s/encoder", "platform/v_m_per_s/true"),
        "Platform ω [rad/s]": (
            "platform/omega_rad_per_s/commanded",
            "platform/omega_rad_per_s/encoder",
            "platform/omega_rad_per_s/true",
        ),
        "Bus load [%]": ("bus/load_percent",),
        "Path scale ϑ [1]": ("planner/path_scale_1",),
        "States": tuple(f"states/{lane}" for lane in _OVERVIEW_STATES),
        "Events": ("events",),
        "Events, all": ("events",),
        **each,
        "Joint velocities [share of limit]": ("joints/velocity_share",),
        "Joint efforts [N·m, lift N]": ("joints/effort_Nm_or_N/actual",),
        "Effort offsets sent [N·m, lift N]": ("joints/effort_Nm_or_N/offset",),
        "Drives [CiA 402 state]": ("states/drives/**",),
        "Nodes [NMT state]": ("states/nodes/**",),
        "Frames [1/s]": ("bus/frames_per_s",),
        "Load by message class [%]": ("bus/load_by_class_percent",),
        "Last frame of a class after SYNC [ms]": ("bus/after_sync_ms",),
        "SYNC later than due [µs]": ("bus/sync_error_us",),
        "Planner computes [ms]": ("cycle/computing_ms",),
        "Frames in words": ("can/**",),
        **{
            f"Wheel {side} [rad/s]": tuple(
                f"wheels/velocity_rad_per_s/{side}/{role}" for role in ("commanded", "encoder", "true")
            )
            for side in WHEELS
        },
        "Singular values, arm [SI]": ("singular_values/arm_SI",),
        "Singular values, robot [SI]": ("singular_values/robot_SI",),
        "Singularity margins by kind [1]": ("singularity/margins_1",),
        "Distance to singular manifolds [rad]": ("singularity/manifolds_rad",),
        "Rotation error [mrad]": ("tcp/rotation_error_mrad",),
        "Tracker error [mm]": ("tracker/position_error_mm",),
        "Force at the gripper [N]": ("wrench/force_N",),
        "Torque at the gripper [N·m]": ("wrench/torque_Nm",),
        "Commanded twist, linear [m/s]": ("twist/linear_m_per_s",),
        "Commanded twist, angular [rad/s]": ("twist/angular_rad_per_s",),
        **around_views(around),
        "Wheel slip [%]": ("wheels/slip_percent", "wheels/slip_estimate_percent"),
    }


def _joint_titles(arm: ArmModel) -> list[str]:
    return [f"{row.name} [{'rad' if row.revolute else 'm'}]" for row in arm.description.joints]


TOWER_M = 1.75
"""How high the robot reaches whatever its hand does."""


@dataclass(frozen=True, slots=True)
class Stage:
    """What the eye shall see: lowest and highest corner (3,) in the world, and from which horizontal side (2,), of length 1."""

    low: Vector
    high: Vector
    side: Vector

    @staticmethod
    def of(tcp: tuple[Vector, Vector], platform: tuple[Vector, Vector], low: Vector, high: Vector) -> Stage:
        """Looks across the way that the TCP has gone, from the side on which the arm is; `tcp`, `platform`: first, last (3,)."""
        travel = (tcp[1] - tcp[0])[:2]
        length = float(np.linalg.norm(travel))
        side = np.array([travel[1], -travel[0]]) / length if length > 0.3 else np.array([0.42, -0.91])
        reach = (tcp[1] - platform[1])[:2]
        margin = np.array([0.4, 0.4, 0.0])
        floor = np.minimum(low, [np.inf, np.inf, 0.0])
        top = np.maximum(high, [-np.inf, -np.inf, TOWER_M])
        return Stage(floor - margin, top + margin, side if float(reach @ side) >= -0.1 else -side)

    def target_and_eye(self) -> tuple[Vector, Vector]:
        """Where to look (3,) and from where (3,), so that all of it is in view."""
        target = 0.5 * (self.low + self.high)
        distance = 0.6 * float(np.linalg.norm(self.high - self.low)) + 0.8
        return target, target + distance * np.append(0.85 * self.side, 0.5)


START = Stage(np.array([-1.0, -1.0, 0.0]), np.array([1.5, 1.0, 1.4]), np.array([0.42, -0.91]))


def blueprint(
    arm: ArmModel, stage: Stage = START, around: Around = NOTHING, detail: Detail = Detail.FULL
) -> rrb.Blueprint:
    """The layout for the robot that carries `arm`. `stage`: where the eye looks when it opens; `around`: what there is to plot besides.

    With `Detail.MINIMAL` the overview is all there is.
    """
    contents = view_contents(arm, around)
    titles = list(contents)
    scene = _scene(titles[0], contents[titles[0]], arm.name, stage)

    def plot(
        title: str, *, legend: bool = True, low: float | None = None, high: float | None = None
    ) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(
            name=title,
            origin="/",
            contents=[f"/{path}" for path in contents[title]],
            axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
            axis_y=rrb.ScalarAxis(range=(low, high)) if low is not None and high is not None else None,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
        )

    def states(title: str) -> rrb.StateTimelineView:
        return rrb.StateTimelineView(name=title, origin="/", contents=[f"/{path}" for path in contents[title]])

    def events(title: str, levels: list[str] | None = None) -> rrb.TextLogView:
        return rrb.TextLogView(
            name=title,
            origin="/events",
            columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["LogLevel", "Body"]),
            rows=None if levels is None else rrb.TextLogRows(filter_by_log_level=levels),
        )

    left = rrb.Vertical(
        scene,
        states("States"),
        events("Events", ["INFO", "WARN", "ERROR"]),
        row_shares=[4.7, 2.45, 1.7],
    )
    middle = rrb.Vertical(
        plot("TCP error [mm]"),
        plot("Joint positions [share of range, limits at ±1]", low=-1.1, high=1.1),
        rrb.Horizontal(plot("Manipulability, arm [SI]"), plot("Manipulability, robot [SI]")),
        row_shares=[1, 1.5, 0.9],
    )
    right = rrb.Vertical(
        plot("Platform v [m/s]"),
        plot("Platform ω [rad/s]"),
        rrb.Horizontal(
            plot("Bus load [%]", legend=False, low=0.0, high=100.0),
            plot("Path scale ϑ [1]", legend=False, low=0.0, high=1.05),
        ),
        row_shares=[1, 1, 0.9],
    )
    overview = rrb.Horizontal(left, middle, right, column_shares=[1.25, 1, 1], name="Overview")
    joints = rrb.Vertical(
        rrb.Grid(
            *(plot(title, legend=i == 0) for i, title in enumerate(_joint_titles(arm))), grid_columns=4, name="Joints"
        ),
        rrb.Horizontal(
            plot("Joint velocities [share of limit]"),
            plot("Joint efforts [N·m, lift N]"),
            plot("Effort offsets sent [N·m, lift N]"),
        ),
        row_shares=[2, 1],
        name="Joints",
    )
    drives = rrb.Horizontal(
        states("Drives [CiA 402 state]"), states("Nodes [NMT state]"), events("Events, all"), name="Drives and nodes"
    )
    bus = rrb.Horizontal(
        rrb.Vertical(
            plot("Load by message class [%]"),
            plot("Last frame of a class after SYNC [ms]"),
            plot("Planner computes [ms]", legend=False),
            rrb.Horizontal(plot("SYNC later than due [µs]", legend=False), plot("Frames [1/s]", legend=False)),
        ),
        rrb.TextLogView(
            name="Frames in words",
            origin="/can",
            columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["Body"]),
        ),
        column_shares=[1, 1.3],
        name="Bus",
    )
    dexterity = rrb.Grid(
        plot("Singularity margins by kind [1]", low=-0.02, high=1.02),
        plot("Distance to singular manifolds [rad]"),
        plot("Singular values, arm [SI]"),
        plot("Singular values, robot [SI]"),
        grid_columns=2,
        name="Singularities",
    )
    task = rrb.Grid(
        *(plot(title) for title in around_views(around)),
        plot("Rotation error [mrad]", legend=False),
        plot("Tracker error [mm]", legend=False),
        plot("Wheel slip [%]"),
        *(plot(f"Wheel {side} [rad/s]") for side in WHEELS),
        plot("Force at the gripper [N]"),
        plot("Torque at the gripper [N·m]"),
        plot("Commanded twist, linear [m/s]"),
        plot("Commanded twist, angular [rad/s]"),
        grid_columns=4,
        name="Task, forces, slip",
    )
    tabs = (joints, drives, bus, dexterity, task)
    return rrb.Blueprint(
        rrb.Tabs(overview, *(tabs if detail is Detail.FULL else ()), active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        collapse_panels=False,
    )


def _scene(title: str, contents: Sequence[str], robot: str, stage: Stage) -> rrb.Spatial3DView:
    target, eye = stage.target_and_eye()
    so_far = rrb.VisibleTimeRange(
        TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    )
    return rrb.Spatial3DView(
        name=title,
        origin="/world",
        contents=[*(f"+ /{path}" for path in contents), f"- /world/{robot}/collision_geometries/**"],
        background=rrb.Background(color=(24, 27, 33)),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=(110, 118, 130, 90)),
        # the robot's shapes come without a fill mode, and would be drawn as glass
        defaults=[
            rr.Boxes3D.from_fields(fill_mode=rr.components.FillMode.Solid),
            rr.Cylinders3D.from_fields(fill_mode=rr.components.FillMode.Solid),
            rr.Ellipsoids3D.from_fields(fill_mode=rr.components.FillMode.Solid),
        ],
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={path: [rrb.VisibleTimeRanges(so_far)] for path in PATHS},
    )
