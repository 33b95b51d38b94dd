"""Writes a kinematic experiment to a Rerun file: the arm, its paths, plots, states, events; all at once, after the experiment."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from logs import palette
from logs.columns import TIMELINE
from logs.kinematic_blueprint import TRAILS, kinematic_blueprint
from logs.kinematic_plots import TRACE_COLORS, joint_plots
from logs.map_recorder import log_map, send_places
from logs.optimise import optimise
from logs.recorder import APPLICATION, RunInfo, run_properties
from logs.signals import Decimation, Ints, StateChange
from logs.traces import Array, Plot, Recorded, Trace
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.messages import Vector

RATE_HZ = 25.0
"""Of everything in 3-D; plots have every cycle."""
_POINTS_PER_STRIP = 4
_TOOL_AXES_M, _COMMANDED_AXES_M = 0.12, 0.22
_FLUSH_S = 10.0


def record_kinematic(path: Path, recorded: Recorded, info: RunInfo) -> str | None:
    """Writes the recording. Returns None, or why it is not complete: a full disk must not cost the run its metrics."""
    try:
        _Recording(path, recorded, info).write()
    except (OSError, RuntimeError, ValueError) as fault:
        return f"{type(fault).__name__}: {fault}"
    optimise(path)
    return None


class _Recording:
    def __init__(self, path: Path, recorded: Recorded, info: RunInfo) -> None:
        self._recorded, self._info = recorded, info
        self._arm = ArmModel.load(recorded.robot)
        self._urdf = robot_directory(recorded.robot) / "robot.urdf"
        plots = (*recorded.plots, *joint_plots(self._arm, recorded))
        self._plots = [(f"plots/{_named_with_unit(plot.title)}", plot) for plot in plots]
        self._stream = rr.RecordingStream(APPLICATION, send_properties=True)
        lanes = list(dict.fromkeys(change.lane for change in recorded.states))
        low, high = self._extent()
        self._maps = [(f"maps/{plane.name}", plane) for plane in recorded.maps]
        layout = kinematic_blueprint(self._arm.name, self._plots, lanes, low, high, self._maps)
        self._stream.set_sinks(rr.FileSink(path), default_blueprint=layout)

    def write(self) -> None:
        """Statics first: columns overtake what is still in the batcher."""
        self._log_statics()
        self._robot(self._recorded.judged)
        for trace, color in zip(self._recorded.traces, TRACE_COLORS, strict=False):
            self._trail(trace, color)
        for trace, color in zip(self._recorded.traces[1:], TRACE_COLORS[1:], strict=False):
            self._skeleton(trace, color)
        self._tools()
        for path, plot in self._plots:
            self._plot(path, plot)
        for path, plane in self._maps:
            times = np.unique(np.concatenate([self._due(trace)[0] for trace in self._recorded.traces]))
            send_places(plane, path, times, self._send)
        self._states(self._recorded.states)
        self._events()
        self._stream.flush(timeout_sec=_FLUSH_S)
        self._stream.disconnect()

    def _log_statics(self) -> None:
        stream = self._stream
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("tf/world", rr.Transform3D(parent_frame="tf#/world", child_frame="world"), static=True)
        self._tree = rr.urdf.UrdfTree.from_file_path(self._urdf, entity_path_prefix="world")
        self._tree.log_urdf_to_recording(recording=stream)
        root = rr.Transform3D(parent_frame="world", child_frame=self._tree.root_link().name)
        stream.log("tf/base", root, static=True)
        if self._recorded.commanded is not None:
            line = rr.LineStrips3D([self._recorded.commanded[:, :3, 3]], colors=[palette.COMMANDED], radii=[-1.2])
            stream.log("world/path", line, static=True)
        for path, plot in self._plots:
            for i, curve in enumerate(plot.curves):
                color = curve.color or palette.JOINTS[i % len(palette.JOINTS)]
                style = rr.SeriesLines(names=[curve.label], colors=[color], widths=[curve.width])
                stream.log(f"{path}/{i:02d}", style, static=True)
            if plot.limits:
                k = len(plot.limits)
                style = rr.SeriesLines(names=[plot.limit_label] * k, colors=[palette.LIMIT] * k, widths=[1.0] * k)
                stream.log(f"{path}/limits", style, static=True)
        for path, plane in self._maps:
            log_map(stream, path, plane)
        for lane in dict.fromkeys(change.lane for change in self._recorded.states):
            values = sorted({change.state for change in self._recorded.states if change.lane == lane})
            colors = [(*_state_color(value), 255) for value in values]
            stream.log(
                f"states/{lane}", rr.StateConfiguration(values=values, labels=values, colors=colors), static=True
            )
        stream.send_recording_name(f"{self._info.name}, seed {self._info.seed}")
        stream.send_property("run", rr.AnyValues(**run_properties(self._info)))
        stream.flush(timeout_sec=_FLUSH_S)

    def _extent(self) -> tuple[Vector, Vector]:
        """Corners of the robot's shoulder-to-floor column and of where its tool goes."""
        points = np.vstack([trace.pose[:, :3, 3] for trace in self._recorded.traces])
        points = np.vstack([points, self._arm.joint_positions(self._recorded.judged.q[0]), np.zeros((1, 3))])
        return points.min(axis=0), points.max(axis=0)

    def _due(self, trace: Trace) -> tuple[Ints, Ints]:
        """(times ns, rows) at the rate of the 3-D part, the last row included."""
        t_ns = _ns(trace.t_s)
        rows = np.union1d(Decimation(RATE_HZ).due(t_ns), [len(t_ns) - 1]).astype(np.int64)
        return t_ns[rows], rows

    def _robot(self, trace: Trace) -> None:
        t_ns, rows = self._due(trace)
        for i, name in enumerate(self._arm.joint_names):
            columns = self._tree.get_joint_by_name(name).compute_transform_columns(
                trace.q[rows, i].tolist(), clamp=False
            )
            self._send(f"tf/joints/{name}", t_ns, columns)

    def _skeleton(self, trace: Trace, color: palette.Color) -> None:
        """The arm under another method, as a line through its joints."""
        t_ns, rows = self._due(trace)
        strips = [self._arm.joint_positions(trace.q[row]) for row in rows]
        columns = rr.LineStrips3D.columns(strips=strips, colors=[color] * len(strips), radii=[-2.5] * len(strips))
        self._send(f"world/skeleton/{_slug(trace.name)}", t_ns, columns)

    def _trail(self, trace: Trace, color: palette.Color) -> None:
        """Where the TCP of the judged trace has been up to now."""
        if trace is not self._recorded.judged:
            return
        t_ns, rows = self._due(trace)
        points = trace.pose[rows, :3, 3]
        ends = range(1, len(points), _POINTS_PER_STRIP)
        strips = [points[max(0, end - 1) : end + _POINTS_PER_STRIP] for end in ends]
        times = np.array([t_ns[min(end + _POINTS_PER_STRIP - 1, len(points) - 1)] for end in ends], np.int64)
        if strips:
            columns = rr.LineStrips3D.columns(strips=strips, colors=[color] * len(strips), radii=[-3.0] * len(strips))
            self._send(TRAILS, times, columns)

    def _tools(self) -> None:
        """The tool's axes: as they are (short, thick) and as commanded (long, thin)."""
        trace = self._recorded.judged
        t_ns, rows = self._due(trace)
        self._axes("world/tool", t_ns, trace.pose[rows], _TOOL_AXES_M, -4.0)
        if self._recorded.commanded is not None:
            self._axes("world/commanded", t_ns, self._recorded.commanded[rows], _COMMANDED_AXES_M, -1.2)

    def _axes(self, path: str, t_ns: Ints, poses: Array, length: float, radius: float) -> None:
        k = len(poses)
        arrows = rr.Arrows3D.from_fields(
            vectors=length * np.eye(3), colors=[*palette.AXES], radii=[radius] * 3, origins=np.zeros((3, 3))
        )
        self._stream.log(path, arrows, static=True)
        self._stream.flush(timeout_sec=_FLUSH_S)
        turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
        self._send(path, t_ns[:k], rr.Transform3D.columns(translation=poses[:, :3, 3], quaternion=turns))

    def _plot(self, path: str, plot: Plot) -> None:
        for i, curve in enumerate(plot.curves):
            self._send(f"{path}/{i:02d}", _ns(curve.t_s), rr.Scalars.columns(scalars=curve.values))
        if plot.limits:
            ends = np.array([min(c.t_s[0] for c in plot.curves), max(c.t_s[-1] for c in plot.curves)])
            self._send(f"{path}/limits", _ns(ends), rr.Scalars.columns(scalars=np.tile(plot.limits, (2, 1))))

    def _states(self, states: Iterable[StateChange]) -> None:
        lanes: dict[str, list[StateChange]] = {}
        for change in states:
            lanes.setdefault(change.lane, []).append(change)
        for lane, changes in lanes.items():
            t_ns = np.array([change.t_ns for change in changes], np.int64)
            self._send(f"states/{lane}", t_ns, rr.StateChange.columns(state=[change.state for change in changes]))

    def _events(self) -> None:
        events = self._recorded.events
        if events:
            t_ns = np.array([event.t_ns for event in events], np.int64)
            texts = [f"{event.source}: {event.text}" for event in events]
            self._send("events", t_ns, rr.TextLog.columns(text=texts, level=[event.level.name for event in events]))

    def _send(self, path: str, t_ns: Ints, columns: Any) -> None:
        cycles = np.round(1e-9 * t_ns / self._recorded.cycle_s).astype(np.int64)
        index = [
            rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]")),
            rr.TimeColumn("arm_cycle", sequence=cycles),
        ]
        self._stream.send_columns(path, indexes=index, columns=columns)


def _ns(t_s: Vector) -> Ints:
    return np.round(1e9 * np.asarray(t_s)).astype(np.int64)


def _slug(title: str) -> str:
    """A title, without its unit, as one part of an entity path."""
    return re.sub(r"[^a-z0-9ϑ]+", "_", title.split("[")[0].lower()).strip("_")


def _named_with_unit(title: str) -> str:
    """`Joint 4 [°]` as `joint_4_deg`. Raises KeyError for a unit that is not in the list, or none."""
    unit = re.search(r"\[(.*)\]$", title)
    return f"{_slug(title)}_{_UNITS['' if unit is None else unit[1]]}"


_UNITS = {"share of limit": "share", "°": "deg", "µm": "um", "mm": "mm", "rad": "rad", "m": "m", "1": "1", "SI": "SI"}
_STATUS_COLORS = {
    "ok": palette.GOOD,
    "constrained": palette.BUSY,
    "singular": palette.VIOLET,
    "degraded": palette.WARNING,
    "infeasible": palette.BAD,
    "closed form": palette.GOOD,
    "optimisation": palette.BUSY,
}


def _state_color(state: str) -> palette.Color:
    return _STATUS_COLORS.get(state) or palette.state_color(state)
