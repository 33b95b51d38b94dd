"""Every frame of the catalogue as a DBC message: process data, NMT, SYNC, EMCY, SDO, heartbeat."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from drivers.catalogue import PLANNER_ID, STRATEGIC_ID, receivers
from drivers.dbc import Message, Signal
from drivers.frame_codec import Field, fields_of
from drivers.objects import DeviceDef, PdoDef, PdoKind
from drivers.tables.communication import (
    COB_EMCY,
    COB_HEARTBEAT,
    COB_SDO_REPLY,
    COB_SDO_REQUEST,
    COB_SYNC,
    HEARTBEAT_MS,
    SYNC_PERIOD_US,
)
from drivers.tables.fast import EVENT_DRIVEN
from drivers.tables.planner import KIND_NAMES, MANIFOLD_NAMES
from stack.messages import Mode, PlannerPhase, Restriction, SingularityKind

STRATEGIC_PERIOD_MS = 20
SYNC_PERIOD_MS = SYNC_PERIOD_US // 1000

NMT_COMMANDS = {1: "start", 2: "stop", 128: "enter pre-operational", 129: "reset node", 130: "reset communication"}
NMT_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"}
OPERATION_MODES = {
    0: "none",
    6: "homing",
    8: "cyclic synchronous position",
    9: "cyclic synchronous velocity",
    10: "cyclic synchronous torque",
}
ERROR_CODES = {
    0x0000: "error reset or no error",
    0x1000: "generic error",
    0x2310: "continuous over-current",
    0x4310: "excess temperature of drive",
    0x8110: "CAN overrun",
    0x8120: "CAN error passive",
    0x8130: "heartbeat lost",
    0x8140: "recovered from bus-off",
    0x8210: "PDO too short",
    0x8220: "PDO too long",
    0x8400: "velocity out of limits",
    0x8611: "following error",
    0x8612: "position limit",
}
# statusword bits 0 … 6 (CiA 402, states by mask 4Fh or 6Fh; bit 4, voltage, may be either)
_STATE_PATTERNS = (
    ("not ready to switch on", 0x4F, 0x00),
    ("switch on disabled", 0x4F, 0x40),
    ("ready to switch on", 0x6F, 0x21),
    ("switched on", 0x6F, 0x23),
    ("operation enabled", 0x6F, 0x27),
    ("quick stop active", 0x6F, 0x07),
    ("fault reaction active", 0x4F, 0x0F),
    ("fault", 0x4F, 0x08),
)
DRIVE_STATES = {bits: name for bits in range(0x80) for name, mask, pattern in _STATE_PATTERNS if bits & mask == pattern}
# controlword bits 0 … 3: shutdown x110, disable voltage xx0x, quick stop x01x; 0111 switches on or disables operation
DRIVE_COMMANDS = {
    bits: "disable voltage" if not bits & 2 else "quick stop" if not bits & 4 else "shutdown" if not bits & 1 else name
    for bits, name in ((b, "enable operation" if b & 8 else "switch on or disable operation") for b in range(16))
}
_STATUS_FLAGS = (
    (7, "warning"),
    (9, "remote"),
    (10, "target_reached"),
    (11, "internal_limit"),
    (12, "follows_target"),
    (13, "following_error"),
)
_CONTROL_FLAGS = ((7, "fault_reset"), (8, "halt"))
_CHOICES: dict[str, Mapping[int, str]] = {
    "mode": {mode.value: mode.name.lower() for mode in Mode},
    "phase": {phase.value: phase.name.lower() for phase in PlannerPhase},
    "singularity_kind": {kind.value: kind.name.lower() for kind in SingularityKind},
    "nearest_manifold": {0: "none known", **dict(enumerate(MANIFOLD_NAMES, 1))},
    "valid": {0: "no value", 1: "valid"},
    "modes_of_operation_display": OPERATION_MODES,
}
_COMMENTS = {
    "checksum": "CRC-8 SAE J1850 over identifier (low byte, high byte) and the seven bytes before",
    "counter": "one up per message; frames of one message carry the same",
    "restrictions": "bits: " + ", ".join(f"{r.value.bit_length() - 1} {(r.name or '').lower()}" for r in Restriction),
    "singularity_kind": "the kind whose margin is below object 2044h",
    **{f"margin_{name}": "0 on a singularity of this kind, 1 far from any" for name in KIND_NAMES},
    "slip_left": "estimated slip ratio: the part of its way that this wheel loses",
    "slip_right": "estimated slip ratio: the part of its way that this wheel loses",
    "measured": "tracked poses taken in, modulo 256",
    "rejected": "tracked poses rejected as outliers, modulo 256",
    "sync_count": "the pose shall be reached at this SYNC + 2",
    "torque_actual_value": "of the rated torque or force, 6076h",
    "torque_offset": "of the rated torque or force, 6076h",
}
_ASCII = {"·": "", "²": "^2", "rated torque": "rated"}


def bus_messages(devices: Mapping[int, DeviceDef]) -> Iterator[Message]:
    """All frames that these devices send or receive."""
    names = {node_id: device.name for node_id, device in devices.items()}
    planner = names[PLANNER_ID]
    others = tuple(name for node_id, name in names.items() if node_id != PLANNER_ID)
    nmt = (Signal("command", 0, 8, high=255, choices=NMT_COMMANDS), Signal("node", 8, 8, high=127, comment="0: all"))
    yield Message(0, "NMT", 2, planner, others, nmt)
    yield Message(COB_SYNC, "SYNC", 0, planner, others, (), "takes over set points, samples feedback", SYNC_PERIOD_MS)
    for device in devices.values():
        yield from _service_messages(device, planner)
        for pdo in device.pdos:
            if pdo.enabled:
                yield _process_data(device, pdo, names)


def _service_messages(device: DeviceDef, planner: str) -> Iterator[Message]:
    node_id, name = device.node_id, device.name
    # the strategic node writes the planner's parameters, the planner everybody else's
    client = "strategic" if node_id == PLANNER_ID else planner
    emergency = (
        Signal("error_code", 0, 16, high=0xFFFF, choices=ERROR_CODES),
        Signal("error_register", 16, 8, high=255),
        Signal("manufacturer_specific", 24, 40, high=(1 << 40) - 1),
    )
    service = (
        Signal("command", 0, 8, high=255),
        Signal("index", 8, 16, high=0xFFFF),
        Signal("subindex", 24, 8, high=255),
        Signal("data", 32, 32, high=0xFFFF_FFFF, comment="value or abort code; segments have data from byte 1 on"),
    )
    state = (Signal("state", 0, 8, high=255, choices=NMT_STATES),)
    yield Message(COB_EMCY + node_id, f"{name}_EMCY", 8, name, (client,), emergency)
    yield Message(COB_SDO_REPLY + node_id, f"{name}_SDO_reply", 8, name, (client,), service)
    yield Message(COB_SDO_REQUEST + node_id, f"{name}_SDO_request", 8, client, (name,), service)
    yield Message(COB_HEARTBEAT + node_id, f"{name}_heartbeat", 1, name, (client,), state, "", HEARTBEAT_MS)


def _process_data(device: DeviceDef, pdo: PdoDef, names: Mapping[int, str]) -> Message:
    fields = fields_of(device, pdo)
    signals = tuple(signal for item in fields for signal in _signals(item))
    length = sum(item.bits for item in fields) // 8
    sender = names[PLANNER_ID] if pdo.kind is PdoKind.RPDO else device.name
    listeners = tuple(names[node_id] for node_id in receivers(device, pdo.kind))
    name = f"{device.name}_{pdo.name.replace(' ', '_')}"
    return Message(pdo.cob_id, name, length, sender, listeners, signals, "", _cycle_ms(device, pdo))


def _cycle_ms(device: DeviceDef, pdo: PdoDef) -> int:
    if pdo.transmission_type < EVENT_DRIVEN:
        return SYNC_PERIOD_MS * max(1, pdo.transmission_type)
    return {STRATEGIC_ID: STRATEGIC_PERIOD_MS, PLANNER_ID: SYNC_PERIOD_MS}.get(device.node_id, 0)


def _signals(item: Field) -> Iterator[Signal]:
    name = item.name.lower().replace(" ", "_")
    if name == "statusword":
        yield Signal("statusword_state", item.shift, 7, high=127, choices=DRIVE_STATES)
        yield from _flags(name, item.shift, _STATUS_FLAGS)
    elif name == "controlword":
        yield Signal("controlword_command", item.shift, 4, high=15, choices=DRIVE_COMMANDS)
        yield from _flags(name, item.shift, _CONTROL_FLAGS)
    else:
        unit = item.unit
        for text, plain in _ASCII.items():
            unit = unit.replace(text, plain)
        yield Signal(
            name,
            item.shift,
            item.bits,
            item.signed,
            item.scale,
            item.low * item.scale,
            item.high * item.scale,
            unit,
            _COMMENTS.get(name, ""),
            _CHOICES.get(name, {}),
        )


def _flags(word: str, start: int, flags: tuple[tuple[int, str], ...]) -> Iterator[Signal]:
    for bit, name in flags:
        yield Signal(f"{word}_{name}", start + bit, 1, high=1)
