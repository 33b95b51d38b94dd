"""The object dictionary of a drive (CiA 402): joints follow cyclic positions, wheels cyclic velocities.

Wire units: µrad (lift: µm) and their derivatives per second; torque and force in per mille of the rated one, 6076h.
Documents used are vendors' public manuals of CiA 402 drives; where these differ, the comment says what was chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.objects import Access, DataType, DeviceDef, ObjectDef, PdoDef, PdoKind
from drivers.tables.communication import (
    COB_RPDO,
    COB_TPDO,
    DEVICE_TYPE_SERVO_DRIVE,
    U8,
    U16,
    U32,
    Identity,
    communication_objects,
    pdo_objects,
)

I8, I16, I32 = DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32
I32_MIN, I32_MAX, U32_MAX = -(1 << 31), (1 << 31) - 1, (1 << 32) - 1

MODE_HOMING, MODE_CSP, MODE_CSV, MODE_CST = 6, 8, 9, 10
SUPPORTED_MODES = 1 << 5 | 1 << 7 | 1 << 8 | 1 << 9
"""6502h: homing, cyclic synchronous position, velocity, torque (bit = mode - 1)."""
HOMING_AT_CURRENT_POSITION = 37

UNIT_MICRORADIAN, UNIT_MICROMETRE = 0xFA10_0000, 0xFA01_0000
"""60A8h: prefix 10^-6 (FAh), unit radian (10h) or metre (01h)."""
PER_SECOND = 0x0000_0300
"""60A9h: denominator second."""


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """What a drive keeps to, whatever its master says. SI: rad or m, and per second; `None`: no such limit."""

    position_min: float | None = -2.967
    position_max: float | None = 2.967
    velocity: float = 1.5
    acceleration: float = 6.0
    quick_stop_deceleration: float = 12.0
    following_error: float | None = 0.1
    following_error_timeout_s: float = 0.05
    torque_ratio: float = 2.0
    """Highest torque as a multiple of the rated one."""


JOINT_LIMITS = DriveLimits()
LIFT_LIMITS = DriveLimits(0.35, 1.15, 0.25, 1.0, 2.0, 0.02)
# a wheel follows velocities: its position has no target that it could lag behind
WHEEL_LIMITS = DriveLimits(None, None, 10.0, 20.0, 20.0, None)


def micro(value: float) -> int:
    """SI to the wire's 10^-6 units."""
    return round(value * 1e6)


def drive(
    node_id: int,
    name: str,
    rated_torque_mNm: int = 100_000,
    limits: DriveLimits = JOINT_LIMITS,
    *,
    linear: bool = False,
    wheel: bool = False,
) -> DeviceDef:
    """One drive. `rated_torque_mNm` in mN·m (mN if `linear`); `linear`: µm instead of µrad; `wheel`: velocity mode."""
    identity = Identity(*(("wheel drive", 2) if wheel else ("joint drive", 1)), DEVICE_TYPE_SERVO_DRIVE)
    profile = (
        _state_objects(MODE_CSV if wheel else MODE_CSP)
        + _motion_objects(limits, "m" if linear else "rad")
        + _torque_objects(rated_torque_mNm, limits, linear)
        + _option_objects()
        + _homing_objects("m" if linear else "rad")
        + _unit_objects(linear)
        + _gate_objects()
    )
    pdos = _pdos(node_id, wheel)
    types = {entry.key: entry.data_type for entry in profile}
    # a drive stops by itself when the planner falls silent
    communication = communication_objects(node_id, identity, consumed_heartbeats=[2])
    objects = communication + pdo_objects(pdos, types, remappable=True) + profile
    return DeviceDef(name, node_id, tuple(sorted(objects, key=lambda entry: entry.key)), pdos, identity.product)


