"""The object dictionary of a running device: typed values, checked access, hooks for live values (CiA 301, 7.4)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import chain

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.data_types import MAX_STRING_BYTES, decode, encode, limits
from drivers.canopen.standard_objects import missing_objects
from drivers.objects import Access, DataType, DeviceDef, ObjectDef, Value

Source = Callable[[], Value]
Check = Callable[[Value], None]
Sink = Callable[[Value], None]


class Entry:
    """One object with its present value.

    `source` supplies the value of an object that is alive; `check` may refuse a written value by raising SdoAbort;
    `sink` hears of a value after it has been stored (for a PDO: after everything in it has been stored).
    """

    __slots__ = ("check", "definition", "high", "low", "sink", "source", "value")

    def __init__(self, definition: ObjectDef) -> None:
        self.definition = definition
        self.value: Value = definition.default
        self.source: Source | None = None
        self.check: Check | None = None
        self.sink: Sink | None = None
        self.low: int | float = -math.inf
        self.high: int | float = math.inf
        if definition.data_type is not DataType.VISIBLE_STRING:
            type_low, type_high = limits(definition.data_type)
            self.low = type_low if definition.low is None else max(type_low, definition.low)
            self.high = type_high if definition.high is None else min(type_high, definition.high)

    @property
    def name(self) -> str:
        """Index, subindex and name, as errors show it."""
        return f"{self.definition.index:04X}h:{self.definition.subindex} {self.definition.name}"

    @property
    def guarded(self) -> bool:
        """A received value may turn out to be invalid although it has the right length."""
        kind = self.definition.data_type
        narrowed = kind.is_integer and (self.low, self.high) != limits(kind)
        return narrowed or not kind.is_integer or self.check is not None

    def read(self) -> Value:
        return self.value if self.source is None else self.source()

    def validate(self, value: Value) -> None:
        """Raises SdoAbort for a value that this object must not take. NaN and infinities never pass."""
        if isinstance(value, str):
            if len(value) > MAX_STRING_BYTES:
                raise SdoAbort(AbortCode.LENGTH_TOO_HIGH, f"{self.name}: at most {MAX_STRING_BYTES} characters")
        elif value > self.high:
            raise SdoAbort(AbortCode.VALUE_TOO_HIGH, f"{self.name} = {value}: at most {self.high}")
        elif value < self.low:
            raise SdoAbort(AbortCode.VALUE_TOO_LOW, f"{self.name} = {value}: at least {self.low}")
        elif not math.isfinite(value):
            raise SdoAbort(AbortCode.INVALID_VALUE, f"{self.name} = {value}: must be finite")
        if self.check is not None:
            self.check(value)

    def store(self, value: Value) -> None:
        """Validates, stores, and tells the sink."""
        self.validate(value)
        self.value = value
        if self.sink is not None:
            self.sink(value)


class ObjectDictionary:
    """All objects of one device. What CiA 301 needs and `device` leaves out is added (see standard_objects.py)."""

    def __init__(self, device: DeviceDef) -> None:
        self.device = device
        self._entries: dict[tuple[int, int], Entry] = {}
        self._indices: set[int] = set()
        for definition in chain(device.objects, missing_objects(device)):
            if definition.key in self._entries:
                raise ValueError(f"{device.name}: object {definition.index:04X}h:{definition.subindex} is there twice")
            self._entries[definition.key] = Entry(definition)
            self._indices.add(definition.index)

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self._entries

    def __iter__(self) -> Iterator[Entry]:
        return iter(self._entries.values())

    def entry(self, index: int, subindex: int = 0) -> Entry:
        """Raises SdoAbort for an object that does not exist."""
        found = self._entries.get((index, subindex))
        if found is None:
            code = AbortCode.NO_SUCH_SUBINDEX if index in self._indices else AbortCode.NO_SUCH_OBJECT
            raise SdoAbort(code, f"{self.device.name} has no object {index:04X}h:{subindex}")
        return found

    def get(self, index: int, subindex: int = 0) -> Value:
        """Present value for the device's own use, whatever its access attribute."""
        return self.entry(index, subindex).read()

    def integer(self, index: int, subindex: int = 0) -> int:
        """Present value of an object that is known to be a whole number."""
        return int(self.entry(index, subindex).read())

    def integer_or(self, fallback: int, index: int, subindex: int = 0) -> int:
        """As `integer`, `fallback` for an object that this device does not have."""
        found = self._entries.get((index, subindex))
        return fallback if found is None else int(found.read())

    def set(self, index: int, subindex: int, value: Value) -> None:
        """Stores a value from the device's own side: range-checked, read-only objects included, hooks not called."""
        entry = self.entry(index, subindex)
        if not isinstance(value, str) and not entry.low <= value <= entry.high:
            raise ValueError(f"{entry.name} = {value}: must be within {entry.low} … {entry.high}")
        entry.value = value

    def bind(
        self,
        index: int,
        subindex: int = 0,
        *,
        source: Source | None = None,
        check: Check | None = None,
        sink: Sink | None = None,
    ) -> None:
        """Connects an object with the device; a hook that is not given stays as it is."""
        entry = self.entry(index, subindex)
        entry.source = source or entry.source
        entry.check = check or entry.check
        entry.sink = sink or entry.sink

    def upload(self, index: int, subindex: int) -> bytes:
        """What an SDO client reads. Raises SdoAbort: no such object, write-only, no data."""
        entry = self.entry(index, subindex)
        if entry.definition.access is Access.WO:
            raise SdoAbort(AbortCode.WRITE_ONLY, f"{entry.name} is write-only")
        return encode(entry.definition.data_type, entry.read())

    def download(self, index: int, subindex: int, data: bytes) -> None:
        """What an SDO client writes. Raises SdoAbort: no such object, read-only, length, range, refused by `check`."""
        entry = self.entry(index, subindex)
        if entry.definition.access in (Access.RO, Access.CONST):
            raise SdoAbort(AbortCode.READ_ONLY, f"{entry.name} is read-only")
        entry.store(decode(entry.definition.data_type, data))

    def restore_defaults(self, first: int, last: int) -> None:
        """Power-on values of all objects from index `first` to `last`, hooks not called."""
        for (index, _), entry in self._entries.items():
            if first <= index <= last:
                entry.value = entry.definition.default
