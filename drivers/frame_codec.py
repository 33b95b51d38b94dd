"""One process-data frame between SI values and bytes, compiled from the catalogue's definition of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.checksum import frame_checksum, start_value
from drivers.objects import DeviceDef, PdoDef

Number = int | float


class CodecError(ValueError):
    """A frame that cannot be read, or a message that cannot be sent."""


class UnknownFrameError(CodecError):
    """No message has this identifier."""


class WrongLengthError(CodecError):
    """The frame has another length than its definition."""


class WrongChecksumError(CodecError):
    """Payload, counter or identifier were changed on the way."""


class InvalidValueError(CodecError):
    """A value outside what its definition allows: a mode that does not exist, not a number."""


@dataclass(frozen=True, slots=True)
class Field:
    """Where a value is in the frame (bit 0 = least significant bit of the first byte) and what it stands for."""

    name: str
    shift: int
    bits: int
    signed: bool
    scale: float
    low: int
    high: int
    unit: str


def fields_of(device: DeviceDef, pdo: PdoDef) -> tuple[Field, ...]:
    """The fields of a PDO in the order of its mapping."""
    fields = []
    shift = 0
    for key in pdo.mapping:
        entry = device.object(*key)
        bits, signed = entry.data_type.bits, entry.data_type.signed
        low = -(1 << bits - 1) if signed else 0
        high = (1 << bits - 1) - 1 if signed else (1 << bits) - 1
        low = low if entry.low is None else max(low, int(entry.low))
        high = high if entry.high is None else min(high, int(entry.high))
        fields.append(Field(entry.name, shift, bits, signed, entry.scale, low, high, entry.unit))
        shift += bits
    return tuple(fields)


class FastFrameCodec:
    """A frame of 8 bytes that ends in a counter and a checksum."""

    __slots__ = ("_packing", "_start", "_unpacking", "can_id", "fields", "name")

    def __init__(self, device: DeviceDef, name: str) -> None:
        """The TPDO `name` of `device`. Raises KeyError when there is none."""
        pdo = next((pdo for pdo in device.pdos if pdo.name == name), None)
        if pdo is None:
            raise KeyError(f"{device.name} has no PDO {name!r}: it has {[pdo.name for pdo in device.pdos]}")
        self.name = name
        self.can_id = pdo.cob_id
        *signals, _, _ = fields_of(device, pdo)
        self.fields = tuple(signals)
        self._start = start_value(pdo.cob_id)
        self._packing = [(f.name, f.shift, (1 << f.bits) - 1, 1.0 / f.scale, f.low, f.high) for f in signals]
        self._unpacking = [
            (f.shift, (1 << f.bits) - 1, 1 << f.bits - 1 if f.signed else 0, 1 if f.scale == 1.0 else f.scale)
            for f in signals
        ]

    def encode(self, values: Sequence[Number], counter: int) -> tuple[bytes, bool]:
        """SI values in the order of `fields` -> (8 bytes, whether a value was limited to what the wire can carry).

        The counter wraps at 256. Raises InvalidValueError for what is not a finite number.
        """
        word = (counter & 0xFF) << 48
        was_limited = False
        for value, (name, shift, mask, per_unit, low, high) in zip(values, self._packing, strict=True):
            try:
                raw = round(value * per_unit)
            except (ValueError, OverflowError):
                raise InvalidValueError(f"{self.name}.{name} = {value}: must be a finite number") from None
            if raw > high:
                raw = high
                was_limited = True
            elif raw < low:
                raw = low
                was_limited = True
            word |= (raw & mask) << shift
        payload = word.to_bytes(7, "little")
        return payload + frame_checksum(self._start, payload).to_bytes(1, "little"), was_limited

    def decode(self, data: bytes) -> tuple[list[Number], int]:
        """8 bytes -> (SI values in the order of `fields`, counter); whole numbers where the scale is 1.

        Raises WrongLengthError, WrongChecksumError.
        """
        if len(data) != 8:
            raise WrongLengthError(f"{self.name} ({self.can_id:03X}h): {len(data)} bytes; must be 8")
        if frame_checksum(self._start, data[:7]) != data[7]:
            raise WrongChecksumError(
                f"{self.name} ({self.can_id:03X}h): checksum {data[7]:02X}h;"
                f" must be {frame_checksum(self._start, data[:7]):02X}h"
            )
        word = int.from_bytes(data, "little")
        return [(((word >> shift & mask) ^ sign) - sign) * scale for shift, mask, sign, scale in self._unpacking], data[
            6
        ]
