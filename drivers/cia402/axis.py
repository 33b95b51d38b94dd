"""The master's view of one drive: what it last said, and the command that goes to it next."""

from __future__ import annotations

import struct
from collections import deque
from fractions import Fraction

from drivers.cia402.drive_units import DriveUnits, check_limits, in_drive_units, units_of_table
from drivers.cia402.phases import AxisPhase, EmergencyMessage
from drivers.cia402.states import State, state_of
from drivers.gate import JUMP_MARGIN, FeedbackGate
from drivers.objects import DataType, DeviceDef, PdoDef, PdoKind
from stack.messages import DriveFeedback

_COMMAND = struct.Struct("<Hih")
_FEEDBACK = struct.Struct("<Hih")
_VELOCITY = struct.Struct("<ib")

TARGET_POSITION, TARGET_VELOCITY = (0x607A, 0), (0x60FF, 0)
COMMAND_OBJECTS = (((0x6040, 0), TARGET_POSITION, (0x60B2, 0)), ((0x6040, 0), TARGET_VELOCITY, (0x60B2, 0)))
FEEDBACK_OBJECTS = ((0x6041, 0), (0x6064, 0), (0x6077, 0))
MODE_CSP, MODE_CSV = 8, 9
EMERGENCY_LOG_LENGTH = 64
_HALF_TURN, _TURN_MASK = 1 << 31, (1 << 32) - 1
LOW, HIGH = -(1 << 31), (1 << 31) - 1
OFFSET_LOW, OFFSET_HIGH = -(1 << 15), (1 << 15) - 1
ROUNDING = 2.0
"""So many units the second difference of three rounded set points may be off."""