def _pdos(node_id: int, wheel: bool) -> tuple[PdoDef, ...]:
    target = (0x60FF, 0) if wheel else (0x607A, 0)
    receive = {1: ((0x6040, 0), target, (0x60B2, 0))}
    transmit = {1: ((0x6041, 0), (0x6064, 0), (0x6077, 0)), 2: ((0x606C, 0), (0x6061, 0))}
    names = {1: "set point"}, {1: "feedback", 2: "velocity"}
    # unused ones are off: a default-valid RPDO3/4 could take the frames of another node's axis
    return tuple(
        PdoDef(
            kind,
            number,
            base[number - 1] + node_id,
            mappings.get(number, ()),
            transmission_type=10 if (kind, number) == (PdoKind.TPDO, 2) else 1,
            name=titles.get(number, f"{kind.value} {number}, unused"),
            enabled=number in mappings,
        )
        for kind, base, mappings, titles in (
            (PdoKind.RPDO, COB_RPDO, receive, names[0]),
            (PdoKind.TPDO, COB_TPDO, transmit, names[1]),
        )
        for number in range(1, 5)
    )


def _state_objects(mode: int) -> list[ObjectDef]:
    return [
        ObjectDef(0x603F, 0, "Error code", U16, Access.RO, 0, mappable=True),
        ObjectDef(0x6040, 0, "Controlword", U16, Access.RW, 0, mappable=True),
        ObjectDef(0x6041, 0, "Statusword", U16, Access.RO, 0, mappable=True),
        ObjectDef(0x6060, 0, "Modes of operation", I8, Access.RW, mode, mappable=True),
        ObjectDef(0x6061, 0, "Modes of operation display", I8, Access.RO, mode, mappable=True),
        ObjectDef(0x6502, 0, "Supported drive modes", U32, Access.CONST, SUPPORTED_MODES),
    ]


def _motion_objects(limits: DriveLimits, unit: str) -> list[ObjectDef]:
    low = I32_MIN if limits.position_min is None else micro(limits.position_min)
    high = I32_MAX if limits.position_max is None else micro(limits.position_max)
    # FFFF FFFFh: no following error control
    window = U32_MAX if limits.following_error is None else micro(limits.following_error)
    per_s, per_s2 = f"{unit}/s", f"{unit}/s²"

    def entry(
        index: int, sub: int, name: str, kind: DataType, access: Access, default: int, unit: str, mappable: bool = False
    ) -> ObjectDef:
        return ObjectDef(index, sub, name, kind, access, default, mappable, unit=unit, scale=1e-6)

    return [
        entry(0x6064, 0, "Position actual value", I32, Access.RO, 0, unit, True),
        entry(0x6065, 0, "Following error window", U32, Access.RW, window, unit),
        ObjectDef(
            0x6066,
            0,
            "Following error time out",
            U16,
            Access.RW,
            round(limits.following_error_timeout_s * 1e3),
            unit="s",
            scale=1e-3,
        ),
        entry(0x606C, 0, "Velocity actual value", I32, Access.RO, 0, per_s, True),
        entry(0x607A, 0, "Target position", I32, Access.RW, 0, unit, True),
        ObjectDef(0x607D, 0, "Software position limit: number of entries", U8, Access.CONST, 2),
        entry(0x607D, 1, "Min position limit", I32, Access.RW, low, unit),
        entry(0x607D, 2, "Max position limit", I32, Access.RW, high, unit),
        entry(0x607F, 0, "Max profile velocity", U32, Access.RW, micro(limits.velocity), per_s),
        entry(0x6084, 0, "Profile deceleration", U32, Access.RW, micro(limits.acceleration), per_s2),
        entry(0x6085, 0, "Quick stop deceleration", U32, Access.RW, micro(limits.quick_stop_deceleration), per_s2),
        entry(0x60B0, 0, "Position offset", I32, Access.RW, 0, unit, True),
        entry(0x60B1, 0, "Velocity offset", I32, Access.RW, 0, per_s, True),
        # 60C2h: SYNC period = value x 10^index seconds; sub 1 follows 1006h
        ObjectDef(0x60C2, 0, "Interpolation time period: number of entries", U8, Access.CONST, 2),
        ObjectDef(0x60C2, 1, "Interpolation time period value", U8, Access.RW, 10, low=1, high=255),
        ObjectDef(0x60C2, 2, "Interpolation time index", I8, Access.RW, -3, low=-6, high=-1),
        entry(0x60C5, 0, "Max acceleration", U32, Access.RW, micro(limits.acceleration), per_s2),
        entry(0x60F4, 0, "Following error actual value", I32, Access.RO, 0, unit, True),
        entry(0x60FF, 0, "Target velocity", I32, Access.RW, 0, per_s, True),
    ]


