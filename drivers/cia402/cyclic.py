"""Cyclic data of all axes as arrays: feedback from the wire to SI, targets from SI to the wire."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drivers.cia402.axis import HIGH, LOW, OFFSET_HIGH, OFFSET_LOW, AxisClient
from drivers.clock import Clock
from stack.messages import DriveFeedback, Vector


class CyclicData:
    """(n,) arrays over `axes`, rad or m, N·m or N. `refused` counts commands that the port did not take."""

    def __init__(self, axes: tuple[AxisClient, ...], clock: Clock, send: Callable[[int, bytes], bool]) -> None:
        self.refused = 0
        self._axes = axes
        self._clock = clock
        self._send = send
        self.rescale()

    def rescale(self) -> None:
        """The units of an axis may have changed."""
        self._per_target = 1.0 / np.array([axis.target_scale for axis in self._axes])
        self._per_effort = 1.0 / np.array([axis.effort_scale for axis in self._axes])

    def feedback(self) -> tuple[DriveFeedback | None, ...]:
        """Per axis what it last said; None where that is missing or too old."""
        now_ns = self._clock.now_ns()
        return tuple([axis.feedback(now_ns) for axis in self._axes])

    def positions(self) -> Vector | None:
        """Positions; None as long as any of them is missing or too old."""
        now_ns = self._clock.now_ns()
        for axis in self._axes:
            if axis.statusword is None or now_ns - axis.received_ns > axis.timeout_ns:
                return None
        return np.array([axis.position_raw * axis.position_scale for axis in self._axes])

    def targets(self) -> Vector:
        """The targets that last went out (velocity mode: rad/s, m/s)."""
        return np.array([axis.target_raw * axis.target_scale for axis in self._axes])

    def send_targets(self, targets: Vector, torque_offsets: Vector) -> None:
        """See `DriveMaster.send_targets`."""
        raw_targets: list[float] = (targets * self._per_target).tolist()
        raw_offsets: list[float] = (torque_offsets * self._per_effort).tolist()
        if not math.isfinite(sum(raw_targets) + sum(raw_offsets)):
            self._refuse(targets, torque_offsets)
        for axis, target, offset in zip(self._axes, raw_targets, raw_offsets, strict=True):
            axis.offset_raw = round(min(max(offset, OFFSET_LOW), OFFSET_HIGH))
            if axis.follows_planner:
                axis.target_raw = round(min(max(target, LOW), HIGH))
                self.send_command(axis)

    def send_command(self, axis: AxisClient) -> None:
        """RPDO1 of one axis as it is now."""
        if self._send(axis.command_id, axis.command()):
            axis.sent += 1
        else:
            self.refused += 1

    def _refuse(self, targets: Vector, torque_offsets: Vector) -> None:
        for axis, target, offset in zip(self._axes, targets, torque_offsets, strict=True):
            if not (np.isfinite(target) and np.isfinite(offset)):
                raise ValueError(f"{axis.title}: target {target}, torque offset {offset}: both must be finite")
