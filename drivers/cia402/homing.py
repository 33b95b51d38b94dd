"""Homing mode (6) of a drive with an absolute encoder: methods 35 and 37, where it stands becomes the home position."""

from __future__ import annotations

from drivers.canopen.dictionary import ObjectDictionary
from drivers.cia402.bank_axis import BankAxis
from drivers.cia402.states import Control, Status

STANDING = 0.01
"""Homing needs an axis that is slower than this fraction of its velocity limit."""


class Homing:
    """Homing procedure and its bits in the statusword; begun by a rising edge of controlword bit 4."""

    def __init__(self, dictionary: ObjectDictionary, axis: BankAxis) -> None:
        self._dictionary = dictionary
        self._axis = axis
        self._scale = dictionary.entry(0x6064).definition.scale
        self.reset()

    def reset(self) -> None:
        """The mode was entered: not homed in it yet."""
        self.attained = False
        self.failed = False

    def on_controlword(self, controlword: int, previous: int) -> None:
        """Homes on a rising edge of bit 4, unless the axis moves (homing error)."""
        if not controlword & ~previous & Control.START_HOMING or controlword & Control.HALT:
            return
        top_speed = self._dictionary.integer(0x607F) * self._dictionary.entry(0x607F).definition.scale
        self.failed = abs(self._axis.velocity) > STANDING * top_speed
        self.attained = not self.failed
        if self.attained:
            self._axis.make_home(self._dictionary.integer(0x607C) * self._scale)

    @property
    def status(self) -> int:
        """Bits 10, 12, 13: not started 1 0 0, completed 1 1 0, error while moving 0 0 1."""
        if self.failed:
            return Status.HOMING_ERROR
        return Status.TARGET_REACHED | (Status.HOMING_ATTAINED if self.attained else 0)
