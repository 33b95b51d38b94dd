"""Frames in words: the message, its fields with units, and what differs between two of them."""

import struct

import pytest

from drivers.catalogue import devices
from logs.frame_text import FrameReader, differing_fields

READER = FrameReader(devices().values())


def set_point(position_urad: int, effort: int = 0) -> bytes:
    """RPDO1 of a joint: 6040h, 607Ah, 60B2h."""
    return struct.pack("<Hih", 0x000F, position_urad, effort)


def test_a_set_point_has_its_controlword_position_and_torque_offset() -> None:
    text = READER.read(0x219, set_point(-1_250_000, -250))
    assert text.message == "set point to elbow (node 25)"
    assert [str(entry) for entry in text.fields] == ["000Fh", "-1.25 rad", "-0.25 of rated torque"]


@pytest.mark.parametrize(
    ("can_id", "data", "message", "fields"),
    [
        (0x000, "01 15", "NMT", ["start", "tower_rotate (node 21)"]),
        (0x080, "", "SYNC", []),
        (0x702, "05", "heartbeat of planner (node 2)", ["operational"]),
        (0x60B, "2f 60 60 00 09 00 00 00", "SDO request to wheel_left (node 11)", ["2Fh", "6060h", "09 00 00 00"]),
        (0x099, "30 81 11 00 00 00 00 00", "EMCY of elbow (node 25)", ["8130h", "11h", "00 00 00 00 00"]),
        (0x7E5, "aa", "7E5h", ["aa"]),
        (0x219, "0f 00", "set point to elbow (node 25)", ["0f 00"]),
    ],
)
def test_services_are_named(can_id: int, data: str, message: str, fields: list[str]) -> None:
    text = READER.read(can_id, bytes.fromhex(data))
    assert text.message == message
    assert len(text.fields) == len(fields)
    for entry, part in zip(text.fields, fields, strict=True):
        assert part in str(entry)


def test_only_the_field_that_differs_is_named() -> None:
    a, b = (READER.read(0x219, set_point(position)) for position in (1000, 1007))
    [(expected, got)] = differing_fields(a, b)
    assert expected is not None
    assert got is not None
    assert (expected.name, str(expected), str(got)) == ("Target position", "0.001 rad", "0.001007 rad")


def test_a_tolerance_lets_one_count_of_a_value_pass_and_nothing_of_a_code() -> None:
    a, near, far = (READER.read(0x219, set_point(position)) for position in (1000, 1001, 1002))
    assert differing_fields(a, near)
    assert not differing_fields(a, near, tolerance=1e-7)
    assert differing_fields(a, far, tolerance=1e-7)
    word = READER.read(0x219, struct.pack("<Hih", 0x0007, 1000, 0))
    assert [pair[0].name for pair in differing_fields(a, word, tolerance=1.0) if pair[0]] == ["Controlword"]
