"""How well the true TCP keeps to the commanded path."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from logs.signals import Signal
from stack.messages import Matrix, Vector

_MOVING_M = 1e-5  # steps of the commanded path that are shorter do not tell its direction


class PathTracking:
    """Joins commanded poses with the truth of the time that they are meant for, over any number of blocks.

    The reference frame R of a segment (from the cycle in which references become valid to the one in which they cease to be)
    is placed in the world by the true TCP pose at the segment's first reference: there the error is zero by definition.
    With `world_reference` R is the world itself, as it is for a planner that has TCP feedback: nothing is placed, nothing forgiven.
    """

    def __init__(self, sync_period_ns: int, *, world_reference: bool = False) -> None:
        self._world_reference = world_reference
        self._tolerance_ns = sync_period_ns // 2
        self._waiting: tuple[Signal, Signal] | None = None
        self._truth: Signal | None = None
        self._segment = 0
        self._turn = np.eye(3)
        self._shift = np.zeros(3)
        self._last_position: Vector | None = None
        self._direction = np.zeros(3)

    def add(self, pose: Signal | None, segment: Signal | None, truth: Signal | None) -> dict[str, Signal]:
        """`tcp/error` (n, 3) and `tcp/commanded` (n, 7: position, quaternion xyzw) of all references whose truth is known by now.

        `pose`, `segment`: `reference/pose` and `reference/segment` of a block; `truth`: its `truth/pose_WE`.
        """
        if pose is not None and segment is not None:
            self._waiting = (pose, segment) if self._waiting is None else _join(self._waiting, (pose, segment))
        if truth is not None:
            self._truth = truth if self._truth is None else _joined(self._truth, truth)
        if self._waiting is None or self._truth is None:
            return {}
        poses, segments = self._waiting
        known_until_ns = int(self._truth.t_ns[-1]) + self._tolerance_ns
        known = int(np.searchsorted(poses.t_ns, known_until_ns, "right"))
        self._waiting = (poses.at(slice(known, None)), segments.at(slice(known, None)))
        truth_now = self._truth
        keep_from = int(np.searchsorted(truth_now.t_ns, known_until_ns - 8 * self._tolerance_ns))
        self._truth = truth_now.at(slice(keep_from, None))
        return self._compare(poses.at(slice(0, known)), segments.values[:known, 0].astype(np.int64), truth_now)

    def _compare(self, pose: Signal, segment: np.ndarray, truth: Signal) -> dict[str, Signal]:
        row = np.searchsorted(truth.t_ns, pose.t_ns - self._tolerance_ns)  # first sample that is not too early
        row = np.minimum(row, len(truth) - 1)
        matched = np.abs(truth.t_ns[row] - pose.t_ns) <= self._tolerance_ns
        pose, segment, row = pose.at(matched), segment[matched], row[matched]
        if not len(pose):
            return {}
        true_position, true_turn = truth.values[row, :3, 3], truth.values[row, :3, :3]
        turn_R = Rotation.from_rotvec(pose.values[:, 3:6]).as_matrix()
        commanded, turn_W = np.empty((len(pose), 3)), np.empty((len(pose), 3, 3))
        for number in np.unique(segment).tolist():
            rows = np.flatnonzero(segment == number)
            if number != self._segment and not self._world_reference:
                first = rows[0]
                self._turn = true_turn[first] @ turn_R[first].T
                self._shift = true_position[first] - self._turn @ pose.values[first, :3]
            self._segment = number
            commanded[rows] = pose.values[rows, :3] @ self._turn.T + self._shift
            turn_W[rows] = self._turn @ turn_R[rows]
        error = true_position - commanded
        directions = self._directions(commanded)
        along = np.sum(error * directions, axis=1, keepdims=True) * directions
        turned = Rotation.from_matrix(np.swapaxes(turn_W, 1, 2) @ true_turn).magnitude()
        columns = [np.linalg.norm(error, axis=1), np.linalg.norm(error - along, axis=1), turned]
        t_ns = truth.t_ns[row]
        poses = np.hstack([commanded, Rotation.from_matrix(turn_W).as_quat()])
        return {"tcp/error": Signal(t_ns, np.column_stack(columns)), "tcp/commanded": Signal(t_ns, poses)}

    def _directions(self, commanded: Matrix) -> Matrix:
        """Unit direction of the commanded path in each row, the last one known where it stands still, 0 before it first moves."""
        before = commanded[:1] if self._last_position is None else self._last_position[None]
        step = np.diff(np.vstack([before, commanded]), axis=0)
        length = np.linalg.norm(step, axis=1)
        directions = np.vstack([self._direction, step / np.maximum(length, 1e-12)[:, None]])
        latest = np.maximum.accumulate(np.where(np.append(True, length > _MOVING_M), np.arange(len(directions)), 0))
        self._last_position, self._direction = commanded[-1], directions[latest[-1]]
        return directions[latest[1:]]


def _joined(first: Signal, second: Signal) -> Signal:
    return Signal(np.concatenate([first.t_ns, second.t_ns]), np.concatenate([first.values, second.values]))


def _join(first: tuple[Signal, Signal], second: tuple[Signal, Signal]) -> tuple[Signal, Signal]:
    return _joined(first[0], second[0]), _joined(first[1], second[1])
