"""What a value of the table is in a drive that counts in units of its own: limits get tighter by the rounding, never looser."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from drivers.cia402.units import PI_LOW, Scale, UnitError, converted
from drivers.objects import DeviceDef

POSITIONS = (0x6065, 0x6067, 0x607A, 0x607C, 0x607D, 0x60B0, 0x60F4)
VELOCITIES = (0x606D, 0x606F, 0x607F, 0x6081, 0x6099, 0x60B1, 0x60FF)
ACCELERATIONS = (0x6083, 0x6084, 0x6085, 0x609A, 0x60C5, 0x60C6)
TORQUES = (0x6071, 0x6072, 0x60B2)
LIMITS = ((0x6065, 0), (0x6072, 0), (0x607D, 1), (0x607D, 2), (0x607F, 0), (0x6085, 0), (0x60C5, 0))
UPWARDS = frozenset({(0x607D, 1), (0x6084, 0), (0x6085, 0)})
"""A higher number is the tighter one: the lower end of the joint, and ramps that must not get longer."""
_SAID_BY = {
    **dict.fromkeys(POSITIONS, "60A8h"),
    **dict.fromkeys(VELOCITIES, "60A9h"),
    **dict.fromkeys(ACCELERATIONS, "60AAh"),
    **dict.fromkeys(TORQUES, "6076h"),
}
_I32_MIN, _I32_MAX, _U32_MAX = -(1 << 31), (1 << 31) - 1, (1 << 32) - 1
NO_LIMIT = {(0x607D, 1): _I32_MIN, (0x607D, 2): _I32_MAX, (0x6065, 0): _U32_MAX}
"""Values that say: no such limit. They have no unit."""
MOST_OFF = Fraction(1, 10)
"""A limit that rounding makes tighter by more than this share is refused: its unit is too coarse."""
COARSEST_POSITION = 5e-4
"""rad or m: a set point that can only be told in larger steps makes the axis rattle."""
COARSEST_VELOCITY = 0.01
"""Of the highest velocity, for an axis that follows velocities."""


@dataclass(frozen=True, slots=True)
class DriveUnits:
    """Scales from wire to rad or m and seconds; `effort`: N·m or N at the joint for a thousandth of the rated torque."""

    position: Scale
    velocity: Scale
    acceleration: Scale
    effort: Scale

    def of(self, index: int) -> Scale | None:
        """Scale of an object; None where it has none of these units."""
        for indices, scale in (
            (POSITIONS, self.position),
            (VELOCITIES, self.velocity),
            (ACCELERATIONS, self.acceleration),
            (TORQUES, self.effort),
        ):
            if index in indices:
                return scale
        return None


def is_linear(device: DeviceDef) -> bool:
    """Whether the axis moves in metres."""
    return device.object(0x6064).unit == "m"


def units_of_table(device: DeviceDef) -> DriveUnits:
    """The units that the numbers of the device's definition have."""
    position = _scale(device, 0x6064)
    rated_torque = next((int(entry.default) for entry in device.objects if entry.key == (0x6076, 0)), 1000)
    return DriveUnits(position, _scale(device, 0x606C), position, Scale(Fraction(rated_torque, 10**6)))


def _scale(device: DeviceDef, index: int) -> Scale:
    return Scale(Fraction(str(device.object(index).scale)))  # 1e-6 is meant, not the nearest binary fraction


def check_resolution(device: DeviceDef, position: Scale, velocity: Scale, *, follows_positions: bool) -> None:
    """Raises UnitError where set points can be told too coarsely."""
    if follows_positions:
        step = float(position)
        if step > COARSEST_POSITION:
            unit = "m" if is_linear(device) else "rad"
            raise UnitError(f"a position unit of at most {COARSEST_POSITION:g} {unit} (60A8h)", f"{step:.3g} {unit}")
        return
    highest = int(device.object(0x607F).default) * float(units_of_table(device).velocity)
    if float(velocity) > COARSEST_VELOCITY * highest:
        most = COARSEST_VELOCITY * highest
        raise UnitError(f"a velocity unit of at most {most:.3g} rad/s or m/s (60A9h)", f"{float(velocity):.3g}")


def check_limits(device: DeviceDef, units: DriveUnits) -> None:
    """Raises UnitError where a limit of the table cannot be said in `units`, see `in_drive_units`."""
    for entry in device.objects:
        if entry.key in LIMITS:
            in_drive_units(device, units, entry.key, int(entry.default))


def in_drive_units(device: DeviceDef, units: DriveUnits, key: tuple[int, int], value: int) -> int:
    """What to write so that the drive keeps to `value` of the table, or to less.

    Torque limits are at most `value` thousandths of the drive's own rated torque as well: the table's protect the arm, its own the
    motor. Raises UnitError for a unit that is so coarse that the limit is another one, or so fine that the number does not fit.
    """
    table_units = units_of_table(device)
    table, drive = table_units.of(key[0]), units.of(key[0])
    if table is None or drive is None or table == drive or NO_LIMIT.get(key) == value:
        return value
    number = converted(value, table, drive, up=key in UPWARDS)
    if key[0] in TORQUES:
        number = min(number, value)
    name = f"{key[0]:04X}h sub {key[1]}"
    size = f"{float(drive):.3g} in {_SAID_BY[key[0]]}"
    wanted = f"{value} of the table ({value * float(table):.6g} in SI)"
    low, high = _range(device, key)
    if not low <= number <= high or NO_LIMIT.get(key) == number:
        raise UnitError(f"a unit in which {name} = {wanted} fits {low} … {high}", f"a unit of {size}: {number}")
    if key[0] != 0x607D and key[0] not in TORQUES and value:
        exact = value * table.ratio / drive.ratio * PI_LOW ** (table.pi - drive.pi)
        if abs(number - exact) > MOST_OFF * abs(exact):
            raise UnitError(f"a unit that is fine enough for {name} = {wanted}", f"a unit of {size}")
    if key[0] in TORQUES and value and not number:
        raise UnitError(
            f"a rated torque of which {name} = {wanted} is a thousandth at least", f"a thousandth of {size}"
        )
    return number


def _range(device: DeviceDef, key: tuple[int, int]) -> tuple[int, int]:
    data_type = device.object(*key).data_type
    if data_type.signed:
        return -(1 << data_type.bits - 1), (1 << data_type.bits - 1) - 1
    return 0, (1 << data_type.bits) - 1
