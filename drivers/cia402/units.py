"""SI unit objects of a drive (60A8h, 60A9h) as factors: SI value = wire integer x factor.

Layout (CiA 402, notation after CiA 303-2): byte 3 power of ten, byte 2 numerator, byte 1 denominator, byte 0 zero.
"""

from __future__ import annotations

import math

_NUMERATOR = {0x01: 1.0, 0x10: 1.0, 0x41: math.pi / 180.0, 0xB4: 2.0 * math.pi}  # m, rad, degree, revolution
_DENOMINATOR = {0x00: 1.0, 0x03: 1.0, 0x47: 60.0}  # none, second, minute


def si_factor(unit: int) -> float:
    """Factor of a unit word, to m, rad, m/s or rad/s. Raises ValueError for a unit that is none of these (increments)."""
    prefix = unit >> 24 & 0xFF
    exponent = prefix - 256 if prefix > 127 else prefix
    numerator = _NUMERATOR.get(unit >> 16 & 0xFF)
    denominator = _DENOMINATOR.get(unit >> 8 & 0xFF)
    if numerator is None or denominator is None or unit & 0xFF:
        raise ValueError(
            f"SI unit {unit:08X}h: must be metre (01h), radian (10h), degree (41h) or revolution (B4h), per nothing,"
            " second (03h) or minute (47h); others need their scale in the device's definition"
        )
    # a quotient of exact powers: 1e-6 comes out as 1e-6, not as 9.999…e-7
    power = float(10**exponent) if exponent >= 0 else 1.0 / float(10**-exponent)
    return power * numerator / denominator


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