def _torque_objects(rated_torque_mNm: int, limits: DriveLimits, linear: bool) -> list[ObjectDef]:
    def per_mille(index: int, name: str, kind: DataType, access: Access, default: int = 0) -> ObjectDef:
        return ObjectDef(index, 0, name, kind, access, default, True, unit="rated torque", scale=1e-3)

    return [
        per_mille(0x6071, "Target torque", I16, Access.RW),
        per_mille(0x6072, "Max torque", U16, Access.RW, round(limits.torque_ratio * 1e3)),
        ObjectDef(
            0x6076,
            0,
            "Motor rated torque",
            U32,
            Access.RO,
            rated_torque_mNm,
            low=1,
            high=U32_MAX,
            unit="N" if linear else "N·m",
            scale=1e-3,
        ),
        per_mille(0x6077, "Torque actual value", I16, Access.RO),
        per_mille(0x60B2, "Torque offset", I16, Access.RW),
    ]


def _option_objects() -> list[ObjectDef]:
    """Option codes. 6007h is read differently by vendors; here: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop."""
    return [
        ObjectDef(0x6007, 0, "Abort connection option code", I16, Access.RW, 3, low=0, high=3),
        # 0 disable, 1 slow down ramp, 2 quick stop ramp, 5 and 6 the same and stay in quick stop active
        ObjectDef(0x605A, 0, "Quick stop option code", I16, Access.RW, 2, low=0, high=6),
        ObjectDef(0x605B, 0, "Shutdown option code", I16, Access.RW, 0, low=0, high=1),
        ObjectDef(0x605C, 0, "Disable operation option code", I16, Access.RW, 1, low=0, high=1),
        ObjectDef(0x605D, 0, "Halt option code", I16, Access.RW, 1, low=1, high=2),
        ObjectDef(0x605E, 0, "Fault reaction option code", I16, Access.RW, 2, low=0, high=2),
    ]


def _homing_objects(unit: str) -> list[ObjectDef]:
    speed = f"{unit}/s"
    return [
        ObjectDef(0x607C, 0, "Home offset", I32, Access.RW, 0, unit=unit, scale=1e-6),
        ObjectDef(0x6098, 0, "Homing method", I8, Access.RW, HOMING_AT_CURRENT_POSITION),
        ObjectDef(0x6099, 0, "Homing speeds: number of entries", U8, Access.CONST, 2),
        ObjectDef(0x6099, 1, "Speed during search for switch", U32, Access.RW, 100_000, unit=speed, scale=1e-6),
        ObjectDef(0x6099, 2, "Speed during search for zero", U32, Access.RW, 10_000, unit=speed, scale=1e-6),
        ObjectDef(0x609A, 0, "Homing acceleration", U32, Access.RW, 1_000_000, unit=f"{unit}/s²", scale=1e-6),
    ]


def _gate_objects() -> list[ObjectDef]:
    """The safety gate before the set points (drivers/gate.py). Margin: most change of a target from SYNC to SYNC, as a multiple of what
    the velocity limit allows; 0 (as shipped): any, for masters that let targets jump and leave the way there to the drive."""
    return [
        ObjectDef(0x2100, 0, "Gate: most change of a target", U16, Access.RW, 0, unit="velocity limit", scale=1e-3),
        ObjectDef(0x2101, 0, "Gate: set points refused", U32, Access.RO, 0),
        ObjectDef(0x2102, 0, "Gate: set points limited", U32, Access.RO, 0),
    ]


def _unit_objects(linear: bool) -> list[ObjectDef]:
    unit = UNIT_MICROMETRE if linear else UNIT_MICRORADIAN
    return [
        ObjectDef(0x60A8, 0, "SI unit position", U32, Access.RO, unit),
        ObjectDef(0x60A9, 0, "SI unit velocity", U32, Access.RO, unit | PER_SECOND),
    ]
