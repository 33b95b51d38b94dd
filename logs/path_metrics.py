"""How well curves were kept to: the platform to the path that it is bound to, the TCP to the commanded path as a curve; and how evenly
joints accelerated. All from the truth of the physics."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from logs.signals import Signal
from stack.messages import Mode, Vector
from stack.planner.platform_path import RelativePath

NEIGHBOURS = 50
"""Cycles before and after, of which the pieces of the commanded path count as near: half a second."""
_MARGIN_NS = 1
_MOVING_M_S, _STANDING_M_S = 0.02, 0.01


def driven_distances(pose_WB: Signal | None) -> tuple[float | None, float | None]:
    """How far (m) the platform drove forwards and how far backwards, by its own x axis; both ≥ 0."""
    if pose_WB is None:
        return None, None
    heading = pose_WB.values[:, :2, 0]
    step = np.diff(pose_WB.values[:, :2, 3], axis=0)
    along = np.sum(step * 0.5 * (heading[1:] + heading[:-1]), axis=1)
    return float(along[along > 0.0].sum()), float(-along[along < 0.0].sum())


def standing_s(pose_WB: Signal | None) -> float | None:
    """How long (s) the platform stood still (below 10 mm/s) between its first and its last motion (above 20 mm/s); 0 if it never moved."""
    if pose_WB is None or len(pose_WB.t_ns) < 2:
        return None
    pose_WB = pose_WB.distinct()
    step_s = np.diff(pose_WB.t_ns) * 1e-9
    speed = np.linalg.norm(np.diff(pose_WB.values[:, :2, 3], axis=0), axis=1) / step_s
    moving = np.flatnonzero(speed > _MOVING_M_S)
    if not len(moving):
        return 0.0
    between = slice(int(moving[0]), int(moving[-1]) + 1)
    return float(step_s[between][speed[between] < _STANDING_M_S].sum())


def platform_path_deviation(
    pose_WB: Signal | None, mission: Signal | None, given: RelativePath | None
) -> tuple[float | None, float | None]:
    """The largest distance (m) of the platform from `given`, and its largest turn (rad) away from the tangent.

    The path lies where the platform stood when the mission first asked for coordination; None where it never did. A platform that turned
    round on its way shows in the second number: it comes near π.
    """
    if pose_WB is None or mission is None or given is None:
        return None, None
    coordinated = np.flatnonzero(mission.values[:, 0] == Mode.COORDINATED)
    if not len(coordinated):
        return None, None
    first = np.searchsorted(pose_WB.t_ns, mission.t_ns[coordinated[0]] + _MARGIN_NS)
    poses = pose_WB.values[first:]
    if not len(poses):
        return None, None
    in_path = _seen_from_path(poses, given)
    s, farthest, most = 0.0, 0.0, 0.0
    for x, y, heading in in_path.tolist():
        s = given.path.closest(x, y, s)
        point = given.path.at(s)
        farthest = max(farthest, math.hypot(x - point.x, y - point.y))
        most = max(most, abs(math.remainder(heading - point.heading, 2.0 * math.pi)))
    return farthest, most


def _seen_from_path(poses: Vector, given: RelativePath) -> Vector:
    """(n, 3): x, y, heading of the poses (n, 4, 4) in the path's frame, which lies relative to the first of them."""
    start, turn = poses[0, :2, 3], math.atan2(poses[0, 1, 0], poses[0, 0, 0])
    cosine, sine = math.cos(turn), math.sin(turn)
    origin = start + np.array([cosine * given.x - sine * given.y, sine * given.x + cosine * given.y])
    angle = turn + given.heading
    axes = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    headings = np.arctan2(poses[:, 1, 0], poses[:, 0, 0]) - angle
    return np.column_stack(((poses[:, :2, 3] - origin) @ axes, headings))


def largest_distance_to_curve(truth: Signal | None, commanded: Signal | None) -> float | None:
    """The largest distance (m) of the true TCP from the commanded path as a curve, whatever the time at which it should have been where.

    Of the path, the pieces of `NEIGHBOURS` cycles on either side count, so that a path that crosses itself does not look better than it is.
    """
    if truth is None or commanded is None or len(commanded) < 2:
        return None
    row = np.searchsorted(truth.t_ns, commanded.t_ns)
    row = row[row < len(truth)]
    points, path = truth.values[row, :3, 3], commanded.values[:, :3]
    begin, way = path[:-1], np.diff(path, axis=0)
    square = np.maximum(np.sum(way * way, axis=1), 1e-18)
    nearest = np.full(len(points), np.inf)
    for shift in range(-NEIGHBOURS, NEIGHBOURS):
        piece = np.clip(np.arange(len(points)) + shift, 0, len(way) - 1)
        to = points - begin[piece]
        share = np.clip(np.sum(to * way[piece], axis=1) / square[piece], 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(to - share[:, None] * way[piece], axis=1))
    return float(nearest.max())


def acceleration_steps(dq: Signal | None, t_ns: tuple[int, int] | None, names: Sequence[str]) -> dict[str, float]:
    """The largest change of each joint's mean acceleration from one cycle to the next (rad/s², m/s²) within `t_ns`, by joint.

    Mean accelerations of cycles are differences of the true velocity; a joint that stops dead at speed v shows v over the cycle's time.
    Empty without samples.
    """
    if dq is None or t_ns is None:
        return {}
    inside = dq.at((dq.t_ns >= t_ns[0]) & (dq.t_ns <= t_ns[1])).distinct()
    if len(inside) < 3:
        return {}
    acceleration = np.diff(inside.values, axis=0) / np.diff(inside.t_s)[:, None]
    return dict(zip(names, np.abs(np.diff(acceleration, axis=0)).max(axis=0).tolist(), strict=True))