class AxisClient:
    """One drive as its master sees it. Raw integers are those of the wire; SI by `*_scale`.

    `device` has to map controlword, target (607Ah: position; 60FFh: velocity) and torque offset in RPDO1, and
    statusword, position and torque in TPDO1; ValueError otherwise. What was not received within `timeout_ns` is
    missing: None, never zero.
    """

    __slots__ = (
        "causes",
        "command_id",
        "controlword",
        "device",
        "effort_scale",
        "emergencies",
        "feedback_gate",
        "feedback_id",
        "follows_planner",
        "heard",
        "heartbeat_ns",
        "kept",
        "missed_syncs",
        "mode",
        "name",
        "needs_configuration",
        "nmt_state",
        "node_id",
        "offset_raw",
        "phase",
        "position_raw",
        "position_scale",
        "previous_position_raw",
        "received_ns",
        "sent",
        "started",
        "started_ns",
        "statusword",
        "suspected",
        "target_raw",
        "timeout_ns",
        "torque_raw",
        "units",
        "unreported_emergency",
        "velocity_id",
        "velocity_ns",
        "velocity_raw",
        "velocity_scale",
    )

    def __init__(self, device: DeviceDef, timeout_ns: int, sync_period_ns: int = 10_000_000) -> None:
        command = _pdo(device, PdoKind.RPDO, 1)
        if command.mapping not in COMMAND_OBJECTS:
            raise ValueError(f"{device.name}: RPDO1 maps {_names(command)}; must be 6040h, 607Ah or 60FFh, 60B2h")
        feedback = _pdo(device, PdoKind.TPDO, 1)
        if feedback.mapping != FEEDBACK_OBJECTS:
            raise ValueError(f"{device.name}: TPDO1 maps {_names(feedback)}; must be 6041h, 6064h, 6077h")
        self.device = device
        self.node_id = device.node_id
        self.name = device.name
        self.timeout_ns = timeout_ns
        self.mode = MODE_CSP if TARGET_POSITION in command.mapping else MODE_CSV
        self.command_id = command.cob_id
        self.feedback_id = feedback.cob_id
        self.velocity_id = _velocity_id(device)
        self.units: DriveUnits
        """Of the wire of this drive: the table's until the drive was asked."""
        self.position_scale = self.velocity_scale = self.effort_scale = 0.0
        """The same as factors; effort: N·m (N) per ‰ of the rated torque."""
        self.kept: dict[tuple[int, int], int] = {}
        """Objects that the drive has with another value than it was to get."""
        self.phase = AxisPhase.ABSENT
        self.heard = False
        """The drive has shown a sign of life since it was last given up."""
        self.started = False
        """The master has started it by NMT and serves it with commands."""
        self.started_ns = 0
        self.needs_configuration = True
        self.follows_planner = False
        self.controlword = 0
        self.target_raw = 0
        self.offset_raw = 0
        self.sent = 0
        self.statusword: int | None = None
        self.position_raw = self.previous_position_raw = self.torque_raw = self.velocity_raw = 0
        self.received_ns = 0
        self.suspected: int | None = None
        """A statusword that cannot be, heard once: to be believed when it comes again."""
        self.feedback_gate = FeedbackGate(0, sync_period_ns)
        self.set_units(units_of_table(device))
        self.velocity_ns: int | None = None
        self.missed_syncs = 0
        self.nmt_state: int | None = None
        self.heartbeat_ns: int | None = None
        self.emergencies: deque[EmergencyMessage] = deque(maxlen=EMERGENCY_LOG_LENGTH)
        self.unreported_emergency: EmergencyMessage | None = None
        self.causes: list[str] = []
        """Why it is in FAULT, first cause first."""

    @property
    def title(self) -> str:
        """How messages name it."""
        return f"drive {self.node_id} ({self.name})"

    @property
    def state(self) -> State | None:
        """CiA 402 state of the last statusword, None before the first one."""
        return None if self.statusword is None else state_of(self.statusword)

    @property
    def target_scale(self) -> float:
        return self.position_scale if self.mode == MODE_CSP else self.velocity_scale

    def set_units(self, units: DriveUnits) -> None:
        """What the drive counts in from now on. Raises UnitError, and leaves all as it was, where a limit cannot be said in `units`."""
        check_limits(self.device, units)
        self.units = units
        self.position_scale = float(units.position)
        self.velocity_scale = float(units.velocity)
        self.effort_scale = 1e-6 * float(units.effort.times(Fraction(10**6)))
        speed = self.setting(0x607F, 0, 0)
        period_s = self.feedback_gate.period_ns * 1e-9
        self.feedback_gate.jump = round(self.way(JUMP_MARGIN * speed, period_s)) if speed else 0

    def setting(self, index: int, subindex: int, fallback: int) -> int:
        """Value of an object as the device's definition has it, in its own units; `fallback` where there is none."""
        try:
            return int(self.device.object(index, subindex).default)
        except KeyError:
            return fallback

    def limit(self, index: int, subindex: int, fallback: int) -> int:
        """`setting` in the units of the drive's wire, rounded to the tighter side."""
        value = self.setting(index, subindex, fallback)
        return in_drive_units(self.device, self.units, (index, subindex), value) if value != fallback else value

    def way(self, speed: float, period_s: float) -> float:
        """How far the axis gets at `speed` of the table in `period_s`, in position units of the drive's wire."""
        table = units_of_table(self.device).position
        if self.units.position == table:
            return speed * period_s
        return speed * period_s * (float(table) / self.position_scale) + ROUNDING

    def take_feedback(self, data: bytes, now_ns: int) -> None:
        """TPDO1. While the drive does not follow its target, the target follows the drive: enabling starts without a jump.

        Raises struct.error for another length than 8.
        """
        first = self.statusword is None
        statusword, position, torque_raw = _FEEDBACK.unpack(data)
        if self.follows_planner and self.feedback_gate.jump and self.feedback_gate.judge(position, now_ns) is not None:
            self.statusword = statusword  # its word of a fault counts; where it is, is as good as not heard
            return
        self.statusword, self.torque_raw = statusword, torque_raw
        if first:
            self.position_raw = position
        self.previous_position_raw = self.position_raw
        # a wheel turns on where 32 bits end: the shorter way round is the one that it went
        self.position_raw += ((position - self.position_raw + _HALF_TURN) & _TURN_MASK) - _HALF_TURN
        self.received_ns = now_ns
        self.missed_syncs = 0
        if not self.follows_planner:
            if self.mode == MODE_CSV:
                self.target_raw = 0
            elif self.state is not State.OPERATION_ENABLED:
                self.target_raw = position

    def take_velocity(self, data: bytes, now_ns: int) -> None:
        """TPDO2. Raises struct.error for another length than 5."""
        self.velocity_raw, _ = _VELOCITY.unpack(data)
        self.velocity_ns = now_ns

    def command(self) -> bytes:
        """RPDO1 as it goes out now."""
        return _COMMAND.pack(self.controlword, self.target_raw, self.offset_raw)

    def feedback(self, now_ns: int) -> DriveFeedback | None:
        """The last TPDO1 in SI units, None when there was none within the time-out."""
        if self.statusword is None or now_ns - self.received_ns > self.timeout_ns:
            return None
        return DriveFeedback(
            self.statusword, self.position_raw * self.position_scale, self.torque_raw * self.effort_scale
        )

    def velocity(self, now_ns: int, timeout_ns: int) -> float | None:
        """The last TPDO2 in rad/s or m/s, None when there was none within `timeout_ns`."""
        if self.velocity_ns is None or now_ns - self.velocity_ns > timeout_ns:
            return None
        return self.velocity_raw * self.velocity_scale

    def forget(self) -> None:
        """The drive has rebooted: nothing that it said before holds."""
        self.statusword = self.velocity_ns = None
        self.started = self.follows_planner = False
        self.needs_configuration = True
        self.controlword = 0


def data_types(device: DeviceDef) -> dict[tuple[int, int], DataType]:
    """Type of every object of a device."""
    return {entry.key: entry.data_type for entry in device.objects}


def _pdo(device: DeviceDef, kind: PdoKind, number: int) -> PdoDef:
    for pdo in device.pdos:
        if pdo.kind is kind and pdo.number == number and pdo.enabled:
            return pdo
    raise ValueError(f"{device.name}: has no enabled {kind.name}{number}; a drive needs RPDO1 and TPDO1")


def _names(pdo: PdoDef) -> str:
    return ", ".join(f"{index:04X}h" for index, _ in pdo.mapping) or "nothing"


def _velocity_id(device: DeviceDef) -> int | None:
    for pdo in device.pdos:
        if pdo.kind is PdoKind.TPDO and pdo.enabled and pdo.mapping == ((0x606C, 0), (0x6061, 0)):
            return pdo.cob_id
    return None
