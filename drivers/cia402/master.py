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

from drivers.canopen.pacer import Pacer
from drivers.canopen.sdo_client import SdoClient
from drivers.canopen.sequence import Run, Sequence, SequenceFailure, Sequencer
from drivers.cia402 import power
from drivers.cia402.axis import AxisClient, data_types
from drivers.cia402.bring_up import BringUp, MasterTimes
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.cyclic import CyclicData
from drivers.cia402.hearing import Hearing
from drivers.cia402.master_supervision import SUPERVISED, MasterSupervision, emergency_text
from drivers.cia402.phases import AxisPhase, DriveEvent, EventKind, MasterPhase, phase_of
from drivers.clock import Clock
from drivers.frame import Frame
from drivers.gate import Reason
from drivers.objects import DeviceDef
from stack.messages import DriveFeedback, Vector

EVENT_LOG_LENGTH = 1000
STALE_SYNCS = 3
"""SYNCs without an answer after which what an axis said last is not passed on any more."""
POWERED = (AxisPhase.ENABLED, AxisPhase.ENABLING, AxisPhase.STOPPED, AxisPhase.STOPPING)


@dataclass(slots=True)
class _Lead:
    """An axis, its SDO client, and what is going on with it."""

    axis: AxisClient
    client: SdoClient
    run: Run | None = None
    group: tuple[AxisClient, ...] = ()
    """Axes that were asked to be enabled together with this one."""


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
        self._send = send
        self._pacer = Pacer(send, clock, self.settings.sdo_gap_ns)
        self._clock = clock
        self._on_event = on_event
        self._sequencer = Sequencer(clock)
        timeout_ns = STALE_SYNCS * self.settings.sync_period_ns + self.settings.sync_period_ns // 2
        self.axes = tuple(AxisClient(device, timeout_ns, self.settings.sync_period_ns) for device in devices)
        self._leads = {axis.node_id: _Lead(axis, self._client(axis)) for axis in self.axes}
        if len(self._leads) != len(self.axes):
            raise ValueError(f"node ids {[axis.node_id for axis in self.axes]}: must differ")
        self._started = False
        self._supervision = MasterSupervision(
            self.axes,
            clock,
            self._report,
            heartbeat_timeout_ns=self.settings.heartbeat_timeout_ms * 1_000_000,
            stale_heartbeat_ns=self.settings.heartbeat_ms * 500_000,
            late_syncs=self.times.late_syncs,
        )
        self._bring_up = BringUp(self.settings, self.times, clock, send, self._report)
        self._cyclic = CyclicData(self.axes, clock, send, self.settings.sync_period_ns, self._on_refusal)
        self._hearing = Hearing(clock, self._sequencer, self._supervision, self._cyclic, self._report)
        for lead in self._leads.values():
            self._hearing.listen(lead.axis, lead.client)

    @property
    def can_ids(self) -> frozenset[int]:
        """Identifiers that `on_frame` wants to see; others are ignored."""
        return self._hearing.can_ids

    @property
    def phase(self) -> MasterPhase:
        """Where the set of axes is: the most urgent phase of any axis (see `phase_of`)."""
        return phase_of([axis.phase for axis in self.axes]) if self._started else MasterPhase.OFF

    def start(self) -> None:
        """Waits for every drive, sets it up, starts it: BOOT, CONFIGURE, READY. Only the first call counts."""
        if not self._started:
            self._started = True
            for lead in self._leads.values():
                failure = EventKind.CONFIGURATION_FAILED
                self._begin(
                    lead, AxisPhase.ABSENT, "start-up", self._bring_up.start_up(lead.axis), failure, self._set_up_done
                )

    def enable(self, nodes: Iterable[int] | None = None) -> None:
        """Torque on, from standstill at the present position, for `nodes` (None: all). They end in ENABLED together.

        Raises RuntimeError, naming the drive, unless all of them are READY, STOPPED or already ENABLED.
        """
        leads = self._chosen(nodes)
        for lead in leads:
            if lead.axis.phase not in (AxisPhase.READY, AxisPhase.STOPPED, AxisPhase.ENABLED):
                raise RuntimeError(f"enable: {lead.axis.title} is {lead.axis.phase.name}; must be READY or STOPPED")
        group = tuple(lead.axis for lead in leads)
        for lead in leads:
            lead.group = group
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
                self._cyclic.send_command(axis)
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
                self._cyclic.send_command(axis)
            elif axis.phase is AxisPhase.FAULT:
                self._stop_faulty(axis)

    def reset_faults(self, nodes: Iterable[int] | None = None) -> None:
        """Leads every axis in FAULT back to READY: waits for it, sets it up if it has to be, resets its fault."""
        for lead in self._chosen(nodes):
            if lead.axis.phase is AxisPhase.FAULT:
                steps = self._bring_up.recover(lead.axis)
                self._begin(lead, AxisPhase.RESETTING, "fault reset", steps, EventKind.RESET_FAILED, self._recovered)

    def on_frame(self, frame: Frame) -> None:
        """Every frame that the node receives, or those of `can_ids`."""
        self._hearing.on_frame(frame)

    def on_sync(self) -> None:
        """A SYNC was sent just now."""
        self._supervision.on_sync()
        self._cyclic.on_sync()

    def feedback(self) -> tuple[DriveFeedback | None, ...]:
        """Per axis what it last said, in SI units; None where that is missing or too old."""
        return self._cyclic.feedback()

    def positions(self) -> Vector | None:
        """(n,) positions in rad or m; None as long as any of them is missing or too old."""
        return self._cyclic.positions()

    def targets(self) -> Vector:
        """(n,) the targets that last went out, SI. From these a new motion starts without a jump."""
        return self._cyclic.targets()

    def send_targets(self, targets: Vector, torque_offsets: Vector) -> None:
        """One command to every axis that has been enabled; the others keep the torque offset for when they will be.

        `targets` (n,): rad, m or (velocity mode) rad/s, m/s; `torque_offsets` (n,): N·m or N. Both are clipped to what
        the wire carries. Raises ValueError for a number that is not finite, naming the axis, before anything is sent.
        """
        self._cyclic.send_targets(targets, torque_offsets)

    @property
    def refused(self) -> int:
        """Commands that the port did not take."""
        return self._cyclic.refused

    @property
    def gate_counts(self) -> dict[Reason, int]:
        """What the gates before the sender found, over all axes."""
        gates = self._cyclic.gates.values()
        return {reason: sum(gate.counts.by_reason[reason] for gate in gates) for reason in Reason}

    def _on_refusal(self, axis: AxisClient, reason: Reason) -> None:
        self._report(axis, EventKind.GATE, f"not sent: {reason.name.lower()}", int(reason))

    def _client(self, axis: AxisClient) -> SdoClient:
        return SdoClient(axis.node_id, self._pacer.send, self._clock, self.times.sdo_ns, self.times.sdo_attempts)

    def _stays(self, axis: AxisClient) -> bool:
        """Whether quick stop ends under torque; 605Ah is 2 (switches off) where a drive does not have it."""
        key = (0x605A, 0)
        return int(axis.kept.get(key, self.settings.of(axis.device).get(key, 2))) >= 5

    def _stop_faulty(self, axis: AxisClient) -> None:
        """An axis that is out of the master's hands may still move: whatever it hears shall stop it."""
        axis.follows_planner = False
        if axis.started and not power.is_faulty(axis):
            axis.controlword = power.Controlword.QUICK_STOP
            self._cyclic.send_command(axis)

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

    def _set_up_done(self, axis: AxisClient, _: None) -> None:
        self._make_ready(axis)
        self._report(axis, EventKind.CONFIGURED, f"mode {axis.mode}")
        if axis.phase in SUPERVISED:
            self._supervision.check_status(axis)

    def _recovered(self, axis: AxisClient, _: None) -> None:
        axis.causes.clear()
        self._is_ready(axis, None)

    def _is_ready(self, axis: AxisClient, _: None) -> None:
        self._make_ready(axis)
        self._supervision.check_status(axis)

    def _make_ready(self, axis: AxisClient) -> None:
        self._cyclic.rescale(axis)
        axis.needs_configuration = False
        axis.controlword = power.Controlword.DISABLE_VOLTAGE
        axis.missed_syncs = 0
        axis.unreported_emergency = None
        axis.phase = AxisPhase.READY

    def _enabled(self, axis: AxisClient, _: None) -> None:
        axis.phase = AxisPhase.ENABLED
        group = self._leads[axis.node_id].group
        if all(other.phase is AxisPhase.ENABLED for other in group):
            for other in group:
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
        event = DriveEvent(self._clock.now_ns(), axis.node_id, kind, code, f"{axis.title}: {kind.value}: {text}")
        self.events.append(event)
        if self._on_event is not None:
            self._on_event(event)

    def _chosen(self, nodes: Iterable[int] | None) -> SequenceOf[_Lead]:
        return list(self._leads.values()) if nodes is None else [self._leads[node] for node in nodes]
