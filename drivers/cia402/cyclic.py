"""Cyclic data of all axes as arrays: feedback from the wire to SI, targets from SI to the wire."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drivers.cia402.axis import HIGH, LOW, MODE_CSP, OFFSET_HIGH, OFFSET_LOW, AxisClient
from drivers.clock import Clock
from drivers.gate import (
    ACCELERATION_MARGIN,
    JUMP_MARGIN,
    OFFSET_SHARE,
    SET_POINT,
    FrameGate,
    Reason,
    SetPointGate,
    SetPointLimits,
)
from stack.messages import DriveFeedback, Vector

COMMANDS_PER_SYNC = 4
"""Its set point, and what may have to be said in between: a stop, a step of the state machine."""


class CyclicData:
    """(n,) arrays over `axes`, rad or m, N·m or N. `refused` counts commands that the port did not take.

    Every command goes through a gate of its axis; one that it refuses is not sent, and `on_refusal` hears of the first of a row (two set
    points in one period are no more than a count).
    """

    def __init__(
        self,
        axes: tuple[AxisClient, ...],
        clock: Clock,
        send: Callable[[int, bytes], bool],
        period_ns: int,
        on_refusal: Callable[[AxisClient, Reason], None],
    ) -> None:
        self.refused = 0
        self.gates = {axis.node_id: SetPointGate(sender_limits(axis, period_ns)) for axis in axes}
        self.firewall = FrameGate({axis.command_id: SET_POINT.size for axis in axes}, COMMANDS_PER_SYNC)
        self._on_refusal = on_refusal
        self._refusing: set[int] = set()
        self._axes = axes
        self._clock = clock
        self._send = send
        self._period_ns = period_ns
        self._rescale()

    def rescale(self, axis: AxisClient) -> None:
        """The units of an axis may have changed."""
        self.gates[axis.node_id].limits = sender_limits(axis, self._period_ns)
        self._rescale()

    def _rescale(self) -> None:
        self._per_target = 1.0 / np.array([axis.target_scale for axis in self._axes])
        self._per_effort = 1.0 / np.array([axis.effort_scale for axis in self._axes])

    def on_sync(self) -> None:
        """A SYNC was sent: the next set points are those of a new period."""
        now_ns = self._clock.now_ns()
        self.firewall.on_sync()
        for gate in self.gates.values():
            gate.on_sync(now_ns)

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
        """RPDO1 of one axis as it is now, as far as its gate lets it pass."""
        data, reason = self.gates[axis.node_id].judge(axis.command(), axis.follows_planner, self._clock.now_ns())
        if data is None:
            if reason is not None and reason is not Reason.RATE and axis.node_id not in self._refusing:
                self._refusing.add(axis.node_id)
                self._on_refusal(axis, reason)
            return
        if reason is None:
            self._refusing.discard(axis.node_id)
        if self.firewall.judge(axis.command_id, data) is not None:
            self.refused += 1
        elif self._send(axis.command_id, data):
            axis.sent += 1
        else:
            self.refused += 1

    def _refuse(self, targets: Vector, torque_offsets: Vector) -> None:
        for axis, target, offset in zip(self._axes, targets, torque_offsets, strict=True):
            if not (np.isfinite(target) and np.isfinite(offset)):
                raise ValueError(f"{axis.title}: target {target}, torque offset {offset}: both must be finite")


def sender_limits(axis: AxisClient, period_ns: int) -> SetPointLimits:
    """What a drive would bear, from its definition, in the units of its wire: position, velocity, acceleration and torque limits."""
    period_s = period_ns * 1e-9
    lower, upper = axis.limit(0x607D, 1, LOW), axis.limit(0x607D, 2, HIGH)
    velocity, acceleration = axis.setting(0x607F, 0, 0), axis.setting(0x60C5, 0, 0)
    torque = min(axis.limit(0x6072, 0, OFFSET_HIGH), OFFSET_HIGH)
    follows_positions = axis.mode == MODE_CSP
    jump = round(axis.way(JUMP_MARGIN * velocity, period_s)) if follows_positions and velocity else None
    bend = (
        round(axis.way(ACCELERATION_MARGIN * acceleration * period_s, period_s))
        if follows_positions and acceleration
        else None
    )
    if not follows_positions:
        most = axis.limit(0x607F, 0, 0)
        lower, upper = (-most, most) if most else (LOW, HIGH)
    return SetPointLimits(lower, upper, jump, bend, torque, round(OFFSET_SHARE * torque), period_ns)
