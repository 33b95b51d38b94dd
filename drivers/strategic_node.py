"""The strategic layer on the bus: twist and mission frames at 50 Hz, the planner's dictionary by SDO."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivers.bus.base import Bus
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode, NodeApplication
from drivers.canopen.sdo_client import RESPONSE_BASE, SdoClient
from drivers.canopen.sequence import Download, Sequence, SequenceFailure, Sequencer, Until, Upload
from drivers.clock import Clock
from drivers.codec import (
    GRIPPER_STATE,
    JOINT_REFERENCE,
    MISSION,
    PLANNER_STATE,
    REFERENCE,
    SINGULARITY,
    TWIST,
    WRENCH,
    ReferencePose,
)
from drivers.frame import Frame
from drivers.objects import DeviceDef
from drivers.publisher import Publisher, receive
from drivers.tables.planner import CONFIGURATION, TCP_ROTATION_VECTOR
from stack.kinematics.se3 import rotation_exp
from stack.messages import (
    GripperPhase,
    GripperState,
    JointReference,
    Matrix,
    MissionCommand,
    PlannerState,
    SingularityReport,
    TwistCommand,
    Vector,
    Wrench,
)
from stack.strategic.mission import Mission, MissionInputs, MissionOutputs, MissionState, Stage
from stack.strategic.motion import CYCLE_NS, ParameterWrite

STATE_TIMEOUT_NS = 200_000_000
REFERENCE_TIMEOUT_NS = 100_000_000
WRENCH_TIMEOUT_NS = 50_000_000
GRIPPER_TIMEOUT_NS = 200_000_000
SDO_TIMEOUT_NS = 100_000_000
SDO_ATTEMPTS = 8
OnEvent = Callable[[str], None]


class StrategicNode(NodeApplication):
    """Runs a mission. `stage` says where it is, `on_event` hears its milestones in words."""

    def __init__(
        self, device: DeviceDef, planner: DeviceDef, clock: Clock, bus: Bus, mission: Mission, on_event: OnEvent
    ) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._clock = clock
        self._mission = mission
        self._state = MissionState()
        self._on_event = on_event
        self.found: dict[str, float] = {}
        """What the steps of the mission have measured, by name."""
        self._counter = 0
        self._running = False
        self._writes_done = False
        self._rotation_RE: Matrix | None = None
        self._q: Vector | None = None
        self._failure: str | None = None
        self._telling: tuple[ParameterWrite, ...] | None = None
        """What the planner is being told in mid-step."""
        self._twist = Publisher(self.node, TWIST)
        self._command = Publisher(self.node, MISSION)
        self._joints = Publisher(self.node, JOINT_REFERENCE)
        self._planner = receive(self.node, PLANNER_STATE)
        self._reference = receive(self.node, REFERENCE)
        self._wrench = receive(self.node, WRENCH)
        self._singularity = receive(self.node, SINGULARITY)
        self._gripper = receive(self.node, GRIPPER_STATE)
        self._types = {entry.key: entry.data_type for entry in planner.objects}
        self._sequencer = Sequencer(clock)
        self._client = SdoClient(planner.node_id, self.node.line.send, clock, SDO_TIMEOUT_NS, SDO_ATTEMPTS)
        self.node.subscribe(RESPONSE_BASE + planner.node_id, self._on_response)

    @property
    def stage(self) -> Stage:
        return self._state.stage

    @property
    def planner_state(self) -> PlannerState | None:
        """What the planner said last, None when that is too long ago."""
        return self._planner.fresh(STATE_TIMEOUT_NS)

    def on_nmt_state(self, state: NmtState) -> None:
        operational = state is NmtState.OPERATIONAL
        if operational and not self._running:
            self._clock.call_at((self._clock.now_ns() // CYCLE_NS + 1) * CYCLE_NS, self._cycle)
        self._running = operational

    def _cycle(self) -> None:
        """One strategic cycle, on multiples of its period."""
        if not self._running:
            return
        now_ns = self._clock.now_ns()
        self._clock.call_at(now_ns + CYCLE_NS, self._cycle)
        before = self._state.stage
        self._state, outputs = self._mission.step(self._state, self._inputs(now_ns))
        if self._state.stage is Stage.PREPARING and before is not Stage.PREPARING:
            self._writes_done = False
            self._run("write the planner's parameters", self._write(outputs.writes))
        elif outputs.writes and self._telling is None:
            self._telling = outputs.writes
            self._run("tell the planner what was found", self._tell(outputs.writes))
        if outputs.read_orientation:
            self._rotation_RE = self._q = None
            self._run("read where the arm is", self._locate(outputs.read_joints))
        self._publish(outputs)
        self.found.update(outputs.found)
        if outputs.event is not None:
            self._on_event(outputs.event)

    def _inputs(self, now_ns: int) -> MissionInputs:
        reference: ReferencePose | None = self._reference.fresh(REFERENCE_TIMEOUT_NS)
        wrench: Wrench | None = self._wrench.fresh(WRENCH_TIMEOUT_NS)
        margins: SingularityReport | None = self._singularity.fresh(STATE_TIMEOUT_NS)
        gripper: GripperState | None = self._gripper.fresh(GRIPPER_TIMEOUT_NS)
        return MissionInputs(
            now_ns,
            self.planner_state,
            self._writes_done,
            self._rotation_RE,
            self._failure,
            self._q,
            X_RE=_pose(reference) if reference is not None and reference.valid else None,
            wrench=None if wrench is None else wrench.wrench,
            grasped=None if gripper is None else gripper.phase is GripperPhase.HOLDING,
            singularity_margin=None if margins is None else margins.margins[0],
        )

    def _publish(self, outputs: MissionOutputs) -> None:
        self._counter = (self._counter + 1) & 0xFF
        self._twist.publish(TwistCommand(outputs.twist, self._counter))
        self._command.publish(MissionCommand(outputs.mode, outputs.step, self._counter, outputs.gripper))
        if outputs.joints is not None:
            self._joints.publish(JointReference(outputs.joints, self._counter))

    def _write(self, writes: tuple[ParameterWrite, ...]) -> Sequence[None]:
        """Between two steps: the mission waits for it."""
        if self._telling is not None:
            yield Until(lambda: self._telling is None, SDO_TIMEOUT_NS * SDO_ATTEMPTS, "what is being told")
        for write in writes:
            yield self._download(write)
        self._writes_done = True

    def _tell(self, writes: tuple[ParameterWrite, ...]) -> Sequence[None]:
        """While a step goes on."""
        for write in writes:
            yield self._download(write)
        self._telling = None

    def _download(self, write: ParameterWrite) -> Download:
        integer = self._types[write.index, write.subindex].is_integer
        return Download(write.index, write.subindex, int(write.value) if integer else float(write.value))

    def _locate(self, joints: bool) -> Sequence[None]:
        vector = np.empty(3)
        for axis in range(3):
            vector[axis] = yield Upload(TCP_ROTATION_VECTOR, axis + 1)
        if joints:
            q = np.empty(JOINTS)
            for joint in range(JOINTS):
                q[joint] = yield Upload(CONFIGURATION, joint + 1)
            self._q = q
        self._rotation_RE = rotation_exp(vector)

    def _run(self, name: str, sequence: Sequence[None]) -> None:
        self._sequencer.start(self._client, name, sequence, lambda _: None, self._on_failure, self._types)

    def _on_failure(self, failure: SequenceFailure) -> None:
        self._failure = str(failure)

    def _on_response(self, frame: Frame) -> None:
        self._client.on_frame(frame)
        self._sequencer.poll()


def _pose(reference: ReferencePose) -> Matrix:
    """X_RE (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_exp(reference.rotation_vector)
    pose[:3, 3] = reference.position
    return pose


JOINTS = 8
