"""The units of a drive as exact scales, and values of the table turned into them, never to the looser side.

A unit word (60A8h, 60A9h, 60AAh; notation after CiA 303-2): byte 3 power of ten, byte 2 numerator, byte 1 denominator, byte 0 zero.
Numbers of encoder increments, gears and feeds are those of 608Fh, 6091h, 6092h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

PI_LOW = Fraction(3_141_592_653_589_793_238_462_643_383_279_502_884_197, 10**39)
PI_HIGH = PI_LOW + Fraction(1, 10**39)

METRE, INCREMENT, RPM = 0x01, 0xB5, 0xC0
PER_SECOND, PER_MINUTE, PER_SECOND_SQUARED = 0x03, 0x47, 0x57
_TURN = 0xB4


@dataclass(frozen=True, slots=True)
class Scale:
    """SI value = wire integer x `ratio` x π^`pi`; `pi` is 0 or 1."""

    ratio: Fraction
    pi: int = 0

    def __float__(self) -> float:
        return float(self.ratio * PI_LOW**self.pi)

    def times(self, factor: Fraction) -> Scale:
        """A unit of so many of this one."""
        return Scale(self.ratio * factor, self.pi)

    def with_pi(self) -> Scale:
        """π times this one, which has none."""
        return Scale(self.ratio, self.pi + 1)


TURN = Scale(Fraction(2), 1)
_ANGLES = {
    0x10: Scale(Fraction(1)),  # radian
    0x40: Scale(Fraction(1, 200), 1),  # grade
    0x41: Scale(Fraction(1, 180), 1),  # degree
    0x42: Scale(Fraction(1, 10_800), 1),  # minute of arc
    0x43: Scale(Fraction(1, 648_000), 1),  # second of arc
    _TURN: TURN,
}
_TIMES = {
    0: {0x00: 1},
    1: {PER_SECOND: 1, PER_MINUTE: 60},
    2: {PER_SECOND_SQUARED: 1},
}
_NAMES = {0: "60A8h, position", 1: "60A9h, velocity", 2: "60AAh, acceleration"}


class UnitError(ValueError):
    """Units that cannot be used: what is `expected`, and what `came`."""

    def __init__(self, expected: str, came: str) -> None:
        super().__init__(f"expected {expected}, came {came}")
        self.expected = expected
        self.came = came


def unit_scale(word: int, derivative: int, *, linear: bool, increment: Scale | None = None) -> Scale:
    """Scale of a unit word of position (`derivative` 0), velocity (1) or acceleration (2), to m or rad and seconds.

    `linear`: the axis moves in metres. `increment`: how far it goes in an encoder increment, where that is known.
    Raises UnitError for a unit that is none of these, naming the word and what would be right.
    """
    exponent = (word >> 24 & 0xFF) - (256 if word >> 31 else 0)
    numerator, denominator = word >> 16 & 0xFF, word >> 8 & 0xFF
    lengths = {METRE: Scale(Fraction(1))} if linear else _ANGLES
    length = increment if numerator == INCREMENT else lengths.get(numerator)
    per = _TIMES[derivative].get(denominator)
    if derivative == 2 and (numerator, denominator) == (RPM, PER_SECOND) and not linear:
        length, per = TURN, 60  # revolutions per minute, per second
    if length is None or per is None or word & 0xFF:
        raise UnitError(_right(derivative, linear=linear), f"SI unit {word:08X}h")
    return length.times(Fraction(10) ** exponent / per)


def _right(derivative: int, *, linear: bool) -> str:
    time = ("", " per second (03h) or minute (47h)", " per s² (57h)")[derivative]
    lengths = (
        "metre (01h)"
        if linear
        else "radian (10h), degree (41h), revolution (B4h) or increment (B5h, with 608Fh sub 1 and 2)"
    )
    example = (0xFA01_0000 if linear else 0xFA10_0000) | (0, PER_SECOND << 8, PER_SECOND_SQUARED << 8)[derivative]
    return f"{lengths}{time} in {_NAMES[derivative]}, e.g. {example:08X}h"


def converted(value: int, table: Scale, drive: Scale, *, up: bool) -> int:
    """`value` times `table` in units of `drive`, rounded up or down: exact, π included."""
    quotient = value * table.ratio / drive.ratio
    power = table.pi - drive.pi
    bounds = [quotient * pi**power for pi in (PI_LOW, PI_HIGH)]
    return math.ceil(max(bounds)) if up else math.floor(min(bounds))


def interpolation_period(period_ns: int) -> tuple[int, int]:
    """(60C2h sub 1, sub 2): period = value x 10^index s, with the finest value that fits 1 … 255.

    Exact for 10, 5, 4, 2.5 ms and the like, else the nearest, within 2 %. Raises ValueError outside 1 µs … 25.5 s.
    """
    for index in range(-6, 0):
        unit_ns = 10 ** (9 + index)
        value = (period_ns + unit_ns // 2) // unit_ns
        if period_ns % unit_ns == 0 and 1 <= value <= 255:
            return _coarsest(value, index)
    for index in range(-6, 0):
        unit_ns = 10 ** (9 + index)
        value = (period_ns + unit_ns // 2) // unit_ns
        if 1 <= value <= 255:
            return value, index
    raise ValueError(f"SYNC period {period_ns} ns: must be within 1 µs … 25.5 s for 60C2h")


def _coarsest(value: int, index: int) -> tuple[int, int]:
    while value % 10 == 0 and index < -3:
        value, index = value // 10, index + 1
    return value, index
