"""The 3-D part of a recording: the robot as it truly stands, paths, reference pose, velocity ellipsoids."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from logs import palette
from logs.signals import Decimation, Ints, Signal
from stack.kinematics import ArmModel

RATE_HZ = 25.0
POINTS_PER_STRIP = 5  # a new piece of path every 0.2 s
ERROR_FULL_SCALE_M = 0.01
ELLIPSOID_SCALE = 0.25
"""Metres drawn per m/s of the velocity ellipsoid."""

PATHS = ("world/path/commanded", "world/path/true", "world/path/platform")
_WHEEL_JOINTS = ("wheel_left_joint", "wheel_right_joint")


class Send(Protocol):
    """Sends columns of one entity with its times."""

    def __call__(self, path: str, t_ns: Ints, columns: Any) -> None: ...


class Scene:
    """Writes the 3-D entities of the blocks of one run. The robot's entities are under `world/<robot name>`."""

    def __init__(self, arm: ArmModel, urdf: Path) -> None:
        self._tree = rr.urdf.UrdfTree.from_file_path(urdf, entity_path_prefix="world")
        self._joints = [self._tree.get_joint_by_name(name) for name in arm.joint_names]
        platform = arm.description.platform
        self._wheels = [self._tree.get_joint_by_name(name) for name in (platform.wheel_joints if platform else ())]
        self._root = self._tree.root_link().name
        self._poses, self._turns = Decimation(RATE_HZ), Decimation(RATE_HZ)
        self._reference, self._path_points = Decimation(RATE_HZ), Decimation(RATE_HZ)
        self._platform_points = Decimation(RATE_HZ)
        self._ends: dict[str, tuple[int, np.ndarray]] = {}

    def log_statics(self, recording: rr.RecordingStream) -> None:
        """Geometry, frames and styles, once and before anything else."""
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        recording.log("tf/world", rr.Transform3D(parent_frame="tf#/world", child_frame="world"), static=True)
        self._tree.log_urdf_to_recording(recording=recording)
        recording.log("world/reference", rr.TransformAxes3D(0.16), static=True)

    def send(self, signals: Mapping[str, Signal], send: Send, *, ellipsoids: bool = True) -> None:
        """The scene of one block."""
        self._robot(signals, send)
        self._paths(signals, send)
        for name, color in (("arm", palette.COMMANDED), ("robot", palette.MEASURED)):
            ellipsoid = signals.get(f"ellipsoid/{name}")
            if ellipsoid is not None and ellipsoids:
                send(f"world/ellipsoid/{name}", ellipsoid.t_ns, _ellipsoid_columns(ellipsoid.values, color))

    def _robot(self, signals: Mapping[str, Signal], send: Send) -> None:
        q, base = signals.get("truth/q"), signals.get("truth/pose_WB")
        if q is not None and base is not None:
            rows = self._poses.due(q.t_ns)
            t_ns, q_rows, poses = q.t_ns[rows], q.values[rows], base.values[rows]
            if len(rows):
                for i, joint in enumerate(self._joints):
                    send(
                        f"tf/joints/{joint.name}",
                        t_ns,
                        joint.compute_transform_columns(q_rows[:, i].tolist(), clamp=False),
                    )
                frames = {"parent_frame": ["world"] * len(rows), "child_frame": [self._root] * len(rows)}
                send("tf/platform", t_ns, _pose_columns(poses[:, :3, 3], _quaternions(poses), **frames))
        wheels = signals.get("wheels/position/actual")
        if wheels is not None:
            whole = wheels.complete()
            rows = self._turns.due(whole.t_ns)
            for i, joint in enumerate(self._wheels):
                if len(rows):
                    angles = np.remainder(whole.values[rows, i], 2 * np.pi).tolist()
                    send(
                        f"tf/joints/{joint.name}",
                        whole.t_ns[rows],
                        joint.compute_transform_columns(angles, clamp=False),
                    )

    def _paths(self, signals: Mapping[str, Signal], send: Send) -> None:
        commanded, error = signals.get("tcp/commanded"), signals.get("tcp/error")
        pose, base = signals.get("truth/pose_WE"), signals.get("truth/pose_WB")
        if commanded is not None:
            rows = self._reference.due(commanded.t_ns)
            thin = commanded.at(rows)
            if len(rows):
                send("world/reference", thin.t_ns, _pose_columns(thin.values[:, :3], thin.values[:, 3:]))
                self._strips("world/path/commanded", thin.t_ns, thin.values[:, :3], palette.COMMANDED, -1.5, send)
        if pose is not None:
            rows = self._path_points.due(pose.t_ns)
            self._true_path(pose.t_ns[rows], pose.values[rows, :3, 3], error, send)
        if base is not None:
            rows = self._platform_points.due(base.t_ns)
            points = base.values[rows, :3, 3] + [0.0, 0.0, 0.005]
            self._strips("world/path/platform", base.t_ns[rows], points, palette.NEUTRAL, -2.0, send)

    def _true_path(self, t_ns: Ints, points: np.ndarray, error: Signal | None, send: Send) -> None:
        """The true path, each piece in the colour of its error; grey where no path was commanded."""
        distance = np.full(len(t_ns), np.nan)
        if error is not None:
            distance = np.interp(t_ns, error.t_ns, error.values[:, 0], left=np.nan, right=np.nan)
        known = [error_or_grey(value) for value in distance.tolist()]
        self._strips("world/path/true", t_ns, points, known, -3.5, send)

    def _strips(
        self,
        path: str,
        t_ns: Ints,
        points: np.ndarray,
        colors: palette.Color | list[palette.Color],
        radius: float,
        send: Send,
    ) -> None:
        """Pieces of a line that starts where the last one ended; `radius` < 0 is in points of the screen."""
        strips, times, of_strip = [], [], []
        for start in range(0, len(points), POINTS_PER_STRIP):
            piece = points[start : start + POINTS_PER_STRIP]
            end = start + len(piece) - 1
            strips.append(np.vstack([self._ends.get(path, (0, piece[:1]))[1], piece]))
            self._ends[path] = (int(t_ns[end]), piece[-1:])
            times.append(int(t_ns[end]))
            of_strip.append(colors[end] if isinstance(colors, list) else colors)
        if strips:
            columns = rr.LineStrips3D.columns(strips=strips, colors=of_strip, radii=[radius] * len(strips))
            send(path, np.array(times, np.int64), columns)


def error_or_grey(error: float) -> palette.Color:
    """Colour of a piece of the true path."""
    return palette.NEUTRAL if np.isnan(error) else palette.error_color(error, ERROR_FULL_SCALE_M)


def _quaternions(poses: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_matrix(poses[:, :3, :3]).as_quat())


def _pose_columns(position: np.ndarray, quaternion: np.ndarray, **frames: list[str]) -> Any:
    return rr.Transform3D.columns(translation=position, quaternion=quaternion, **frames)


def _ellipsoid_columns(values: np.ndarray, color: palette.Color) -> Any:
    n = len(values)
    return rr.Ellipsoids3D.columns(
        centers=values[:, :3],
        half_sizes=values[:, 3:6] * ELLIPSOID_SCALE,
        quaternions=values[:, 6:],
        colors=[color] * n,
        line_radii=[-0.8] * n,
        fill_mode=[rr.components.FillMode.MajorWireframe] * n,
    )
