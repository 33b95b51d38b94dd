"""Run-time object dictionary: values, ranges, hooks, defaults; and the compiled layouts of PDOs."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.data_types import decode, encode, limits
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.mapping import Field, Layout
from drivers.objects import Access, DataType, DeviceDef, ObjectDef, PdoDef, PdoKind
from tests.unit.canopen.bench import DEVICE

NUMBERS = [kind for kind in DataType if kind is not DataType.VISIBLE_STRING]
INTEGERS = [kind for kind in NUMBERS if kind.is_integer]


@pytest.fixture
def dictionary() -> ObjectDictionary:
    return ObjectDictionary(DEVICE)


def refused(action: object, *arguments: object) -> AbortCode:
    with pytest.raises(SdoAbort) as refusal:
        action(*arguments)  # type: ignore[operator]
    return refusal.value.code


@given(st.sampled_from(INTEGERS), st.data())
def test_integers_survive_the_wire(kind: DataType, data: st.DataObject) -> None:
    low, high = limits(kind)
    value = data.draw(st.integers(int(low), int(high)))
    assert decode(kind, encode(kind, value)) == value


@pytest.mark.parametrize(
    ("kind", "value", "wire"),
    [
        (DataType.INTEGER24, -8_388_608, "000080"),
        (DataType.UNSIGNED24, 0x123456, "563412"),
        (DataType.REAL32, 1.5, "0000c03f"),
        (DataType.BOOLEAN, 1, "01"),
        (DataType.INTEGER16, -2, "feff"),
        (DataType.VISIBLE_STRING, "AZ", "415a"),
    ],
)
def test_little_endian(kind: DataType, value: int, wire: str) -> None:
    assert encode(kind, value).hex() == wire
    assert decode(kind, bytes.fromhex(wire)) == value


@given(st.sampled_from(NUMBERS), st.binary(max_size=9))
def test_whatever_arrives_is_a_finite_value_in_range_or_refused(kind: DataType, data: bytes) -> None:
    dictionary = ObjectDictionary(DeviceDef("any", 1, (ObjectDef(0x2000, 0, "Any", kind),)))
    try:
        dictionary.download(0x2000, 0, data)
    except SdoAbort:
        assert dictionary.get(0x2000) == 0
        return
    value = dictionary.get(0x2000)
    assert isinstance(value, int | float)
    assert math.isfinite(value)
    assert limits(kind)[0] <= value <= limits(kind)[1]
    assert len(data) == (kind.bits + 7) // 8


@given(st.lists(st.sampled_from(NUMBERS), max_size=8).filter(lambda kinds: sum(kind.bits for kind in kinds) <= 64))
def test_layout_puts_one_object_right_after_the_other(kinds: list[DataType]) -> None:
    objects = tuple(ObjectDef(0x2000 + i, 0, f"{i}", kind, mappable=True) for i, kind in enumerate(kinds))
    dictionary = ObjectDictionary(DeviceDef("any", 1, objects))
    layout = Layout(tuple(Field(dictionary.entry(0x2000 + i), kind) for i, kind in enumerate(kinds)))
    expected = shift = 0
    for i, kind in enumerate(kinds):
        value = (-1 if kind.signed else 1) * (i + 1) if kind.bits > 4 else 1
        dictionary.set(0x2000 + i, 0, value)
        raw = int.from_bytes(encode(kind, value), "little") & (1 << kind.bits) - 1
        expected |= raw << shift
        shift += kind.bits
    data = layout.pack()
    assert int.from_bytes(data, "little") == expected
    assert len(data) == layout.length == (shift + 7) // 8
    assert list(layout.unpack(data)) == [dictionary.get(0x2000 + i) for i in range(len(kinds))]


def test_application_cannot_store_what_the_type_or_range_cannot_hold(dictionary: ObjectDictionary) -> None:
    for value in (101, -1, math.nan, math.inf):
        with pytest.raises(ValueError, match="2005h:0 Percent"):
            dictionary.set(0x2005, 0, value)
    dictionary.set(0x2006, 0, 12)  # read-only is for the network
    assert dictionary.get(0x2006) == 12


def test_write_hooks_see_checked_values_and_may_refuse(dictionary: ObjectDictionary) -> None:
    heard: list[object] = []

    def not_seven(value: object) -> None:
        if value == 7:
            raise SdoAbort(AbortCode.DEVICE_STATE, "no seven")

    dictionary.bind(0x2005, check=not_seven, sink=heard.append)
    dictionary.download(0x2005, 0, b"\x08")
    assert refused(dictionary.download, 0x2005, 0, b"\x07") is AbortCode.DEVICE_STATE
    assert refused(dictionary.download, 0x2005, 0, b"\x80") is AbortCode.VALUE_TOO_HIGH
    assert heard == [8]
    assert dictionary.get(0x2005) == 8


def test_live_values_are_read_when_asked(dictionary: ObjectDictionary) -> None:
    values = iter((1, 2))
    dictionary.bind(0x2006, source=lambda: next(values))
    assert [dictionary.upload(0x2006, 0)[0] for _ in range(2)] == [1, 2]


def test_defaults_come_back_per_area(dictionary: ObjectDictionary) -> None:
    dictionary.download(0x2000, 0, b"\x05\x00")
    dictionary.download(0x1017, 0, b"\x05\x00")
    dictionary.restore_defaults(0x1000, 0x1FFF)
    assert (dictionary.get(0x2000), dictionary.get(0x1017)) == (5, 0)
    dictionary.restore_defaults(0x1000, 0xFFFF)
    assert dictionary.get(0x2000) == 0


def test_strings_have_a_length_and_an_alphabet(dictionary: ObjectDictionary) -> None:
    assert refused(dictionary.download, 0x2008, 0, b"x" * 256) is AbortCode.LENGTH_TOO_HIGH
    assert refused(dictionary.download, 0x2008, 0, b"\xff") is AbortCode.INVALID_VALUE


def test_pdo_parameters_follow_from_the_device(dictionary: ObjectDictionary) -> None:
    assert dictionary.get(0x1400, 1) == 0x205
    assert dictionary.get(0x1402, 1) == 0x8000_0405
    assert dictionary.get(0x1800, 1) == 0x4000_0185
    assert [dictionary.get(0x1600, sub) for sub in range(4)] == [2, 0x2000_0010, 0x2005_0008, 0]
    assert dictionary.get(0x1A01, 1) == 0x2003_0018


def test_an_object_that_is_there_twice_is_a_mistake_of_the_table() -> None:
    twice = (ObjectDef(0x2000, 0, "A", DataType.UNSIGNED8), ObjectDef(0x2000, 0, "B", DataType.UNSIGNED8))
    with pytest.raises(ValueError, match="2000h:0 is there twice"):
        ObjectDictionary(DeviceDef("bad", 1, twice))


def test_impossible_shipped_mapping_is_told_when_the_node_is_made() -> None:
    from tests.unit.canopen.bench import Bench

    objects = (ObjectDef(0x2000, 0, "Locked", DataType.UNSIGNED8, Access.RO, mappable=True),)
    pdo = PdoDef(PdoKind.RPDO, 1, 0x205, ((0x2000, 0),))
    with pytest.raises(SdoAbort, match="2000h:0 Locked cannot be mapped"):
        Bench(DeviceDef("bad", 5, objects, (pdo,)))


def test_real32_out_of_range_cannot_be_packed_silently(dictionary: ObjectDictionary) -> None:
    layout = Layout((Field(dictionary.entry(0x2001), DataType.REAL32),))
    dictionary.bind(0x2001, source=lambda: 1e39)
    with pytest.raises((OverflowError, struct.error)):
        layout.pack()
