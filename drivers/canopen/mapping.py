"""PDO mapping parameters compiled to one pack and one unpack (CiA 301, 7.5.2.36 and 7.5.2.38)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.data_types import STRUCT_FORMAT
from drivers.canopen.dictionary import Entry, ObjectDictionary
from drivers.objects import Access, DataType, Value

MAX_BITS = 64
_FIRST_REAL_INDEX = 0x20
"""Below, an index is a data type: a dummy entry, which leaves a gap in an RPDO."""


@dataclass(frozen=True, slots=True)
class Field:
    """One mapped object, or a gap (`entry` None)."""

    entry: Entry | None
    data_type: DataType


def resolve(dictionary: ObjectDictionary, word: int, receive: bool) -> Field:
    """The object that one mapping entry (index, subindex, bits) means. Raises SdoAbort if it cannot be mapped."""
    index, subindex, bits = word >> 16, word >> 8 & 0xFF, word & 0xFF
    if index < _FIRST_REAL_INDEX and receive:
        dummy = next((kind for kind in DataType if kind == index and kind.is_integer), None)
        if dummy is None or dummy.bits != bits:
            raise SdoAbort(AbortCode.NOT_MAPPABLE, f"{word:08X}h is no dummy entry")
        return Field(None, dummy)
    definition = (entry := dictionary.entry(index, subindex)).definition
    forbidden = (Access.RO, Access.CONST) if receive else (Access.WO,)
    if not definition.mappable or definition.access in forbidden:
        raise SdoAbort(AbortCode.NOT_MAPPABLE, f"{entry.name} cannot be mapped into this PDO")
    if definition.data_type.bits != bits or bits == 0:
        raise SdoAbort(AbortCode.NOT_MAPPABLE, f"{entry.name} has {definition.data_type.bits} bits, not {bits}")
    return Field(entry, definition.data_type)


class Layout:
    """How the objects of one PDO lie in its frame. Raises SdoAbort if they need more than 64 bits."""

    def __init__(self, fields: tuple[Field, ...]) -> None:
        bits = sum(item.data_type.bits for item in fields)
        if bits > MAX_BITS:
            raise SdoAbort(AbortCode.PDO_TOO_LONG, f"{bits} bits mapped: a PDO carries at most {MAX_BITS}")
        self.length = (bits + 7) // 8
        self.fields = fields
        self.entries = tuple(item.entry for item in fields if item.entry is not None)
        self.guarded = any(entry.guarded for entry in self.entries)
        self._readers = tuple(entry.read for entry in self.entries)
        aligned = all(item.data_type in STRUCT_FORMAT for item in fields)
        self._struct = struct.Struct("<" + "".join(_struct_code(item) for item in fields)) if aligned else None

    def pack(self) -> bytes:
        """Present values of the mapped objects."""
        if self._struct is not None:
            return self._struct.pack(*[read() for read in self._readers])
        word = shift = 0
        for item in self.fields:
            bits = item.data_type.bits
            if item.entry is not None:
                word |= _to_bits(item.data_type, item.entry.read()) << shift
            shift += bits
        return word.to_bytes(self.length, "little")

    def unpack(self, data: bytes) -> tuple[Value, ...]:
        """Values for `entries`, in their order. `data` has `length` bytes."""
        if self._struct is not None:
            return self._struct.unpack(data)
        word = int.from_bytes(data, "little")
        values: list[Value] = []
        for item in self.fields:
            bits = item.data_type.bits
            if item.entry is not None:
                values.append(_from_bits(item.data_type, word & (1 << bits) - 1))
            word >>= bits
        return tuple(values)


def _struct_code(item: Field) -> str:
    if item.entry is None:
        return f"{item.data_type.bits // 8}x"
    return STRUCT_FORMAT[item.data_type]


def _to_bits(data_type: DataType, value: Value) -> int:
    if data_type.is_integer:
        bits = data_type.bits
        number = int(value)
        low = -(1 << bits - 1) if data_type.signed else 0
        if not low <= number < low + (1 << bits):
            raise OverflowError(f"{number} does not fit into {data_type.name}")
        return number & (1 << bits) - 1
    return int.from_bytes(struct.pack("<" + STRUCT_FORMAT[data_type], value), "little")


def _from_bits(data_type: DataType, word: int) -> Value:
    if not data_type.is_integer:
        number: float = struct.unpack("<" + STRUCT_FORMAT[data_type], word.to_bytes(data_type.bits // 8, "little"))[0]
        return number
    if data_type.signed and word >> data_type.bits - 1:
        return word - (1 << data_type.bits)
    return word
