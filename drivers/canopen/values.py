"""Values of an object and their bytes in an SDO: little endian, after CiA 301, 7.1.4."""

from __future__ import annotations

import struct

from drivers.objects import DataType, Value


def encode_value(data_type: DataType, value: Value) -> bytes:
    """The bytes of a value. Raises ValueError where it does not fit its type."""
    if data_type is DataType.VISIBLE_STRING:
        return str(value).encode("ascii")
    if data_type is DataType.REAL32:
        return struct.pack("<f", value)
    if data_type is DataType.REAL64:
        return struct.pack("<d", value)
    if not isinstance(value, int):
        raise ValueError(f"{value!r}: an {data_type.name} takes an integer")
    bits = data_type.bits
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if data_type.signed else (0, (1 << bits) - 1)
    if not low <= value <= high:
        raise ValueError(f"{value}: an {data_type.name} must be within {low} … {high}")
    return value.to_bytes((bits + 7) // 8, "little", signed=data_type.signed)


def decode_value(data_type: DataType, data: bytes) -> Value:
    """The value of these bytes. Raises ValueError for another number of bytes than the type has."""
    if data_type is DataType.VISIBLE_STRING:
        return data.rstrip(b"\0").decode("ascii", errors="replace")
    length = (data_type.bits + 7) // 8
    if len(data) != length:
        raise ValueError(f"{len(data)} bytes ({data.hex(' ')}): an {data_type.name} has {length}")
    if data_type is DataType.REAL32 or data_type is DataType.REAL64:
        number: float = struct.unpack("<f" if length == 4 else "<d", data)[0]
        return number
    return int.from_bytes(data, "little", signed=data_type.signed)
