"""One recording of several runs: their robots in one scene, paths and curves over each other, on the time since their first motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from logs import palette
from logs.blueprint import START, Stage
from logs.comparison_blueprint import PLOTS, TABLE, TASK_TIME, comparison_blueprint, joint_plots
from logs.palette import Color
from logs.recording_reader import Recording, Strips
from logs.signals import Ints, Signal
from stack.kinematics import ArmModel
from stack.messages import Vector

LABELS = "ABCDEFGH"
_SOURCES = {
    "tcp_error_mm": ("tcp/error_mm", 0),
    "platform_v_m_per_s": ("platform/v_m_per_s/true", 0),
    "platform_omega_rad_per_s": ("platform/omega_rad_per_s/true", 0),
    "manipulability_arm_SI": ("manipulability/arm_SI", 0),
    "manipulability_robot_SI": ("manipulability/robot_SI", 0),
}
"""Plotted entity: entity of the run's recording, column of it."""


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """One run of a comparison. `title`: what people know it by; `start_ns`: its time at which task time is 0."""

    title: str
    recording: Recording
    start_ns: int


def record_comparison(
    path: Path, runs: Sequence[ComparedRun], arm: ArmModel, urdf: Path, table_markdown: str = ""
) -> None:
    """Writes `path` with every run under /A, /B, … (at most eight, all of the robot that carries `arm`).

    The first robot is solid, the others are drawn as ghosts in the colours of their curves. Raises OSError or RuntimeError when the
    file cannot be written.
    """
    labels = LABELS[: len(runs)]
    stream = rr.RecordingStream("canipulator_comparison", send_properties=True)
    stream.set_sinks(rr.FileSink(path), default_blueprint=comparison_blueprint(labels, arm, _stage(runs)))
    stream.log("tf/world", rr.Transform3D(parent_frame="tf#/", child_frame="world"), static=True)
    stream.log(TABLE, rr.TextDocument(table_markdown, media_type=rr.MediaType.MARKDOWN), static=True)
    stream.send_recording_name(" / ".join(run.title for run in runs))
    writers = [
        _RunWriter(stream, label, run, arm, urdf, palette.JOINTS[i], ghost=i > 0)
        for i, (label, run) in enumerate(zip(labels, runs, strict=True))
    ]
    stream.flush(timeout_sec=10.0)  # columns overtake what is still in the batcher
    first = runs[0]
    for writer in writers:
        writer.write(first)
    stream.flush(timeout_sec=30.0)
    stream.disconnect()


