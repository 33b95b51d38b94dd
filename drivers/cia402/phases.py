"""Where a drive master and each of its axes are, and what it reports when something happens."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from drivers.canopen.emcy import EmcyCode


class AxisPhase(IntEnum):
    """One axis, as its master leads it."""

    ABSENT = 0
    CONFIGURING = 1
    READY = 2
    """Configured, operational, torque off."""
    ENABLING = 3
    ENABLED = 4
    STOPPING = 5
    """Quick stop on its way."""
    STOPPED = 6
    """Standing under torque after a quick stop (605Ah 5, 6)."""
    DISABLING = 7
    RESETTING = 8
    FAULT = 9


class MasterPhase(IntEnum):
    """The set of axes."""

    OFF = 0
    BOOT = 1
    """At least one drive was not heard of yet."""
    CONFIGURE = 2
    READY = 3
    ENABLING = 4
    ENABLED = 5
    """Every axis that was asked to be enabled is, and follows `send_targets`."""
    STOPPING = 6
    STOPPED = 7
    DISABLING = 8
    RESETTING = 9
    FAULT = 10


_PRECEDENCE = (
    (AxisPhase.FAULT, MasterPhase.FAULT),
    (AxisPhase.ABSENT, MasterPhase.BOOT),
    (AxisPhase.CONFIGURING, MasterPhase.CONFIGURE),
    (AxisPhase.RESETTING, MasterPhase.RESETTING),
    (AxisPhase.STOPPING, MasterPhase.STOPPING),
    (AxisPhase.DISABLING, MasterPhase.DISABLING),
    (AxisPhase.ENABLING, MasterPhase.ENABLING),
    (AxisPhase.STOPPED, MasterPhase.STOPPED),
    (AxisPhase.ENABLED, MasterPhase.ENABLED),
)


def phase_of(axes: list[AxisPhase]) -> MasterPhase:
    """The phase of a set of axes: the most urgent one that any of them is in; READY when all are."""
    if axes.count(axes[0]) == len(axes):
        axes = axes[:1]
    for axis_phase, master_phase in _PRECEDENCE:
        if axis_phase in axes:
            return master_phase
    return MasterPhase.READY


class EventKind(Enum):
    """What happened. The first five leave the phase alone; all others put the axis into FAULT."""

    WAITING = "waiting for a drive"
    CONFIGURED = "drive configured"
    NOTED = "set up with a difference"
    EMERGENCY = "emergency message"
    GATE = "set point refused"
    BOOT_TIMEOUT = "drive did not appear"
    CONFIGURATION_FAILED = "configuration failed"
    ENABLE_FAILED = "enabling failed"
    DISABLE_FAILED = "disabling failed"
    STOP_FAILED = "quick stop failed"
    RESET_FAILED = "fault reset failed"
    DRIVE_FAULT = "drive fault"
    LEFT_ENABLED = "drive left operation enabled"
    LEFT_OPERATIONAL = "drive left NMT operational"
    HEARTBEAT_LOST = "heartbeat lost"
    FEEDBACK_LATE = "feedback late"
    FEEDBACK_MALFORMED = "feedback malformed"
    REBOOTED = "drive rebooted"

    @property
    def is_failure(self) -> bool:
        harmless = (EventKind.WAITING, EventKind.CONFIGURED, EventKind.NOTED, EventKind.EMERGENCY, EventKind.GATE)
        return self not in harmless


@dataclass(frozen=True, slots=True)
class DriveEvent:
    """One thing that happened to one drive. `code`: error code (603Fh), SDO abort code, NMT state, or 0."""

    t_ns: int
    node_id: int
    kind: EventKind
    code: int
    text: str


@dataclass(frozen=True, slots=True)
class EmergencyMessage:
    """EMCY as received: error code, error register 1001h, five bytes of the manufacturer."""

    t_ns: int
    code: int
    register: int
    detail: bytes


_CLASSES = (
    (0xFF00, 0xFF00, "manufacturer specific"),
    (0xF000, 0xFF00, "additional functions"),
    (0x8000, 0xF000, "monitoring"),
    (0x7000, 0xF000, "additional modules"),
    (0x6000, 0xF000, "device software"),
    (0x5000, 0xF000, "device hardware"),
    (0x4000, 0xF000, "temperature"),
    (0x3000, 0xF000, "voltage"),
    (0x2000, 0xF000, "current"),
    (0x1000, 0xFF00, "generic error"),
)

_NAMES = {int(code): code.name.lower().replace("_", " ") for code in EmcyCode}


def error_text(code: int) -> str:
    """An error code of 603Fh or EMCY in words: its name where it is known, else its class (CiA 301, table 26)."""
    if code == 0:
        return "no error"
    known = _NAMES.get(code)
    if known is not None:
        return known
    for value, mask, text in _CLASSES:
        if code & mask == value:
            return text
    return "unknown error code"
