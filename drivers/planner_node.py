"""The local planner on the bus: SYNC producer, NMT and drive master, one planner step per SYNC.

A cycle: SYNC k goes out, ten drives answer, the planner computes as soon as all have (or at the deadline, with what is there), its set
points are on the wire before SYNC k + 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from drivers.bridge import Bridge
from drivers.bus.base import Bus
from drivers.canopen.nmt import ERROR_CONTROL_BASE, NMT_CAN_ID, NmtCommand, NmtState
from drivers.canopen.node import CanopenNode, NodeApplication
from drivers.cia402.bench import BenchDrive
from drivers.cia402.bring_up import MasterTimes
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.gate_keeper import GATE_MARGIN, GATE_MARGIN_PER_MILLE, has_gate
from drivers.cia402.master import DriveMaster
from drivers.cia402.phases import DriveEvent, EventKind, MasterPhase
from drivers.clock import Clock, Timer
from drivers.codec import JOINT_REFERENCE, MISSION, PLANNER_STATE, REFERENCE, TRACKED_POSE, TWIST, ReferencePose
from drivers.frame import Frame
from drivers.objects import DeviceDef
from drivers.planner_objects import PlannerObjects
from drivers.publisher import Publisher, receive
from drivers.singularity_watch import SingularityWatch
from drivers.slip_watch import SlipWatch
from stack.messages import JointReference, Mode, PlannerPhase, TrackedPose
from stack.messages import PlannerState as StateMessage
from stack.planner.drift import DriftEstimate
from stack.planner.parameters import PlannerParameters
from stack.planner.planner import Planner, PlannerInputs, PlannerOutputs, PlannerState
from stack.planner.tracking import rotation_vector

WHEELS = 2
MISSION_TIMEOUT_NS = 150_000_000
STANDSTILL = 2e-2
"""Joint velocity (rad/s, m/s) and platform rate below which the robot counts as at rest when it is to be switched off."""
_STOP_LIMIT_NS = 3_000_000_000
_STAY_OPERATIONAL = 1
"""Value of 1029h:1 (CiA 301, error behaviour)."""

OnEvent = Callable[[str, str], None]
"""(level, text) with level info, warning or error."""


class PlannerNode(NodeApplication):
    """Node 2. `drives`: the ten drives in node order, wheels first. `others`: further nodes that it starts by NMT.

    `bench`: drives that are not those of the table, by node id.
    `stopwatch` (ns) is only used to fill `cycle_ns`, the time that each step took; nothing depends on it.
    """

    def __init__(
        self,
        device: DeviceDef,
        drives: Sequence[DeviceDef],
        others: Sequence[int],
        clock: Clock,
        bus: Bus,
        planner: Planner,
        parameters: PlannerParameters,
        on_event: OnEvent,
        stopwatch: Callable[[], int] | None = None,
        sdo_gap_ns: int = 0,
        times: MasterTimes | None = None,
        bench: Mapping[int, BenchDrive] | None = None,
    ) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self.cycle_ns: list[int] = []
        self.cycles = 0
        self.platform_cycles = 0
        self.incomplete_cycles = 0
        self.phase = PlannerPhase.BOOT
        self.outputs: PlannerOutputs | None = None
        self._clock = clock
        self._planner = planner
        self._on_event = on_event
        self._stopwatch = stopwatch
        self._state = PlannerState(DriftEstimate())
        self._objects = PlannerObjects(self.node, parameters, lambda: self)
        self._period_ns = parameters.arm_period_ns
        self._stopping_since_ns: int | None = None
        self._acknowledgeable = False
        self._sync_ns = self._last_sync_ns = 0
        self._sync_count = self._period_count = 0
        self._answered = 0
        self._deadline: Timer | None = None
        self._commanded = self._followed = 0.0
        gates = {device.node_id: {GATE_MARGIN: GATE_MARGIN_PER_MILLE} for device in drives if has_gate(device)}
        settings = DriveSettings(
            sync_period_ns=self._period_ns, sdo_gap_ns=sdo_gap_ns, parameters=gates, bench=bench or {}
        )
        self.master = DriveMaster(drives, self.node.line.send, clock, settings, times, self._on_drive_event)
        self._bridge = Bridge(len(drives) - WHEELS)
        self._targets, self._efforts = np.zeros(len(drives)), np.zeros(len(drives))
        self._feedback_ids = frozenset(axis.feedback_id for axis in self.master.axes)
        for can_id in sorted(self.master.can_ids):
            self.node.subscribe(can_id, self._on_answer if can_id in self._feedback_ids else self.master.on_frame)
        self._twist = receive(self.node, TWIST)
        self._mission = receive(self.node, MISSION)
        self._tracked = receive(self.node, TRACKED_POSE)
        self._joints = receive(self.node, JOINT_REFERENCE)
        self._state_out = Publisher(self.node, PLANNER_STATE)
        self._reference_out = Publisher(self.node, REFERENCE)
        self._singularities = SingularityWatch(self.node, planner.arm)
        self._slip = SlipWatch(self.node, on_event)
        for node_id in others:
            self.node.subscribe(ERROR_CONTROL_BASE + node_id, self._on_other_heartbeat)

    @property
    def parameters(self) -> PlannerParameters:
        """Those in force, as written by SDO."""
        return self._objects.parameters

    def power_on(self) -> None:
        """Boots, begins to send SYNC and to look for its drives."""
        self.node.power_on()
        self.node.dictionary.entry(0x1006).store(self._period_ns // 1000)
        # A strategic node that has fallen silent is no reason to leave the drives alone: the planner stops and stays on the bus.
        self.node.dictionary.entry(0x1029, 1).store(_STAY_OPERATIONAL)
        self.node.start()
        self.master.start()

    def on_reset(self, whole: bool) -> None:
        if whole:
            self._objects.restore()

    def on_sync(self, counter: int | None) -> None:
        """The node's own SYNC was given to the bus."""
        if self._deadline is not None:
            self._compute(complete=False)
        self._last_sync_ns, self._sync_ns = self._sync_ns, self._clock.now_ns()
        self._sync_count = (self._sync_count + 1) & 0xFFFF
        passed = self._sync_ns // self._period_ns - self._last_sync_ns // self._period_ns if self._last_sync_ns else 1
        self._period_count = (self._period_count + max(1, passed)) & 0xFFFF  # a SYNC that was left out has its number
        self._answered = 0
        self.master.on_sync()
        self._deadline = self._clock.call_at(self._sync_ns + self._period_ns * 6 // 10, self._on_deadline)

    def _on_answer(self, frame: Frame) -> None:
        self.master.on_frame(frame)
        self._answered += 1
        if self._answered == len(self.master.axes) and self._deadline is not None:
            self._compute(complete=True)

    def _on_deadline(self) -> None:
        self._compute(complete=False)

    def _on_other_heartbeat(self, frame: Frame) -> None:
        """A node that serves the stack has booted, or was found waiting: start it."""
        waiting = (0, NmtState.PRE_OPERATIONAL)
        if len(frame.data) == 1 and frame.data[0] in waiting and self.node.nmt.operational:
            self.node.line.send(NMT_CAN_ID, bytes((NmtCommand.START, frame.can_id - ERROR_CONTROL_BASE)))

    def _compute(self, *, complete: bool) -> None:
        """One planner step and everything that it sends."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        if not self.node.nmt.operational:
            return
        begin = self._stopwatch() if self._stopwatch is not None else 0
        self.cycles += 1
        self.incomplete_cycles += not complete and self.phase >= PlannerPhase.READY
        parameters = self._objects.parameters
        self._state, outputs = self._planner.step(self._state, self._inputs(parameters), parameters)
        self.outputs = outputs
        self.platform_cycles += outputs.platform_cycle
        self._progress(outputs)
        self._send(outputs)
        self._slip.update(self._state.drift)
        # In the cycle before a platform cycle: as often, and what both cost does not add up.
        if parameters.platform_cycle_due(self._state.cycle + 1):
            self._singularities.update(outputs.q, self._sync_count)
            self._slip.publish(self._sync_count)
        if self._stopwatch is not None:
            self.cycle_ns.append(self._stopwatch() - begin)

    def _progress(self, outputs: PlannerOutputs) -> None:
        """Commanded way and what of it was let through (path scale), for `path_progress`."""
        if self.phase is PlannerPhase.EXECUTING:
            way = math.hypot(*self._state.command.twist[:3].tolist())
            self._commanded += way
            self._followed += way * outputs.arm.scale

    @property
    def path_progress(self) -> float | None:
        """Share of the commanded way that the path scale let through; None before anything was commanded."""
        return self._followed / self._commanded if self._commanded > 0.0 else None

    def _inputs(self, parameters: PlannerParameters) -> PlannerInputs:
        """What this cycle has: positions of this SYNC only, twist while it is fresh, a tracked pose once."""
        sync_ns = self._sync_ns
        positions = [
            axis.position_raw * axis.position_scale
            if axis.received_ns >= sync_ns and axis.statusword is not None
            else None
            for axis in self.master.axes
        ]
        left, right, *joints = positions
        outputs = self.outputs
        moved = np.zeros(len(joints)) if outputs is None else outputs.dq * (self._period_ns * 1e-9)
        twist = self._twist.fresh(parameters.twist_timeout_ns)
        return PlannerInputs(
            t_ns=self._sync_ns,
            mode=self._mode(),
            q=self._bridge.update(joints, moved),
            wheels=None if left is None or right is None else (left, right),
            twist=None if twist is None else twist.twist,
            tracked=self._aged(),
            joints=self._new_joints(),
        )

    def _new_joints(self) -> tuple[JointReference, int] | None:
        """A joint reference that came since the last cycle, with when it did."""
        reference: JointReference | None = self._joints.take()
        return None if reference is None else (reference, self._joints.received_ns)

    def _aged(self) -> TrackedPose | None:
        """A tracked pose that came since the last cycle. Its age is that at the SYNC after which it was sent; here, at this cycle's."""
        tracked: TrackedPose | None = self._tracked.take()
        if tracked is None or self._tracked.received_ns >= self._sync_ns:
            return tracked
        return replace(tracked, age_ns=tracked.age_ns + self._sync_ns - self._last_sync_ns)

    def _mode(self) -> Mode:
        """The mode that the mission asks for, as far as the drives allow it; runs the phases on the way."""
        mission = self._mission.fresh(MISSION_TIMEOUT_NS)
        wanted = Mode.OFF if mission is None else mission.mode
        phase = self._next_phase(wanted, lost=mission is None)
        if phase is not self.phase:
            self._on_event("error" if phase is PlannerPhase.FAULT else "info", f"{self.phase.name} → {phase.name}")
            self.phase = phase
        if phase is PlannerPhase.EXECUTING:
            return wanted
        return Mode.HOLD if phase in (PlannerPhase.IDLE, PlannerPhase.STOPPING) else Mode.OFF

    def _next_phase(self, wanted: Mode, *, lost: bool) -> PlannerPhase:
        master = self.master.phase
        if master in (MasterPhase.ENABLED,):
            if self.phase is PlannerPhase.STOPPING:
                return self._stopped_yet(wanted)
            if wanted is Mode.OFF:
                self._stopping_since_ns = self._sync_ns
                if lost:
                    self._on_event("warning", "the strategic node has fallen silent: stops and switches off")
                return PlannerPhase.STOPPING
            return PlannerPhase.IDLE if wanted is Mode.HOLD else PlannerPhase.EXECUTING
        if master is MasterPhase.READY and wanted is not Mode.OFF and self.phase is not PlannerPhase.FAULT:
            self.master.enable()
            return PlannerPhase.ENABLING
        if master is MasterPhase.FAULT:
            self._listen_for_acknowledgement(wanted, lost=lost)
        return _PHASE_OF[master]

    def _listen_for_acknowledgement(self, wanted: Mode, *, lost: bool) -> None:
        """A mission that asks for OFF, and then for HOLD, knows of the fault: drives are led back to READY, and enabled where they are."""
        if wanted is Mode.OFF:
            self._acknowledgeable = not lost
        elif wanted is Mode.HOLD and self._acknowledgeable:
            self._acknowledgeable = False
            self._on_event("info", "acknowledged: resets the drives' faults")
            self.master.reset_faults()

    def _stopped_yet(self, wanted: Mode) -> PlannerPhase:
        """At rest (or out of patience): torque off."""
        assert self._stopping_since_ns is not None
        outputs = self.outputs
        moving = outputs is not None and (
            float(np.abs(outputs.dq).max()) > STANDSTILL or max(map(abs, outputs.platform.rate)) > STANDSTILL
        )
        if moving and self._sync_ns - self._stopping_since_ns < _STOP_LIMIT_NS:
            return PlannerPhase.STOPPING
        self.master.disable()
        return PlannerPhase.READY

    def _send(self, outputs: PlannerOutputs) -> None:
        self._targets[:WHEELS], self._targets[WHEELS:] = outputs.wheels, outputs.q
        self._efforts[WHEELS:] = outputs.effort
        self.master.send_targets(self._targets, self._efforts)
        counter = self._sync_count & 0xFF
        self._state_out.publish(
            StateMessage(self.phase, int(outputs.arm.status), outputs.restrictions, outputs.arm.scale, counter)
        )
        pose = outputs.X_RE if outputs.X_RE is not None else outputs.T_RE
        self._reference_out.publish(
            ReferencePose(pose[:3, 3], rotation_vector(pose), outputs.X_RE is not None, self._period_count, counter)
        )

    def _on_drive_event(self, event: DriveEvent) -> None:
        failure = event.kind.is_failure
        level = "warning" if event.kind is EventKind.NOTED else "info"
        self._on_event("error" if failure else level, event.text)
        if failure and self.phase >= PlannerPhase.ENABLING:
            self.master.quick_stop()


_PHASE_OF = {
    MasterPhase.OFF: PlannerPhase.BOOT,
    MasterPhase.BOOT: PlannerPhase.BOOT,
    MasterPhase.CONFIGURE: PlannerPhase.CONFIGURE,
    MasterPhase.READY: PlannerPhase.READY,
    MasterPhase.ENABLING: PlannerPhase.ENABLING,
    MasterPhase.STOPPING: PlannerPhase.STOPPING,
    MasterPhase.STOPPED: PlannerPhase.STOPPING,
    MasterPhase.DISABLING: PlannerPhase.STOPPING,
    MasterPhase.RESETTING: PlannerPhase.FAULT,
    MasterPhase.FAULT: PlannerPhase.FAULT,
}