class _RunWriter:
    """Puts one run under /`label`."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        label: str,
        run: ComparedRun,
        arm: ArmModel,
        urdf: Path,
        color: Color,
        *,
        ghost: bool,
    ) -> None:
        self._stream, self._label, self._run, self._arm, self._color = stream, label, run, arm, color
        self._tree = rr.urdf.UrdfTree.from_file_path(
            urdf, entity_path_prefix=label, frame_prefix=f"{label}/", static_transform_entity_path=f"/{label}/tf_static"
        )
        self._tree.log_urdf_to_recording(recording=stream)
        self._ghost = ghost
        if ghost:
            self._make_ghost()
        self._style()

    def write(self, first: ComparedRun) -> None:
        """Everything that has times. `first`: the run that the TCP's distance is measured from."""
        self._robot()
        for name, color, radius in (
            ("commanded", palette.NEUTRAL, -1.0),
            ("true", self._color, -2.0 if self._ghost else -4.0),
        ):
            self._path(name, color, radius)
        self._path("platform", self._color, -1.2)
        series = self._run.recording.series
        for entity, (source, column) in _SOURCES.items():
            if source in series:
                self._scalars(entity, series[source].t_ns, series[source].values[:, column])
        joints = series.get("joints/position_rad_or_m/actual")
        if joints is not None:
            for i, entity in enumerate(joint_plots(self._arm).values()):
                self._scalars(entity, joints.t_ns, joints.values[:, i])
        if self._run is not first:
            apart = distance_from(first, self._run)
            self._scalars("tcp_from_A_mm", apart.t_ns + self._run.start_ns, 1e3 * apart.values[:, 0])

    def _make_ghost(self) -> None:
        """The shapes of the robot in the run's colour, see-through."""
        for chunk in self._tree.stream():
            path = str(chunk.entity_path)
            names = chunk.to_record_batch().schema.names
            for kind in (rr.Boxes3D, rr.Cylinders3D, rr.Ellipsoids3D):
                if "/visual_geometries/" in path and any(name.startswith(kind.__name__ + ":") for name in names):
                    mode = rr.components.FillMode.TransparentFillMajorWireframe
                    ghost = kind.from_fields(colors=[(*self._color, 150)], fill_mode=mode)
                    self._stream.log(path, ghost, static=True)

    def _style(self) -> None:
        name = f"{self._label}  {self._run.title}"
        for entity in (*PLOTS.values(), *joint_plots(self._arm).values()):
            style = rr.SeriesLines(names=[name], colors=[self._color], widths=[1.6])
            self._stream.log(f"{self._label}/{entity}", style, static=True)

    def _robot(self) -> None:
        """The transforms of the run's own robot, between the frames of this one."""
        series = self._run.recording.series
        base = series.get("tf/platform")
        if base is not None:
            self._transforms("tf/platform", base, "world", f"{self._label}/{self._tree.root_link().name}")
        for joint in self._tree.joints():
            transforms = series.get(f"tf/joints/{joint.name}")
            if transforms is not None:
                frames = (f"{self._label}/{joint.parent_link}", f"{self._label}/{joint.child_link}")
                self._transforms(f"tf/joints/{joint.name}", transforms, *frames)

    def _transforms(self, entity: str, transforms: Signal, parent: str, child: str) -> None:
        n = len(transforms)
        columns = rr.Transform3D.columns(
            translation=transforms.values[:, :3],
            quaternion=transforms.values[:, 3:],
            parent_frame=[parent] * n,
            child_frame=[child] * n,
        )
        self._send(entity, transforms.t_ns, columns)

    def _path(self, name: str, color: Color, radius: float) -> None:
        """A path in one colour; `radius` < 0 is in points of the screen."""
        strips = self._run.recording.paths.get(f"world/path/{name}")
        if strips is not None and strips.points:
            n = len(strips.points)
            columns = rr.LineStrips3D.columns(strips=list(strips.points), colors=[color] * n, radii=[radius] * n)
            self._send(f"path/{name}", np.array(strips.t_ns, np.int64), columns)

    def _scalars(self, entity: str, t_ns: Ints, values: Vector) -> None:
        self._send(entity, t_ns, rr.Scalars.columns(scalars=values))

    def _send(self, entity: str, t_ns: Ints, columns: Any) -> None:
        """Columns of one entity at the run's own times."""
        index = rr.TimeColumn(TASK_TIME, duration=(t_ns - self._run.start_ns).astype("timedelta64[ns]"))
        self._stream.send_columns(f"{self._label}/{entity}", indexes=[index], columns=columns)


def distance_from(first: ComparedRun, other: ComparedRun) -> Signal:
    """Distance (n, 1) in m of `other`'s true TCP from that of `first` at the same task time, while both are there; times are task time."""
    a, b = (_tcp(run) for run in (first, other))
    if not len(a) or not len(b):
        return Signal(np.empty(0, np.int64), np.empty((0, 1)))
    both = b.at((b.t_ns >= a.t_ns[0]) & (b.t_ns <= a.t_ns[-1]))
    there = np.column_stack([np.interp(both.t_ns, a.t_ns, a.values[:, i]) for i in range(3)])
    return Signal(both.t_ns, np.linalg.norm(both.values - there, axis=1, keepdims=True))


def _tcp(run: ComparedRun) -> Signal:
    positions = run.recording.paths.get("world/path/true", Strips((), ())).positions()
    return Signal(positions.t_ns - run.start_ns, positions.values)


def _stage(runs: Sequence[ComparedRun]) -> Stage:
    """What all runs have gone through, seen from the side of the first."""
    tcp = [_tcp(run).values for run in runs]
    base = [run.recording.series["tf/platform"].values[:, :3] for run in runs if "tf/platform" in run.recording.series]
    points = np.vstack([*tcp, *base])
    if not len(points) or not len(tcp[0]) or not base:
        return START
    ends = ((tcp[0][0], tcp[0][-1]), (base[0][0], base[0][-1]))
    return Stage.of(*ends, points.min(axis=0), points.max(axis=0))
