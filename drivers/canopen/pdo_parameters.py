"""Communication and mapping parameters of a PDO, 1400h … 1BFFh: what may be written when (CiA 301, 7.5.2.35 to 38).

Choices where devices differ: a mapping may be changed only while the PDO is invalid (bit 31), its entries only while
sub 0 is 0, else 0601 0000h; identifier and inhibit time only while it is invalid, else 0609 0030h.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.mapping import Field, Layout, resolve
from drivers.canopen.standard_objects import MAPPING_SLOTS, PDO_INVALID
from drivers.objects import Value

RPDO_COMMUNICATION, TPDO_COMMUNICATION = 0x1400, 0x1800
_MAPPING_OFFSET = 0x200
_EXTENDED = 1 << 29
SYNCHRONOUS_MAX = 240
EVENT_DRIVEN = (254, 255)


def _is_restricted(can_id: int) -> bool:
    """Identifiers that no PDO may have (CiA 301, table 40)."""
    return (
        can_id <= 0x07F
        or 0x101 <= can_id <= 0x180
        or 0x581 <= can_id <= 0x5FF
        or 0x601 <= can_id <= 0x67F
        or can_id >= 0x6E0
    )


class PdoParameters:
    """Parameters that RPDO and TPDO share, kept in step with what SDO clients write."""

    receive: bool

    def __init__(self, number: int, dictionary: ObjectDictionary) -> None:
        self.number = number
        self.cob_id = 0
        self.valid = False
        self.transmission_type = 0
        self.layout = Layout(())
        self._dictionary = dictionary
        self._base = (RPDO_COMMUNICATION if self.receive else TPDO_COMMUNICATION) + number - 1
        self._mapping = self._base + _MAPPING_OFFSET
        dictionary.bind(self._base, 1, check=self._check_cob_id, sink=self._changed)
        dictionary.bind(self._base, 2, check=self._check_type, sink=self._changed)
        for subindex in (3, 5, 6):
            if (self._base, subindex) in dictionary:
                dictionary.bind(self._base, subindex, check=self._check_timing(subindex), sink=self._changed)
        dictionary.bind(self._mapping, 0, check=self._check_count, sink=self._changed)
        for slot in range(1, MAPPING_SLOTS + 1):
            if (self._mapping, slot) in dictionary:
                dictionary.bind(self._mapping, slot, check=self._check_mapping)

    def configure(self) -> None:
        """Takes over the parameters as the dictionary has them. Raises SdoAbort if its mapping is impossible."""
        word = self._dictionary.integer(self._base, 1)
        self.cob_id = word & 0x7FF
        self.valid = not word & PDO_INVALID
        self.transmission_type = self._dictionary.integer(self._base, 2)
        self.layout = Layout(self._fields(self._dictionary.integer(self._mapping, 0)))

    def idle(self) -> None:
        """Forgets what waits and stops all timers: the node left operational."""

    @property
    def mapped(self) -> tuple[tuple[int, int], ...]:
        """Keys of the objects in this PDO, in their order."""
        return tuple(entry.definition.key for entry in self.layout.entries)

    def _changed(self, _: Value) -> None:
        self.configure()

    def _fields(self, count: int) -> tuple[Field, ...]:
        words = (self._dictionary.integer(self._mapping, slot) for slot in range(1, count + 1))
        return tuple(resolve(self._dictionary, word, self.receive) for word in words)

    def _check_cob_id(self, value: Value) -> None:
        word = int(value)
        can_id = word & 0x7FF
        if word & PDO_INVALID:
            return
        if word & _EXTENDED or word & 0x1FFF_FFFF != can_id or _is_restricted(can_id):
            raise SdoAbort(AbortCode.INVALID_VALUE, f"COB-ID {word:08X}h: not an identifier for a PDO")
        if self.valid and can_id != self.cob_id:
            raise SdoAbort(AbortCode.INVALID_VALUE, "set bit 31 before giving a PDO another identifier")

    def _check_type(self, value: Value) -> None:
        if int(value) > SYNCHRONOUS_MAX and value not in EVENT_DRIVEN:
            raise SdoAbort(AbortCode.INVALID_VALUE, f"transmission type {value}: 0 … 240, 254 or 255")

    def _check_timing(self, subindex: int) -> Callable[[Value], None]:
        def check(_: Value) -> None:
            if subindex in (3, 6) and self.valid:
                raise SdoAbort(AbortCode.INVALID_VALUE, "set bit 31 of the COB-ID before changing this")

        return check

    def _check_count(self, value: Value) -> None:
        count = int(value)
        self._check_invalid()
        if count > MAPPING_SLOTS or (count and (self._mapping, count) not in self._dictionary):
            raise SdoAbort(AbortCode.PDO_TOO_LONG, f"{count} objects mapped: at most {MAPPING_SLOTS}")
        Layout(self._fields(count))

    def _check_mapping(self, value: Value) -> None:
        self._check_invalid()
        if self._dictionary.integer(self._mapping, 0) != 0:
            raise SdoAbort(AbortCode.UNSUPPORTED_ACCESS, "set sub 0 of the mapping to 0 before changing its entries")
        if value != 0:
            resolve(self._dictionary, int(value), self.receive)

    def _check_invalid(self) -> None:
        if self.valid:
            raise SdoAbort(AbortCode.UNSUPPORTED_ACCESS, "set bit 31 of the COB-ID before changing the mapping")
