"""What a drive is and what it counts in: identity, modes, units. Read once, before anything is written.

A drive that says by 1018h that it is the one of the table, has the objects of the table. Of any other, everything is asked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

from drivers.canopen.abort import AbortCode
from drivers.canopen.sdo_abort import SdoAborted, StepError
from drivers.canopen.sequence import Sequence, Upload
from drivers.cia402.axis import MODE_CSP, AxisClient
from drivers.cia402.bench import BenchDrive
from drivers.cia402.drive_units import DriveUnits, check_resolution, is_linear, units_of_table
from drivers.cia402.units import INCREMENT, PER_SECOND, TURN, Scale, UnitError, unit_scale
from drivers.objects import DataType, DeviceDef

CIA402_PROFILE = 402
ABSENT = (AbortCode.NO_SUCH_OBJECT, AbortCode.NO_SUCH_SUBINDEX)
Note = Callable[[str], None]


def identify(axis: AxisClient, bench: BenchDrive, note: Note) -> Sequence[bool]:
    """Is it the drive that the scenario says, and can it do what is asked of it? True: the one of the table."""
    device_type = yield Upload(0x1000, 0)
    if device_type & 0xFFFF != CIA402_PROFILE:
        profile = device_type & 0xFFFF
        raise StepError("device type 1000h of a drive, profile 402", f"{device_type:08X}h, profile {profile}")
    came: dict[int, int | None] = {}
    for subindex in (1, 2):
        came[subindex] = yield from upload_if_there(0x1018, subindex)
    of_table = {subindex: definition_default(axis.device, 0x1018, subindex) for subindex in (1, 2)}
    wanted = {1: bench.vendor_id, 2: bench.product_code}
    if bench.any_identity:
        note(f"{_words(came)}: taken as it is")
    else:
        if bench.vendor_id is None:
            wanted = of_table
        for subindex, what in ((1, "vendor-ID"), (2, "product code")):
            right = wanted[subindex]
            if right is not None and came[subindex] != right:
                raise StepError(f"{what} {right:#x} in 1018h sub {subindex}", _found(axis, came))
    modes = yield from upload_if_there(0x6502)
    if modes is None:
        note("6502h (supported drive modes) does not exist: 6061h has to show the mode")
    elif not modes >> (axis.mode - 1) & 1:
        raise StepError(f"bit {axis.mode - 1} of the supported modes 6502h (mode {axis.mode})", f"{modes:08X}h")
    return came == of_table


def _words(came: dict[int, int | None]) -> str:
    vendor, product = ("none" if value is None else f"{value:#x}" for value in (came[1], came[2]))
    return f"vendor-ID {vendor}, product code {product}"


def _found(axis: AxisClient, came: dict[int, int | None]) -> str:
    keys = ", ".join(
        f"{name} = 0x{value:X}"
        for name, value in (("vendor_id", came[1]), ("product_code", came[2]))
        if value is not None
    )
    return f"{_words(came)}; if this drive shall be there, say so in the scenario: [drives.{axis.node_id}] {keys}"


def read_units(axis: AxisClient, bench: BenchDrive, *, of_table: bool) -> Sequence[None]:
    """Takes the units from the drive, and from `bench` what it does not say. Nothing is guessed.

    Ends with a StepError that names object, value and what would be right where a unit is missing, unknown, or too coarse.
    """
    device, node_id = axis.device, axis.node_id
    linear = is_linear(device)
    words = yield from _unit_words(device, bench, node_id)
    usual = words == tuple(definition_default(device, index, 0) for index in (0x60A8, 0x60A9))
    everything = not (of_table and usual)
    increment = None
    counted = [f"{index} = {word:08X}h" for index, word in zip(("60A8h", "60A9h"), words, strict=True) if _counts(word)]
    if counted:
        increment = yield from _increment(counted[0], linear=linear)
    try:
        position = unit_scale(words[0], 0, linear=linear, increment=increment)
        velocity = unit_scale(words[1], 1, linear=linear, increment=increment)
        check_resolution(device, position, velocity, follows_positions=axis.mode == MODE_CSP)
        acceleration: Scale | None = position if velocity == position else None
        if everything:
            word = yield from _word(0x60AA, bench.acceleration_unit, node_id, "acceleration_unit")
            if word:
                acceleration = unit_scale(word, 2, linear=linear, increment=increment)
        if acceleration is None:
            raise UnitError(
                f"60AAh (SI unit acceleration), or acceleration_unit in [drives.{node_id}]: 60A8h = {words[0]:08X}h and"
                f" 60A9h = {words[1]:08X}h leave open what 6085h and 60C5h count in",
                "neither",
            )
        units = DriveUnits(position, velocity, acceleration, units_of_table(device).effort)
        effort = yield from _effort(bench, units, node_id, linear=linear, geared=everything)
        axis.set_units(replace(units, effort=effort))
    except UnitError as error:
        raise StepError(error.expected, error.came) from error


def _unit_words(device: DeviceDef, bench: BenchDrive, node_id: int) -> Sequence[tuple[int, int]]:
    position = yield from _word(0x60A8, bench.position_unit, node_id, "position_unit")
    velocity = yield from _word(0x60A9, bench.velocity_unit, node_id, "velocity_unit")
    if not position:
        example = definition_default(device, 0x60A8, 0) or 0
        raise StepError(
            "60A8h (SI unit position), or what it would say as position_unit in"
            f" [drives.{node_id}], e.g. 0x{example:08X}",
            "neither",
        )
    if not velocity:
        raise StepError(
            "60A9h (SI unit velocity), or what it would say as velocity_unit in"
            f" [drives.{node_id}], e.g. 0x{position & 0xFFFF_0000 | PER_SECOND << 8:08X}",
            "neither",
        )
    return position, velocity


def _word(index: int, given: int | None, node_id: int, key: str) -> Sequence[int | None]:
    """A unit word of the drive, `given` where it has none. They must not contradict each other."""
    came = yield from upload_if_there(index)
    if came and given is not None and came != given:
        raise StepError(f"{index:04X}h = {given:08X}h, {key} in [drives.{node_id}]", f"{came:08X}h")
    return came or given


def _counts(word: int) -> bool:
    return word >> 16 & 0xFF == INCREMENT


def _increment(unit: str, *, linear: bool) -> Sequence[Scale]:
    """How far the axis turns in an increment: 608Fh and 6091h. 6092h may say the same, nothing (1 : 1), or not be there."""
    if linear:
        raise StepError("metre (01h) in 60A8h and 60A9h of a linear axis, e.g. FA010000h", f"{unit}, increments")
    resolution = yield from _quotient(0x608F)
    if resolution is None:
        raise StepError(f"608Fh (encoder increments, motor revolutions), since {unit} says increments", "none")
    gear = yield from _quotient(0x6091)
    feed = yield from _quotient(0x6092)
    per_turn = resolution * (1 if gear is None else gear)
    if feed is not None and feed not in (1, per_turn):
        raise StepError(
            f"{per_turn} units in a revolution of the shaft in 6092h, as 608Fh and 6091h say, or 1", f"{feed}"
        )
    return TURN.times(1 / per_turn)


def _effort(bench: BenchDrive, units: DriveUnits, node_id: int, *, linear: bool, geared: bool) -> Sequence[Scale]:
    """What a thousandth of the rated torque is at the joint: 6076h is the motor's, 6091h its gear, 6092h its spindle's feed."""
    if bench.rated_torque_mNm is not None:
        return Scale(Fraction(bench.rated_torque_mNm, 10**6))
    rated = yield from upload_if_there(0x6076)
    if not rated:
        came = "no such object" if rated is None else "0"
        raise StepError(f"a rated torque above 0 in 6076h, or rated_torque_mNm in [drives.{node_id}]", came)
    effort = Scale(Fraction(rated, 10**6))
    if not geared:
        return effort
    gear = yield from _quotient(0x6091)
    effort = effort.times(Fraction(1) if gear is None else gear)
    feed = (yield from _quotient(0x6092)) if linear else None
    if feed is None:
        return effort
    return effort.times(2 / (feed * units.position.ratio)).with_pi()


def _quotient(index: int) -> Sequence[Fraction | None]:
    """Sub 1 / sub 2 of an object; None where it does not exist. Sub 2 that does not exist is 1."""
    numerator = yield from upload_if_there(index, 1)
    if numerator is None:
        return None
    denominator = yield from upload_if_there(index, 2)
    if denominator is None:
        denominator = 1
    if not numerator or not denominator:
        raise StepError(f"numbers above 0 in {index:04X}h sub 1 and 2", f"{numerator} and {denominator}")
    return Fraction(numerator, denominator)


def upload_if_there(index: int, subindex: int = 0) -> Sequence[int | None]:
    """An object as an unsigned number; None where the drive says that it does not exist."""
    try:
        value: int = yield Upload(index, subindex, DataType.UNSIGNED32)
    except SdoAborted as error:
        if error.code in ABSENT:
            return None
        raise
    return value


def definition_default(device: DeviceDef, index: int, subindex: int) -> int | None:
    """The table's value of an object, None where it has no such object."""
    try:
        return int(device.object(index, subindex).default)
    except KeyError:
        return None
