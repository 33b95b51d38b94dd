"""Values of the object dictionary to bytes and back: CiA 301, chapter 7.1.4 (little endian)."""

from __future__ import annotations

import math
import struct

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.objects import DataType, Value

STRUCT_FORMAT = {
    DataType.INTEGER8: "b",
    DataType.INTEGER16: "h",
    DataType.INTEGER32: "i",
    DataType.UNSIGNED8: "B",
    DataType.UNSIGNED16: "H",
    DataType.UNSIGNED32: "I",
    DataType.REAL32: "f",
    DataType.REAL64: "d",
}
"""Types that `struct` knows; the others are BOOLEAN, the 24 bit integers and strings."""

MAX_STRING_BYTES = 255
_REAL32_MAX = 3.4028234663852886e38


def byte_length(data_type: DataType) -> int:
    """Bytes of a value in an SDO; 0 for strings, which have any length."""
    return (data_type.bits + 7) // 8


def limits(data_type: DataType) -> tuple[int | float, int | float]:
    """Lowest and highest value that the type can carry. Not for strings."""
    if data_type is DataType.REAL32:
        return -_REAL32_MAX, _REAL32_MAX
    if data_type is DataType.REAL64:
        return -math.inf, math.inf
    if data_type.signed:
        return -(1 << data_type.bits - 1), (1 << data_type.bits - 1) - 1
    return 0, (1 << data_type.bits) - 1


def encode(data_type: DataType, value: Value) -> bytes:
    """Raises OverflowError or struct.error for a number that the type cannot carry."""
    if data_type is DataType.VISIBLE_STRING:
        return str(value).encode("ascii")
    if data_type in STRUCT_FORMAT:
        return struct.pack("<" + STRUCT_FORMAT[data_type], value)
    return int(value).to_bytes(byte_length(data_type), "little", signed=data_type.signed)


def decode(data_type: DataType, data: bytes) -> Value:
    """Raises SdoAbort: length too high or too low, text that is not ASCII, a number that is not finite."""
    if data_type is DataType.VISIBLE_STRING:
        if not data.isascii():
            raise SdoAbort(AbortCode.INVALID_VALUE, "a VISIBLE_STRING is ASCII")
        return data.rstrip(b"\0").decode("ascii")
    expected = byte_length(data_type)
    if len(data) != expected:
        code = AbortCode.LENGTH_TOO_HIGH if len(data) > expected else AbortCode.LENGTH_TOO_LOW
        raise SdoAbort(code, f"{data_type.name} has {expected} bytes, not {len(data)}")
    if data_type in (DataType.REAL32, DataType.REAL64):
        number: float = struct.unpack("<" + STRUCT_FORMAT[data_type], data)[0]
        if not math.isfinite(number):
            raise SdoAbort(AbortCode.INVALID_VALUE, f"{number} is not a finite number")
        return number
    return int.from_bytes(data, "little", signed=data_type.signed)
