"""What a drive master watches while its drives work: heartbeats, emergencies, statuswords, feedback in time."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Protocol

from drivers.canopen.heartbeat import EXCUSED_TIMEOUTS
from drivers.canopen.nmt import NmtState
from drivers.cia402.axis import AxisClient
from drivers.cia402.phases import AxisPhase, EmergencyMessage, EventKind, error_text
from drivers.cia402.states import State
from drivers.clock import Clock
from drivers.frame import Frame

SUPERVISED = (
    AxisPhase.ENABLED,
    AxisPhase.READY,
    AxisPhase.ENABLING,
    AxisPhase.STOPPING,
    AxisPhase.STOPPED,
    AxisPhase.DISABLING,
)
"""Phases in which a drive is expected to be operational and to answer every SYNC."""

_EXPECTED = {AxisPhase.ENABLED: State.OPERATION_ENABLED, AxisPhase.STOPPED: State.QUICK_STOP_ACTIVE}
"""The state that a drive has to be in when its master leaves it alone."""

_EMERGENCY = struct.Struct("<HB5s")


class Report(Protocol):
    """Where findings go. A failure (see `EventKind.is_failure`) puts the axis into FAULT."""

    def __call__(self, axis: AxisClient, kind: EventKind, text: str, code: int = 0) -> None: ...


class MasterSupervision:
    """Takes heartbeats and emergencies of `axes`, and reports what is wrong, once per outage."""

    def __init__(
        self,
        axes: Iterable[AxisClient],
        clock: Clock,
        report: Report,
        *,
        heartbeat_timeout_ns: int,
        stale_heartbeat_ns: int,
        late_syncs: int,
    ) -> None:
        """`stale_heartbeat_ns`: after an NMT start, heartbeats with another state may still be queued that long."""
        self._axes = tuple(axes)
        self._clock = clock
        self._report = report
        self._heartbeat_timeout_ns = heartbeat_timeout_ns
        self._stale_heartbeat_ns = stale_heartbeat_ns
        self._late_syncs = late_syncs
        self._watched: set[int] = set()

    def on_heartbeat(self, axis: AxisClient, frame: Frame) -> None:
        """Boot-up and heartbeat (700h + node)."""
        if len(frame.data) != 1:
            return
        now_ns = self._clock.now_ns()
        state = frame.data[0] & 0x7F
        axis.heartbeat_ns = now_ns
        if state == NmtState.INITIALISING:
            self._on_boot_up(axis)
        else:
            axis.nmt_state = state
            axis.heard = True
            is_stale = now_ns - axis.started_ns < self._stale_heartbeat_ns
            if state != NmtState.OPERATIONAL and axis.phase in SUPERVISED and not is_stale:
                axis.started = False
                self._report(axis, EventKind.LEFT_OPERATIONAL, f"NMT state {_nmt_name(state)}, not operational", state)
        if axis.node_id not in self._watched:
            self._watched.add(axis.node_id)
            self._watch(axis, now_ns + self._heartbeat_timeout_ns)

    def on_emergency(self, axis: AxisClient, frame: Frame) -> None:
        """EMCY: kept; reported with the fault that the next statusword shows, or as a warning if it shows none."""
        if len(frame.data) != 8:
            return
        code, register, detail = _EMERGENCY.unpack(frame.data)
        message = EmergencyMessage(self._clock.now_ns(), code, register, detail)
        axis.emergencies.append(message)
        if code == 0:
            return
        if axis.phase in SUPERVISED:
            axis.unreported_emergency = message
        else:
            self._report(axis, EventKind.EMERGENCY, emergency_text(message), code)

    def check_status(self, axis: AxisClient) -> None:
        """Looks at the statusword that has just come in; only for axes in a supervised phase."""
        state = axis.state
        emergency = axis.unreported_emergency
        expected = _EXPECTED.get(axis.phase)
        if emergency is None and expected is not None and state is not expected and axis.suspected != axis.statusword:
            axis.suspected = axis.statusword  # bits may turn over on the way: believed when it is said twice
            return
        axis.suspected = None
        if state is State.FAULT or state is State.FAULT_REACTION_ACTIVE:
            last = emergency or _last_error(axis)
            text = "no emergency message" if last is None else emergency_text(last)
            axis.unreported_emergency = None
            self._report(axis, EventKind.DRIVE_FAULT, text, 0 if last is None else last.code)
        elif (axis.phase is AxisPhase.ENABLED and state is not State.OPERATION_ENABLED) or (
            axis.phase is AxisPhase.STOPPED and state is not State.QUICK_STOP_ACTIVE
        ):
            self._report(axis, EventKind.LEFT_ENABLED, f"statusword {axis.statusword:04X}h without being told")
        elif emergency is not None:
            axis.unreported_emergency = None
            self._report(axis, EventKind.EMERGENCY, emergency_text(emergency), emergency.code)

    def on_sync(self) -> None:
        """A SYNC went out: every drive that did not answer the last ones is late."""
        for axis in self._axes:
            if axis.phase in SUPERVISED:
                axis.missed_syncs += 1
                unanswered = axis.missed_syncs - 1  # the answer to this SYNC cannot be there yet
                if unanswered > self._late_syncs:
                    text = f"no TPDO1 for {unanswered} SYNC, NMT state {_nmt_name(axis.nmt_state)}"
                    self._report(axis, EventKind.FEEDBACK_LATE, text)

    def _on_boot_up(self, axis: AxisClient) -> None:
        expected = not axis.heard
        axis.forget()
        axis.heard = True
        axis.nmt_state = NmtState.PRE_OPERATIONAL
        if not expected:
            self._report(
                axis, EventKind.REBOOTED, "boot-up message of a drive at work (or of a second node with its id)"
            )

    def _watch(self, axis: AxisClient, due_ns: int) -> None:
        self._clock.call_at(due_ns, lambda: self._on_heartbeat_due(axis))

    def _on_heartbeat_due(self, axis: AxisClient) -> None:
        now_ns = self._clock.now_ns()
        due_ns = max(axis.heartbeat_ns or 0, axis.started_ns) + self._heartbeat_timeout_ns
        if now_ns - axis.received_ns < self._heartbeat_timeout_ns and axis.statusword is not None:
            due_ns += EXCUSED_TIMEOUTS * self._heartbeat_timeout_ns  # its feedback shows that it is there
        if now_ns < due_ns:
            self._watch(axis, due_ns)
        elif axis.phase is AxisPhase.FAULT or axis.phase in SUPERVISED:
            self._watched.discard(axis.node_id)
            axis.forget()
            axis.heard = False
            axis.nmt_state = None
            self._report(axis, EventKind.HEARTBEAT_LOST, f"none for {self._heartbeat_timeout_ns / 1e6:g} ms")
        else:  # being set up: its heartbeat may still be off
            self._watch(axis, now_ns + self._heartbeat_timeout_ns)


def emergency_text(message: EmergencyMessage) -> str:
    """Code, meaning and error register in words."""
    return f"emergency {message.code:04X}h ({error_text(message.code)}), error register {message.register:02X}h"


def _last_error(axis: AxisClient) -> EmergencyMessage | None:
    """The last emergency, unless the drive has taken it back."""
    last = axis.emergencies[-1] if axis.emergencies else None
    return last if last is not None and last.code else None


def _nmt_name(state: int | None) -> str:
    if state is None:
        return "unknown"
    try:
        return NmtState(state).name.lower().replace("_", "-")
    except ValueError:
        return str(state)
