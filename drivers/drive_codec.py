"""Set point and feedback of one drive: RPDO1 and TPDO1 between SI and bytes, with the drive's own units."""

from __future__ import annotations

import struct

from drivers.frame_codec import InvalidValueError, WrongLengthError
from drivers.objects import DeviceDef, PdoDef, PdoKind
from stack.messages import DriveFeedback

_I32_MAX = (1 << 31) - 1
_I16_MAX = (1 << 15) - 1
_LAYOUT = struct.Struct("<Hih")
SET_POINTS = (((0x6040, 0), (0x607A, 0), (0x60B2, 0)), ((0x6040, 0), (0x60FF, 0), (0x60B2, 0)))
FEEDBACK = ((0x6041, 0), (0x6064, 0), (0x6077, 0))


class DriveCodec:
    """The fast frames of `device`: 16 bit word, 32 bit position or velocity, 16 bit torque in per mille of 6076h."""

    __slots__ = ("_effort_unit", "_per_effort", "_per_target", "_position_unit", "feedback_id", "name", "set_point_id")

    def __init__(self, device: DeviceDef) -> None:
        """Raises ValueError when RPDO1 or TPDO1 map other objects than these frames have."""
        receive, transmit = _first(device, PdoKind.RPDO), _first(device, PdoKind.TPDO)
        if receive.mapping not in SET_POINTS:
            raise ValueError(f"{device.name} RPDO1 maps {receive.mapping}; must be one of {SET_POINTS}")
        if transmit.mapping != FEEDBACK:
            raise ValueError(f"{device.name} TPDO1 maps {transmit.mapping}; must be {FEEDBACK}")
        self.name = device.name
        self.set_point_id = receive.cob_id
        self.feedback_id = transmit.cob_id
        self._per_target = 1.0 / device.object(*receive.mapping[1]).scale
        self._position_unit = device.object(0x6064).scale
        rated = device.object(0x6076)
        self._effort_unit = float(rated.default) * rated.scale * 1e-3
        self._per_effort = 1.0 / self._effort_unit

    def encode_set_point(self, controlword: int, target: float, effort: float) -> tuple[bytes, bool]:
        """Target in rad, m or rad/s, torque offset in N·m or N -> (8 bytes, whether one of them was limited).

        Raises InvalidValueError for what is not a finite number.
        """
        try:
            raw_target, raw_effort = round(target * self._per_target), round(effort * self._per_effort)
        except (ValueError, OverflowError):
            raise InvalidValueError(f"{self.name}: target {target}, effort {effort}: must be finite numbers") from None
        if -_I32_MAX <= raw_target <= _I32_MAX and -_I16_MAX <= raw_effort <= _I16_MAX:
            return _LAYOUT.pack(controlword, raw_target, raw_effort), False
        raw_target = max(-_I32_MAX, min(_I32_MAX, raw_target))
        raw_effort = max(-_I16_MAX, min(_I16_MAX, raw_effort))
        return _LAYOUT.pack(controlword, raw_target, raw_effort), True

    def decode_set_point(self, data: bytes) -> tuple[int, float, float]:
        """Controlword, target, effort in SI. Raises WrongLengthError."""
        if len(data) != 8:
            raise WrongLengthError(f"{self.name} set point ({self.set_point_id:03X}h): {len(data)} bytes; must be 8")
        word, target, effort = _LAYOUT.unpack(data)
        return word, target / self._per_target, effort * self._effort_unit

    def encode_feedback(self, feedback: DriveFeedback) -> tuple[bytes, bool]:
        """8 bytes, and whether position or effort was limited. Raises InvalidValueError."""
        try:
            position = round(feedback.position / self._position_unit)
            effort = round(feedback.effort * self._per_effort)
        except (ValueError, OverflowError):
            raise InvalidValueError(f"{self.name}: {feedback}: must be finite numbers") from None
        kept_position = max(-_I32_MAX, min(_I32_MAX, position))
        kept_effort = max(-_I16_MAX, min(_I16_MAX, effort))
        data = _LAYOUT.pack(feedback.statusword, kept_position, kept_effort)
        return data, (kept_position, kept_effort) != (position, effort)

    def decode_feedback(self, data: bytes) -> DriveFeedback:
        """Raises WrongLengthError."""
        if len(data) != 8:
            raise WrongLengthError(f"{self.name} feedback ({self.feedback_id:03X}h): {len(data)} bytes; must be 8")
        word, position, effort = _LAYOUT.unpack(data)
        return DriveFeedback(word, position * self._position_unit, effort * self._effort_unit)


def _first(device: DeviceDef, kind: PdoKind) -> PdoDef:
    for pdo in device.pdos:
        if (pdo.kind, pdo.number) == (kind, 1) and pdo.enabled:
            return pdo
    raise ValueError(f"{device.name} has no {kind.value} 1; a drive needs it")
