"""The vocabulary of an object dictionary: what an object, a PDO and a device *are*, as data.

The tables themselves are in `drivers/catalogue.py`; the run-time that serves them is `drivers/canopen/`.
Data type codes and structure after CiA 301, chapter 7.4.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum


class DataType(IntEnum):
    """CiA 301 data type indices (table 44) of the types that are in use here."""

    BOOLEAN = 0x01
    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    REAL32 = 0x08
    VISIBLE_STRING = 0x09
    INTEGER24 = 0x10
    REAL64 = 0x11
    UNSIGNED24 = 0x16

    @property
    def bits(self) -> int:
        """Length on the wire in bits; 0 for strings, whose length is that of their value."""
        return _BITS[self]

    @property
    def signed(self) -> bool:
        return self in (DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER24, DataType.INTEGER32)

    @property
    def is_integer(self) -> bool:
        return self not in (DataType.REAL32, DataType.REAL64, DataType.VISIBLE_STRING)


_BITS = {
    DataType.BOOLEAN: 1,
    DataType.INTEGER8: 8,
    DataType.INTEGER16: 16,
    DataType.INTEGER24: 24,
    DataType.INTEGER32: 32,
    DataType.UNSIGNED8: 8,
    DataType.UNSIGNED16: 16,
    DataType.UNSIGNED24: 24,
    DataType.UNSIGNED32: 32,
    DataType.REAL32: 32,
    DataType.REAL64: 64,
    DataType.VISIBLE_STRING: 0,
}


class Access(Enum):
    """Access attribute of an object, as written in an EDS."""

    RO = "ro"
    WO = "wo"
    RW = "rw"
    CONST = "const"


Value = int | float | str


@dataclass(frozen=True, slots=True)
class ObjectDef:
    """One entry (index, subindex) of an object dictionary.

    `scale` and `unit` give the physical value: SI value = wire integer x scale, in `unit`.
    `$NODEID` arithmetic is not used: defaults that depend on the node are computed by the catalogue.
    """

    index: int
    subindex: int
    name: str
    data_type: DataType
    access: Access = Access.RW
    default: Value = 0
    mappable: bool = False
    low: int | float | None = None
    high: int | float | None = None
    unit: str = ""
    scale: float = 1.0

    @property
    def key(self) -> tuple[int, int]:
        return (self.index, self.subindex)


class PdoKind(Enum):
    RPDO = "rpdo"
    TPDO = "tpdo"


@dataclass(frozen=True, slots=True)
class PdoDef:
    """One process data object as a device ships with it (all of it can be changed by SDO later).

    `number` counts from 1. `transmission_type`: 0 acyclic synchronous, 1..240 every n-th SYNC, 254/255 event driven.
    """

    kind: PdoKind
    number: int
    cob_id: int
    mapping: tuple[tuple[int, int], ...]
    transmission_type: int = 1
    event_timer_ms: int = 0
    name: str = ""
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class DeviceDef:
    """One device on the bus: its node id, its objects and its PDOs."""

    name: str
    node_id: int
    objects: tuple[ObjectDef, ...]
    pdos: tuple[PdoDef, ...] = field(default=())
    product: str = ""
    _by_key: dict[tuple[int, int], ObjectDef] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_key", {entry.key: entry for entry in self.objects})

    def object(self, index: int, subindex: int = 0) -> ObjectDef:
        """The definition at (index, subindex). Raises KeyError that names both."""
        entry = self._by_key.get((index, subindex))
        if entry is None:
            raise KeyError(f"{self.name} has no object {index:04X}h sub {subindex}")
        return entry
