"""Messages in SI units to frames and back: `stack.messages` on one side, (identifier, bytes) on the other.

A message may need several frames; they carry the same counter, and the message is complete when all of them are in.
What cannot be read raises a CodecError that says why; nothing is ever filled in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from drivers.catalogue import FORCE_SENSOR_ID, GRIPPER_ID, PLANNER_ID, STRATEGIC_ID, TRACKER_ID, devices
from drivers.frame_codec import FastFrameCodec, InvalidValueError, Number, UnknownFrameError
from drivers.objects import DeviceDef
from stack.messages import (
    Gripper,
    GripperPhase,
    GripperState,
    JointReference,
    MissionCommand,
    Mode,
    PlannerPhase,
    PlannerState,
    Restriction,
    SingularityKind,
    SingularityReport,
    SlipReport,
    TrackedPose,
    TwistCommand,
    Vector,
    Wrench,
)

M = TypeVar("M")
Sendable = tuple[int, bytes]


@dataclass(frozen=True, slots=True)
class ReferencePose:
    """TCP pose that the planner is after, in frame R: position (3,) m, rotation vector (3,) rad.

    It shall be reached at the SYNC `sync_count` + 2 (counted modulo 65536); `valid` is False without a commanded path.
    """

    position: Vector
    rotation_vector: Vector
    valid: bool
    sync_count: int
    counter: int


class MessageCodec(Generic[M]):
    """One kind of message and the frames that carry it. `flat` and `build` turn it into SI values and back."""

    __slots__ = ("_build", "_flat", "_frames", "can_ids", "message_type")

    def __init__(
        self,
        message_type: type[M],
        device: DeviceDef,
        frames: tuple[str, ...],
        flat: Callable[[M], list[Number]],
        build: Callable[[list[Number], int], M | None],
    ) -> None:
        self.message_type = message_type
        self._flat = flat
        self._build = build
        self._frames: list[tuple[FastFrameCodec, slice]] = []
        start = 0
        for name in frames:
            codec = FastFrameCodec(device, name)
            self._frames.append((codec, slice(start, start + len(codec.fields))))
            start += len(codec.fields)
        self.can_ids = tuple(codec.can_id for codec, _ in self._frames)

    def encode(self, message: M) -> tuple[list[Sendable], bool]:
        """Frames in the order of their identifiers, and whether a value had to be limited to what the wire can carry.

        Raises InvalidValueError for what is not a finite number, ValueError for vectors of the wrong length.
        """
        values = self._flat(message)
        counter: int = message.counter  # type: ignore[attr-defined]
        frames = []
        limited = False
        for codec, part in self._frames:
            data, was_limited = codec.encode(values[part], counter)
            frames.append((codec.can_id, data))
            limited = limited or was_limited
        return frames, limited

    def assembler(self) -> Assembler[M]:
        """A receiver of this message, with a state of its own."""
        return Assembler(self._frames, self._build)


class Assembler(Generic[M]):
    """Puts a message together from its frames, in whatever order they come."""

    __slots__ = ("_build", "_counter", "_frames", "_missing", "_parts", "incomplete")

    def __init__(
        self, frames: list[tuple[FastFrameCodec, slice]], build: Callable[[list[Number], int], M | None]
    ) -> None:
        self._build = build
        self._frames = {codec.can_id: (codec, part) for codec, part in frames}
        self._parts: list[Number] = [0] * max(part.stop for _, part in frames)
        self._missing: set[int] = set()
        self._counter: int | None = None
        self.incomplete = 0
        """Messages that were given up because a frame of a later one came first."""

    def feed(self, can_id: int, data: bytes) -> M | None:
        """The message that this frame completes, or None when it completes none (or says that there is no value).

        Raises CodecError: unknown identifier, wrong length, wrong checksum, value without a meaning. A frame that
        raised leaves no trace.
        """
        if can_id not in self._frames:
            raise UnknownFrameError(f"{can_id:03X}h: must be one of {[f'{known:03X}h' for known in self._frames]}")
        codec, part = self._frames[can_id]
        values, counter = codec.decode(data)
        if len(self._frames) == 1:
            return self._build(values, counter)
        if counter != self._counter or can_id not in self._missing:
            self.incomplete += bool(self._missing)
            self._counter = counter
            self._missing = set(self._frames)
        self._parts[part] = values
        self._missing.discard(can_id)
        return None if self._missing else self._build(self._parts, counter)


class Decoder:
    """Reads every kind of message that it is given; one per listener."""

    __slots__ = ("_assemblers",)

    def __init__(self, codecs: Iterable[MessageCodec[Any]]) -> None:
        self._assemblers: dict[int, Assembler[Any]] = {}
        for codec in codecs:
            self._assemblers |= dict.fromkeys(codec.can_ids, codec.assembler())

    @property
    def can_ids(self) -> tuple[int, ...]:
        return tuple(self._assemblers)

    def feed(self, can_id: int, data: bytes) -> Any:
        """See `Assembler.feed`."""
        assembler = self._assemblers.get(can_id)
        if assembler is None:
            raise UnknownFrameError(f"{can_id:03X}h: no message of this decoder has this identifier")
        return assembler.feed(can_id, data)


def _entries(vector: Vector, count: int, name: str) -> list[Number]:
    values: list[Number] = vector.tolist()
    if len(values) != count:
        raise ValueError(f"{name} has {len(values)} entries; must be {count}")
    return values


def _flat_reference(message: ReferencePose) -> list[Number]:
    x, y, z = _entries(message.position, 3, "position")
    rotation = _entries(message.rotation_vector, 3, "rotation_vector")
    return [x, y, z, message.valid, message.sync_count & 0xFFFF, *rotation]


def _build_reference(values: list[Number], counter: int) -> ReferencePose:
    x, y, z, valid, sync_count, *rotation = values
    return ReferencePose(np.array([x, y, z]), np.array(rotation), bool(valid), int(sync_count), counter)


def _flat_tracked(message: TrackedPose) -> list[Number]:
    x, y, z = _entries(message.position, 3, "position")
    rotation = _entries(message.rotation_vector, 3, "rotation_vector")
    return [x, y, z, True, message.age_ns * 1e-9, *rotation]


def _build_tracked(values: list[Number], counter: int) -> TrackedPose | None:
    x, y, z, valid, age_s, *rotation = values
    if not valid:  # the tracker is alive, but does not see its feature
        return None
    return TrackedPose(np.array([x, y, z]), np.array(rotation), round(age_s * 1e9), counter)


def _build_mission(values: list[Number], counter: int) -> MissionCommand:
    mode, step, gripper, _ = values
    if mode not in _MODES:
        raise InvalidValueError(f"mission.mode = {mode}: must be one of {sorted(_MODES)}")
    if gripper not in _GRIPPER:
        raise InvalidValueError(f"mission.gripper = {gripper}: must be one of {sorted(_GRIPPER)}")
    return MissionCommand(_MODES[int(mode)], int(step), counter, _GRIPPER[int(gripper)])


def _build_state(values: list[Number], counter: int) -> PlannerState:
    phase, status, restrictions, path_scale = values
    if phase not in _PHASES:
        raise InvalidValueError(f"state.phase = {phase}: must be one of {sorted(_PHASES)}")
    return PlannerState(_PHASES[int(phase)], int(status), Restriction(int(restrictions)), path_scale, counter)


def _build_singularity(values: list[Number], counter: int) -> SingularityReport:
    kind, manifold, ks, as_, ss, sas = values
    if kind not in _KINDS:
        raise InvalidValueError(f"singularity.kind = {kind}: must be one of {sorted(_KINDS)}")
    return SingularityReport(_KINDS[int(kind)], int(manifold), (ks, as_, ss, sas), counter)


def _build_gripper(values: list[Number], counter: int) -> GripperState:
    if values[0] not in _GRIPPER_PHASES:
        raise InvalidValueError(f"gripper.state = {values[0]}: must be one of {sorted(_GRIPPER_PHASES)}")
    return GripperState(_GRIPPER_PHASES[int(values[0])], counter)


_KINDS = {int(kind): kind for kind in SingularityKind}
_MODES = {int(mode): mode for mode in Mode}
_GRIPPER = {int(asked): asked for asked in Gripper}
_GRIPPER_PHASES = {int(phase): phase for phase in GripperPhase}
_PHASES = {int(phase): phase for phase in PlannerPhase}
_DEVICES = devices()

TWIST = MessageCodec[TwistCommand](
    TwistCommand,
    _DEVICES[STRATEGIC_ID],
    ("twist_linear", "twist_angular"),
    lambda message: _entries(message.twist, 6, "twist"),
    lambda values, counter: TwistCommand(np.array(values), counter),
)
MISSION = MessageCodec[MissionCommand](
    MissionCommand,
    _DEVICES[STRATEGIC_ID],
    ("mission",),
    lambda message: [int(message.mode), message.step, int(message.gripper), 0],
    _build_mission,
)
JOINT_REFERENCE = MessageCodec[JointReference](
    JointReference,
    _DEVICES[STRATEGIC_ID],
    tuple(f"joint_reference_{pair}" for pair in range(1, 5)),
    lambda message: _entries(message.position, 8, "position"),
    lambda values, counter: JointReference(np.array(values), counter),
)
PLANNER_STATE = MessageCodec[PlannerState](
    PlannerState,
    _DEVICES[PLANNER_ID],
    ("state",),
    lambda message: [int(message.phase), message.status, int(message.restrictions), message.path_scale],
    _build_state,
)
REFERENCE = MessageCodec[ReferencePose](
    ReferencePose,
    _DEVICES[PLANNER_ID],
    ("reference_xy", "reference_z", "reference_rotation"),
    _flat_reference,
    _build_reference,
)
WRENCH = MessageCodec[Wrench](
    Wrench,
    _DEVICES[FORCE_SENSOR_ID],
    ("force", "torque"),
    lambda message: _entries(message.wrench, 6, "wrench"),
    lambda values, counter: Wrench(np.array(values), counter),
)
TRACKED_POSE = MessageCodec[TrackedPose](
    TrackedPose,
    _DEVICES[TRACKER_ID],
    ("tracked_xy", "tracked_z", "tracked_rotation"),
    _flat_tracked,
    _build_tracked,
)
GRIPPER_STATE = MessageCodec[GripperState](
    GripperState,
    _DEVICES[GRIPPER_ID],
    ("gripper",),
    lambda message: [int(message.phase), 0, 0],
    _build_gripper,
)
SINGULARITY = MessageCodec[SingularityReport](
    SingularityReport,
    _DEVICES[PLANNER_ID],
    ("singularity",),
    lambda message: [int(message.kind), message.manifold, *message.margins],
    _build_singularity,
)
SLIP = MessageCodec[SlipReport](
    SlipReport,
    _DEVICES[PLANNER_ID],
    ("slip",),
    lambda message: [*message.slip, message.measured, message.rejected],
    lambda values, counter: SlipReport((values[0], values[1]), int(values[2]), int(values[3]), counter),
)
MESSAGES: tuple[MessageCodec[Any], ...] = (
    TWIST,
    MISSION,
    JOINT_REFERENCE,
    PLANNER_STATE,
    REFERENCE,
    WRENCH,
    TRACKED_POSE,
    GRIPPER_STATE,
    SINGULARITY,
    SLIP,
)
