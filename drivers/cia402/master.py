"""The master of a set of CiA 402 drives: from power-on to cyclic motion and back, and what goes wrong on the way.

Driven by `on_frame`, `on_sync` and the clock alone. SYNC has to run from the start: drives tell their state on it.
Whatever it finds, it reports and leaves the decision to its owner; it never stops or restarts an axis by itself.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from collections.abc import Sequence as SequenceOf
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from drivers.canopen.nmt import ERROR_CONTROL_BASE, NMT_CAN_ID, NmtCommand, NmtState
from drivers.canopen.sdo_client import REQUEST_BASE, RESPONSE_BASE, SdoClient
from drivers.canopen.sequence import Run, Sequence, SequenceFailure, Sequencer, Until
from drivers.cia402 import power
from drivers.cia402.axis import HIGH, LOW, OFFSET_HIGH, OFFSET_LOW, AxisClient, data_types
from drivers.cia402.configuration import DriveSettings, set_up
from drivers.cia402.master_supervision import SUPERVISED, MasterSupervision, emergency_text
from drivers.cia402.phases import AxisPhase, DriveEvent, EventKind, MasterPhase, phase_of
from drivers.cia402.presence import wait_for_drive
from drivers.clock import Clock
from drivers.frame import Frame
from drivers.objects import DeviceDef
from stack.messages import DriveFeedback, Vector

EMCY_BASE = 0x080
EVENT_LOG_LENGTH = 1000
POWERED = (AxisPhase.ENABLED, AxisPhase.ENABLING, AxisPhase.STOPPED, AxisPhase.STOPPING)


@dataclass(frozen=True, slots=True)
class MasterTimes:
    """How long the master waits for what. `late_syncs`: SYNCs without an answer that are still no failure."""

    boot_ns: int = 30_000_000_000
    boot_report_ns: int = 1_000_000_000
    transition_ns: int = 500_000_000
    stop_ns: int = 5_000_000_000
    sdo_ns: int = 200_000_000
    sdo_attempts: int = 3
    late_syncs: int = 3
    standstill: float = 5e-3
    """rad/s or m/s: at most this is standing."""


@dataclass(slots=True)
class _Lead:
    """An axis, its SDO client, and what is going on with it."""

    axis: AxisClient
    client: SdoClient
    run: Run | None = None


class DriveMaster:
    """Leads the drives of `devices`; the order of all arrays is that of `devices`.

    `send(can_id, data) -> accepted` and `on_frame` connect it with a node's port, `can_ids` says what it has to hear.
    `on_sync` is to be called right after each SYNC was sent. `on_event` gets each event as it happens, and `events`
    keeps the last of them; during a call of `on_event` every method may be used.
    """

    def __init__(
        self,
        devices: Iterable[DeviceDef],
        send: Callable[[int, bytes], bool],
        clock: Clock,
        settings: DriveSettings | None = None,
        times: MasterTimes | None = None,
        on_event: Callable[[DriveEvent], None] | None = None,
    ) -> None:
        self.settings = settings or DriveSettings()
        self.times = times or MasterTimes()
        self.events: deque[DriveEvent] = deque(maxlen=EVENT_LOG_LENGTH)
        self.refused = 0
        """Commands that the port did not take."""
        self._send = send
        self._clock = clock
        self._on_event = on_event
        self._sequencer = Sequencer(clock)
        timeout_ns = self.times.late_syncs * self.settings.sync_period_ns + self.settings.sync_period_ns // 2
        self.axes = tuple(AxisClient(device, timeout_ns) for device in devices)
        self._leads = {axis.node_id: _Lead(axis, self._client(axis)) for axis in self.axes}
        if len(self._leads) != len(self.axes):
            raise ValueError(f"node ids {[axis.node_id for axis in self.axes]}: must differ")
        self._enabling: tuple[AxisClient, ...] = ()
        self._started = False
        self._supervision = MasterSupervision(
            self.axes,
            clock,
            self._report,
            heartbeat_timeout_ns=self.settings.heartbeat_timeout_ms * 1_000_000,
            stale_heartbeat_ns=self.settings.heartbeat_ms * 500_000,
            late_syncs=self.times.late_syncs,
        )
        self._handlers: dict[int, Callable[[Frame], None]] = {}
        for lead in self._leads.values():
            self._listen(lead)
        self._refresh_scales()

    @property
    def can_ids(self) -> frozenset[int]:
        """Identifiers that `on_frame` wants to see; others are ignored."""
        return frozenset(self._handlers)

    @property
    def phase(self) -> MasterPhase:
        """Where the set of axes is: the most urgent phase of any axis (see `phase_of`)."""
        return phase_of({axis.phase for axis in self.axes}) if self._started else MasterPhase.OFF

    def start(self) -> None:
        """Waits for every drive, sets it up, starts it: BOOT, CONFIGURE, READY. Only the first call counts."""
        if not self._started:
            self._started = True
            for lead in self._leads.values():
                failure = EventKind.CONFIGURATION_FAILED
                self._begin(lead, AxisPhase.ABSENT, "start-up", self._start_up(lead.axis), failure, self._set_up_done)

    def enable(self, nodes: Iterable[int] | None = None) -> None:
        """Torque on, from standstill at the present position, for `nodes` (None: all). They end in ENABLED together.

        Raises RuntimeError, naming the drive, unless all of them are READY, STOPPED or already ENABLED.
        """
        leads = self._chosen(nodes)
        for lead in leads:
            if lead.axis.phase not in (AxisPhase.READY, AxisPhase.STOPPED, AxisPhase.ENABLED):
                raise RuntimeError(f"enable: {_title(lead.axis)} is {lead.axis.phase.name}; must be READY or STOPPED")
        self._enabling = tuple(lead.axis for lead in leads)
        for lead in leads:
            if lead.axis.phase is not AxisPhase.ENABLED:
                steps = power.enable(lead.axis, self.times.transition_ns)
                self._begin(lead, AxisPhase.ENABLING, "enabling", steps, EventKind.ENABLE_FAILED, self._enabled)

    def disable(self, nodes: Iterable[int] | None = None) -> None:
        """Torque off, step by step (605Ch, 605Bh); for what should already stand. READY follows. Others stay as they are."""
        for lead in self._chosen(nodes):
            axis = lead.axis
            if axis.phase in POWERED:
                steps = power.disable(axis, self.times.stop_ns)
                self._begin(lead, AxisPhase.DISABLING, "disabling", steps, EventKind.DISABLE_FAILED, self._is_ready)
                self._send_command(axis)
            elif axis.phase is AxisPhase.FAULT:
                self._stop_faulty(axis)

    def quick_stop(self, nodes: Iterable[int] | None = None) -> None:
        """Stops on the drives' own ramp (605Ah), at once and whatever the phase. STOPPED or READY follows when it stands."""
        for lead in self._chosen(nodes):
            axis = lead.axis
            if axis.phase in (AxisPhase.ENABLED, AxisPhase.ENABLING):
                standstill_raw = self.times.standstill * self.settings.sync_period_ns * 1e-9 / axis.position_scale
                steps = power.quick_stop(axis, self.times.stop_ns, standstill_raw, self._stays(axis))
                self._begin(lead, AxisPhase.STOPPING, "quick stop", steps, EventKind.STOP_FAILED, self._stopped)
                self._send_command(axis)
            elif axis.phase is AxisPhase.FAULT:
                self._stop_faulty(axis)

    def reset_faults(self, nodes: Iterable[int] | None = None) -> None:
        """Leads every axis in FAULT back to READY: waits for it, sets it up if it has to be, resets its fault."""
        for lead in self._chosen(nodes):
            if lead.axis.phase is AxisPhase.FAULT:
                steps = self._recover(lead.axis)
                self._begin(lead, AxisPhase.RESETTING, "fault reset", steps, EventKind.RESET_FAILED, self._recovered)

    def on_frame(self, frame: Frame) -> None:
        """Every frame that the node receives, or those of `can_ids`."""
        handler = self._handlers.get(frame.can_id)
        if handler is not None:
            handler(frame)

    def on_sync(self) -> None:
        """A SYNC was sent just now."""
        self._supervision.on_sync()

    def feedback(self) -> tuple[DriveFeedback | None, ...]:
        """Per axis what it last said, in SI units; None where that is missing or too old."""
        now_ns = self._clock.now_ns()
        return tuple([axis.feedback(now_ns) for axis in self.axes])

    def positions(self) -> Vector | None:
        """(n,) positions in rad or m; None as long as any of them is missing or too old."""
        now_ns = self._clock.now_ns()
        for axis in self.axes:
            if axis.statusword is None or now_ns - axis.received_ns > axis.timeout_ns:
                return None
        return np.array([axis.position_raw * axis.position_scale for axis in self.axes])

    def targets(self) -> Vector:
        """(n,) the targets that last went out, SI. From these a new motion starts without a jump."""
        return np.array([axis.target_raw * axis.target_scale for axis in self.axes])

    def send_targets(self, targets: Vector, torque_offsets: Vector) -> None:
        """One command to every axis that has been enabled; the others keep the torque offset for when they will be.

        `targets` (n,): rad, m or (velocity mode) rad/s, m/s; `torque_offsets` (n,): N·m or N. Both are clipped to what
        the wire carries. Raises ValueError for a number that is not finite, naming the axis, before anything is sent.
        """
        raw = targets * self._per_target
        offsets = torque_offsets * self._per_effort
        if not np.isfinite(raw + offsets).all():
            self._refuse(targets, torque_offsets)
        raw_targets = np.rint(np.clip(raw, LOW, HIGH)).astype(np.int64).tolist()
        raw_offsets = np.rint(np.clip(offsets, OFFSET_LOW, OFFSET_HIGH)).astype(np.int64).tolist()
        for axis, target, offset in zip(self.axes, raw_targets, raw_offsets, strict=True):
            axis.offset_raw = offset
            if axis.follows_planner:
                axis.target_raw = target
                self._send_command(axis)

    def _client(self, axis: AxisClient) -> SdoClient:
        return SdoClient(axis.node_id, self._send, self._clock, self.times.sdo_ns, self.times.sdo_attempts)

    def _listen(self, lead: _Lead) -> None:
        axis, node = lead.axis, lead.axis.node_id
        self._handlers[axis.feedback_id] = partial(self._on_feedback, axis)
        if axis.velocity_id is not None:
            self._handlers[axis.velocity_id] = partial(self._on_velocity, axis)
        self._handlers[EMCY_BASE + node] = partial(self._supervision.on_emergency, axis)
        self._handlers[RESPONSE_BASE + node] = partial(self._on_sdo, lead)
        self._handlers[ERROR_CONTROL_BASE + node] = partial(self._on_heartbeat, axis)

    def _on_feedback(self, axis: AxisClient, frame: Frame) -> None:
        if len(frame.data) != 8:
            self._malformed(axis, frame, 8)
            return
        axis.take_feedback(frame.data, self._clock.now_ns())
        if axis.phase in SUPERVISED:
            self._supervision.check_status(axis)
        self._sequencer.poll()
        if axis.started and not axis.follows_planner:
            self._send_command(axis)

    def _on_velocity(self, axis: AxisClient, frame: Frame) -> None:
        if len(frame.data) == 5:
            axis.take_velocity(frame.data, self._clock.now_ns())
        else:
            self._malformed(axis, frame, 5)

    def _on_sdo(self, lead: _Lead, frame: Frame) -> None:
        if lead.client.idle:  # the answer to a question whether anybody is there
            lead.axis.heard = True
            self._sequencer.poll()
        lead.client.on_frame(frame)

    def _on_heartbeat(self, axis: AxisClient, frame: Frame) -> None:
        self._supervision.on_heartbeat(axis, frame)
        self._sequencer.poll()

    def _malformed(self, axis: AxisClient, frame: Frame, length: int) -> None:
        if axis.started and axis.phase in SUPERVISED:
            axis.needs_configuration = True
            text = f"frame {frame.can_id:03X}h with {len(frame.data)} bytes, must be {length}: its mapping was changed"
            self._report(axis, EventKind.FEEDBACK_MALFORMED, text)

    def _send_command(self, axis: AxisClient) -> None:
        if self._send(axis.command_id, axis.command()):
            axis.sent += 1
        else:
            self.refused += 1

    def _command_nmt(self, axis: AxisClient, command: NmtCommand) -> None:
        if not self._send(NMT_CAN_ID, bytes((command, axis.node_id))):
            self.refused += 1

    def _stays(self, axis: AxisClient) -> bool:
        """Whether quick stop ends under torque; 605Ah is 2 (switches off) where a drive does not have it."""
        return int(self.settings.of(axis.device).get((0x605A, 0), 2)) >= 5

    def _stop_faulty(self, axis: AxisClient) -> None:
        """An axis that is out of the master's hands may still move: whatever it hears shall stop it."""
        axis.follows_planner = False
        if axis.started and not power.is_faulty(axis):
            axis.controlword = power.Controlword.QUICK_STOP
            self._send_command(axis)

    def _begin(
        self,
        lead: _Lead,
        phase: AxisPhase,
        name: str,
        steps: Sequence[Any],
        failure: EventKind,
        on_end: Callable[[AxisClient, Any], None],
    ) -> None:
        if lead.run is not None and not lead.run.done:
            lead.run.cancel()
            lead.client.cancel()
        axis = lead.axis
        axis.follows_planner = False
        axis.phase = phase
        run = self._sequencer.start(
            lead.client,
            name,
            steps,
            partial(on_end, axis),
            partial(self._on_failure, axis, failure),
            data_types(axis.device),
        )
        if not run.done:  # else its end may have begun the next one
            lead.run = run

    def _start_up(self, axis: AxisClient) -> Sequence[None]:
        yield from self._await(axis)
        axis.phase = AxisPhase.CONFIGURING
        yield from set_up(axis, self.settings, self._clock, partial(self._command_nmt, axis))

    def _await(self, axis: AxisClient) -> Sequence[None]:
        yield from wait_for_drive(
            axis,
            self._clock,
            self.times.boot_ns,
            self.times.boot_report_ns,
            lambda text: self._report(axis, EventKind.WAITING, text),
            lambda: self._send(REQUEST_BASE + axis.node_id, b"\x40\x00\x10\x00\0\0\0\0"),
        )

    def _recover(self, axis: AxisClient) -> Sequence[None]:
        yield from self._await(axis)
        if axis.needs_configuration or axis.nmt_state != NmtState.OPERATIONAL:
            yield from set_up(axis, self.settings, self._clock, partial(self._command_nmt, axis))
        else:
            axis.statusword = None
            wait_ns = self.settings.answer_timeout_ns
            yield Until(lambda: axis.statusword is not None, wait_ns, "TPDO1 (is SYNC running?)", lambda: "none")
        yield from power.clear_fault(axis, self.times.transition_ns, self.times.stop_ns)
        yield from power.disable(axis, self.times.stop_ns)

    def _set_up_done(self, axis: AxisClient, _: None) -> None:
        self._report(axis, EventKind.CONFIGURED, f"mode {axis.mode}, {_title(axis)}")
        self._is_ready(axis, None)

    def _recovered(self, axis: AxisClient, _: None) -> None:
        axis.causes.clear()
        self._is_ready(axis, None)

    def _is_ready(self, axis: AxisClient, _: None) -> None:
        self._refresh_scales()
        axis.needs_configuration = False
        axis.controlword = power.Controlword.DISABLE_VOLTAGE
        axis.missed_syncs = 0
        axis.unreported_emergency = None
        axis.phase = AxisPhase.READY
        self._supervision.check_status(axis)

    def _enabled(self, axis: AxisClient, _: None) -> None:
        axis.phase = AxisPhase.ENABLED
        if all(other.phase is AxisPhase.ENABLED for other in self._enabling):
            for other in self._enabling:
                other.follows_planner = True

    def _stopped(self, axis: AxisClient, under_torque: bool) -> None:
        if under_torque:
            axis.phase = AxisPhase.STOPPED
        else:
            self._is_ready(axis, None)

    def _on_failure(self, axis: AxisClient, kind: EventKind, failure: SequenceFailure) -> None:
        if kind is EventKind.CONFIGURATION_FAILED and axis.phase is AxisPhase.ABSENT:
            kind = EventKind.BOOT_TIMEOUT
        if kind is not EventKind.DISABLE_FAILED and kind is not EventKind.STOP_FAILED:
            axis.needs_configuration = True
        text = f"{failure.sequence}, {failure.step}: expected {failure.expected}, came {failure.came}"
        self._report(axis, kind, text, failure.code)

    def _report(self, axis: AxisClient, kind: EventKind, text: str, code: int = 0) -> None:
        """One event; a failure ends what was going on with the axis. While it is in FAULT, further causes are only noted."""
        if kind.is_failure:
            lead = self._leads[axis.node_id]
            if lead.run is not None and not lead.run.done:
                lead.run.cancel()
            lead.client.cancel()
            axis.causes.append(text)
            axis.follows_planner = False
            if axis.phase is AxisPhase.FAULT:
                return
            axis.phase = AxisPhase.FAULT
            if power.is_faulty(axis):
                axis.controlword = power.Controlword.DISABLE_VOLTAGE
            emergency, axis.unreported_emergency = axis.unreported_emergency, None
            if emergency is not None and code == 0:
                code = emergency.code
                text = f"{text}; {emergency_text(emergency)}"
        event = DriveEvent(self._clock.now_ns(), axis.node_id, kind, code, f"{_title(axis)}: {kind.value}: {text}")
        self.events.append(event)
        if self._on_event is not None:
            self._on_event(event)

    def _chosen(self, nodes: Iterable[int] | None) -> SequenceOf[_Lead]:
        return list(self._leads.values()) if nodes is None else [self._leads[node] for node in nodes]

    def _refresh_scales(self) -> None:
        self._per_target = 1.0 / np.array([axis.target_scale for axis in self.axes])
        self._per_effort = 1.0 / np.array([axis.effort_scale for axis in self.axes])

    def _refuse(self, targets: Vector, torque_offsets: Vector) -> None:
        for axis, target, offset in zip(self.axes, targets, torque_offsets, strict=True):
            if not (np.isfinite(target) and np.isfinite(offset)):
                raise ValueError(f"{_title(axis)}: target {target}, torque offset {offset}: both must be finite")


def _title(axis: AxisClient) -> str:
    return f"drive {axis.node_id} ({axis.name})"
