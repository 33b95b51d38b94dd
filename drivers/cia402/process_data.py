"""Cyclic data of a drive: targets and offsets from the wire to SI, actual values back."""

from __future__ import annotations

import math

from drivers.canopen.dictionary import ObjectDictionary
from drivers.cia402.bank_axis import BankAxis
from drivers.cia402.parameters import DriveParameters
from drivers.cia402.states import Mode
from drivers.objects import Value
from stack.servo.limiter import (
    LIMITED_ACCELERATION,
    LIMITED_POSITION,
    LIMITED_TORQUE,
    LIMITED_VELOCITY,
)

LIMITED = LIMITED_POSITION | LIMITED_VELOCITY | LIMITED_ACCELERATION | LIMITED_TORQUE
"""Flags of the loops that make statusword bit 11."""
_TURN = 1 << 32
_REACHED = 0.01
"""Target reached: within this fraction of the following error window, or of the highest velocity or torque."""
_TARGETS = {Mode.CYCLIC_POSITION: 0x607A, Mode.CYCLIC_VELOCITY: 0x60FF, Mode.CYCLIC_TORQUE: 0x6071}
_OFFSETS = {Mode.CYCLIC_POSITION: 0x60B0, Mode.CYCLIC_VELOCITY: 0x60B1}


class ProcessData:
    """Targets 607Ah, 60FFh, 6071h, offsets 60B0h … 60B2h, actual values 6064h, 606Ch, 6077h, 60F4h of one drive.

    Positions wrap on the wire as its 32 bits do; an axis without position limits may turn on for ever.
    """

    def __init__(self, dictionary: ObjectDictionary, axis: BankAxis, parameters: DriveParameters) -> None:
        self._dictionary = dictionary
        self._axis = axis
        self._position_scale = parameters.position_scale
        self._velocity_scale = parameters.velocity_scale
        self._torque_scale = parameters.torque_scale
        self._fresh = False
        self._targets = {mode: dictionary.entry(index) for mode, index in _TARGETS.items()}
        self._offsets = {mode: dictionary.entry(index) for mode, index in _OFFSETS.items()}
        self._torque_offset = dictionary.entry(0x60B2)
        self._velocity_limit = dictionary.entry(0x607F)
        self._torque_limit = dictionary.entry(0x6072)
        self._window = dictionary.entry(0x6065)
        self.set_mode(Mode.NONE)
        for index in _TARGETS.values():
            dictionary.bind(index, sink=self._on_target)
        dictionary.bind(0x6064, source=self.position)
        dictionary.bind(0x606C, source=self.velocity)
        dictionary.bind(0x6077, source=self.torque)
        dictionary.bind(0x60F4, source=self.following_error)

    def set_mode(self, mode: Mode) -> None:
        """Which target counts from now on."""
        self._mode = mode
        self._target = self._targets.get(mode)
        self._offset = self._offsets.get(mode)
        self._target_scale = {
            Mode.CYCLIC_POSITION: self._position_scale,
            Mode.CYCLIC_VELOCITY: self._velocity_scale,
        }.get(mode, self._torque_scale)

    def take_fresh(self) -> bool:
        """Whether a target was written since the last call."""
        fresh, self._fresh = self._fresh, False
        return fresh

    def seed(self) -> None:
        """Targets that change nothing: where the axis is, no velocity, no torque."""
        self._targets[Mode.CYCLIC_POSITION].value = self.position()
        self._targets[Mode.CYCLIC_VELOCITY].value = 0
        self._targets[Mode.CYCLIC_TORQUE].value = 0

    def pass_on(self, sync_ns: int, period_ns: int) -> None:
        """Gives the target of the present mode and the torque offset to the loops."""
        if self._target is None:
            return
        wire = int(self._target.value)
        if self._offset is not None:
            wire += int(self._offset.value)
        if self._mode is Mode.CYCLIC_POSITION:
            present = self._axis.position / self._position_scale
            wire += _TURN * round((present - wire) / _TURN)  # the nearest of all places that read like this
        self._axis.accept(
            wire * self._target_scale, int(self._torque_offset.value) * self._torque_scale, sync_ns, period_ns
        )

    def position(self) -> int:
        """6064h."""
        return (round(self._axis.position / self._position_scale) + _TURN // 2) % _TURN - _TURN // 2

    def velocity(self) -> int:
        """606Ch."""
        return _clip(self._axis.velocity / self._velocity_scale, 32)

    def torque(self) -> int:
        """6077h: the torque that the loops command, in thousandths of the rated one."""
        return _clip(self._axis.torque / self._torque_scale, 16)

    def following_error(self) -> int:
        """60F4h."""
        return _clip(self._axis.following_error / self._position_scale, 32)

    @property
    def standing(self) -> bool:
        """The axis does not move."""
        return abs(self.velocity()) <= _REACHED * int(self._velocity_limit.value)

    def target_reached(self) -> bool:
        """Statusword bit 10 of a cyclic mode."""
        if self._target is None:
            return False
        wire = int(self._target.value)
        if self._mode is Mode.CYCLIC_POSITION:
            distance = (self.position() - wire + _TURN // 2) % _TURN - _TURN // 2
            return abs(distance) <= _REACHED * int(self._window.value)
        if self._mode is Mode.CYCLIC_VELOCITY:
            return abs(self.velocity() - wire) <= _REACHED * int(self._velocity_limit.value)
        return abs(self.torque() - wire) <= _REACHED * int(self._torque_limit.value)

    def _on_target(self, _: Value) -> None:
        self._fresh = True


def _clip(value: float, bits: int) -> int:
    """Rounded, and within what `bits` bits can say; no number at all reads as the most negative one."""
    limit = 1 << bits - 1
    if math.isnan(value):
        return -limit
    return round(min(max(value, -limit), limit - 1))
