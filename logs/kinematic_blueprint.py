"""How a kinematic recording opens: the arm with its path, what happened when, and the experiment's plots; joints wait in a tab."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from logs.columns import TIMELINE
from logs.configuration_map import ConfigurationMap
from logs.map_recorder import map_view
from logs.traces import Plot
from stack.messages import Vector

TRAILS = "world/trail"


def kinematic_blueprint(
    robot: str,
    plots: Sequence[tuple[str, Plot]],
    lanes: Sequence[str],
    low: Vector,
    high: Vector,
    maps: Sequence[tuple[str, ConfigurationMap]] = (),
) -> rrb.Blueprint:
    """plots: (entity path, plot) in the order of reading; low, high (3,): corners of what the eye shall see; maps: (entity path,
    map), each a column of the overview."""
    overview = [_plot(path, plot) for path, plot in plots if plot.tab is None]
    half = (len(overview) + 1) // 2
    left = rrb.Vertical(
        _scene(robot, low, high),
        rrb.StateTimelineView(name="States", origin="/", contents=[f"/states/{lane}" for lane in lanes]),
        rrb.TextLogView(
            name="Events",
            origin="/events",
            columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["LogLevel", "Body"]),
            rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR"]),
        ),
        row_shares=[5, max(1.3, 0.5 * len(lanes)), 1.6],
    )
    columns: list[rrb.Vertical | rrb.Spatial2DView] = [map_view(plane, path) for path, plane in maps]
    columns += [rrb.Vertical(*part) for part in (overview[:half], overview[half:]) if part]
    shares = [1.7] * len(maps) + [1.0] * (len(columns) - len(maps))
    tabs: list[rrb.Horizontal | rrb.Grid] = [
        rrb.Horizontal(left, *columns, column_shares=[1.25, *shares], name="Overview")
    ]
    for name in dict.fromkeys(plot.tab for _, plot in plots if plot.tab is not None):
        views = [_plot(path, plot) for path, plot in plots if plot.tab == name]
        tabs.append(rrb.Grid(*views, grid_columns=min(4, 1 + len(views) // 3), name=name))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        collapse_panels=False,
    )


def _plot(path: str, plot: Plot) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=plot.title,
        origin="/",
        contents=[f"/{path}/**"],
        axis_x=rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
        axis_y=None if plot.span is None else rrb.ScalarAxis(range=plot.span),
        plot_legend=rrb.PlotLegend(
            rrb.Corner2D.RightTop if plot.legend_right else rrb.Corner2D.LeftTop, visible=plot.legend
        ),
    )


def _scene(robot: str, low: Vector, high: Vector) -> rrb.Spatial3DView:
    target = low + [0.5, 0.5, 0.58] * (high - low)
    distance = 0.95 * float(np.linalg.norm(high - low)) + 0.3
    eye = target + distance * np.array([0.62, -0.62, 0.42])
    so_far = rrb.VisibleTimeRange(
        TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    )
    return rrb.Spatial3DView(
        name=f"{robot}: path commanded and gone, tool as commanded (long axes) and as it is",
        origin="/world",
        contents=["+ /world/**", f"- /world/{robot}/collision_geometries/**"],
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
        overrides={TRAILS: [rrb.VisibleTimeRanges(so_far)]},
    )
