"""The objects of a drive that set it up, in SI and checked: units, limits, ramps, option codes, periods."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.cia402.bank_axis import AxisLimits
from drivers.objects import Value

I32_MIN, I32_MAX, U32_MAX = -(1 << 31), (1 << 31) - 1, (1 << 32) - 1

LIMITS = (0x6065, 0), (0x6066, 0), (0x6072, 0), (0x607D, 1), (0x607D, 2), (0x607F, 0), (0x6085, 0), (0x60C5, 0)
_MUST_BE_POSITIVE = (0x607F, 0x6084, 0x6085, 0x60C5)
_SLOWEST = 1e-6
HOMING_METHODS = (35, 37)
"""Both: the current position becomes the home position; 35 is the older number of 37."""


class AbortConnection(IntEnum):
    """6007h. Vendors differ; here it answers every loss of communication of an enabled drive."""

    NOTHING = 0
    """Stay enabled, brake with 6084h, hold; go on when set points come again."""
    FAULT = 1
    DISABLE_VOLTAGE = 2
    QUICK_STOP = 3


class QuickStop(IntEnum):
    """605Ah; 3, 4, 7, 8 (current and voltage limit) are not supported."""

    DISABLE = 0
    SLOW_DOWN = 1
    QUICK_STOP_RAMP = 2
    SLOW_DOWN_AND_STAY = 5
    QUICK_STOP_RAMP_AND_STAY = 6


_OPTIONS: dict[int, tuple[int, ...]] = {
    0x6007: tuple(AbortConnection),
    0x605A: tuple(QuickStop),
    0x605B: (0, 1),
    0x605C: (0, 1),
    0x605D: (1, 2),
    0x605E: (0, 1, 2),
    0x6098: HOMING_METHODS,
}


class DriveParameters:
    """Parameters of one drive, read from its dictionary when asked.

    Writes that make no sense are refused: modes that `supported` (6502h) lacks, option codes without a meaning here,
    limits of zero, a lower position limit above the upper one. `on_limits` is called when a limit has changed.
    """

    def __init__(self, dictionary: ObjectDictionary, supported: int, on_limits: Callable[[], None]) -> None:
        self._dictionary = dictionary
        self._supported = supported
        self._on_limits = on_limits
        self.position_scale = dictionary.entry(0x6064).definition.scale
        self.velocity_scale = dictionary.entry(0x606C).definition.scale
        self.period_ns = 0
        for index, meanings in _OPTIONS.items():
            dictionary.bind(index, check=_one_of(index, meanings))
        for index in _MUST_BE_POSITIVE:
            dictionary.bind(index, check=_positive(index))
        dictionary.bind(0x607D, 1, check=self._check_lower)
        dictionary.bind(0x607D, 2, check=self._check_upper)
        dictionary.bind(0x6060, check=self._check_mode)
        for key in LIMITS:
            dictionary.bind(*key, sink=self._limits_changed)
        for subindex in (1, 2):
            dictionary.bind(0x60C2, subindex, sink=self._period_changed)
        self.refresh()

    def refresh(self) -> None:
        """Takes over what the dictionary has now; after a reset."""
        value, exponent = self._dictionary.integer(0x60C2, 1), self._dictionary.integer(0x60C2, 2)
        self.period_ns = max(value, 1) * 10 ** (9 + exponent)

    @property
    def torque_scale(self) -> float:
        """N·m (N) per wire unit, a thousandth of the rated torque."""
        return self._dictionary.integer(0x6076) * 1e-6

    @property
    def limits(self) -> AxisLimits:
        """Limits in SI; the ends of the wire's range mean: none."""
        lower, upper = self._dictionary.integer(0x607D, 1), self._dictionary.integer(0x607D, 2)
        window = self._dictionary.integer(0x6065)
        return AxisLimits(
            lower=-math.inf if lower == I32_MIN else lower * self.position_scale,
            upper=math.inf if upper == I32_MAX else upper * self.position_scale,
            velocity=max(self._si(0x607F), _SLOWEST),
            acceleration=max(self._si(0x60C5), _SLOWEST),
            quick_stop_deceleration=self.quick_stop_deceleration,
            torque=max(self._dictionary.integer(0x6072) * self.torque_scale, _SLOWEST),
            following_error=math.inf if window == U32_MAX else window * self.position_scale,
            following_error_time_s=self._dictionary.integer(0x6066) * 1e-3,
        )

    @property
    def quick_stop_deceleration(self) -> float:
        """6085h in rad/s²."""
        return max(self._si(0x6085), _SLOWEST)

    @property
    def deceleration(self) -> float:
        """6084h in rad/s², the slow down ramp."""
        return max(self._si(0x6084), _SLOWEST)

    @property
    def abort_connection(self) -> AbortConnection:
        return AbortConnection(self._dictionary.integer(0x6007))

    @property
    def quick_stop(self) -> QuickStop:
        return QuickStop(self._dictionary.integer(0x605A))

    def option(self, index: int) -> int:
        """Present value of 605Bh … 605Eh."""
        return self._dictionary.integer(index)

    def _si(self, index: int) -> float:
        entry = self._dictionary.entry(index)
        return int(entry.read()) * entry.definition.scale

    def _limits_changed(self, _: Value) -> None:
        self._on_limits()

    def _period_changed(self, _: Value) -> None:
        self.refresh()

    def _check_mode(self, value: Value) -> None:
        mode = int(value)
        if mode != 0 and not (mode > 0 and self._supported >> mode - 1 & 1):
            raise SdoAbort(AbortCode.INVALID_VALUE, f"6060h = {mode}: 6502h = {self._supported:X}h has the modes")

    def _check_lower(self, value: Value) -> None:
        if int(value) >= self._dictionary.integer(0x607D, 2):
            raise SdoAbort(AbortCode.MAXIMUM_BELOW_MINIMUM, f"607Dh:1 = {value}: must be below 607Dh:2")

    def _check_upper(self, value: Value) -> None:
        if int(value) <= self._dictionary.integer(0x607D, 1):
            raise SdoAbort(AbortCode.MAXIMUM_BELOW_MINIMUM, f"607Dh:2 = {value}: must be above 607Dh:1")


def _one_of(index: int, meanings: tuple[int, ...]) -> Callable[[Value], None]:
    def check(value: Value) -> None:
        if value not in meanings:
            known = ", ".join(str(int(meaning)) for meaning in meanings)
            raise SdoAbort(AbortCode.INVALID_VALUE, f"{index:04X}h = {value}: one of {known}")

    return check


def _positive(index: int) -> Callable[[Value], None]:
    def check(value: Value) -> None:
        if int(value) <= 0:
            raise SdoAbort(AbortCode.VALUE_TOO_LOW, f"{index:04X}h = {value}: must be positive")

    return check
