"""CRC-8 SAE J1850 against published values, and as it is used in the fast frames."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.checksum import crc8_j1850, frame_checksum, start_value


@pytest.mark.parametrize(
    ("data", "checksum"),
    [  # first: check value of the CRC catalogue; others: AUTOSAR, Specification of CRC Routines, table of CRC8
        (b"123456789", 0x4B),
        (bytes.fromhex("00000000"), 0x59),
        (bytes.fromhex("F20183"), 0x37),
        (bytes.fromhex("0FAA0055"), 0x79),
        (bytes.fromhex("00FF5511"), 0xB8),
        (bytes.fromhex("332255AABBCCDDEEFF"), 0xCB),
        (bytes.fromhex("926B55"), 0x8C),
        (bytes.fromhex("FFFFFFFF"), 0x74),
    ],
)
def test_published_values(data: bytes, checksum: int):
    assert crc8_j1850(data) == checksum


@given(st.integers(0, 0x7FF), st.binary(min_size=7, max_size=7))
def test_frame_checksum_covers_the_identifier_low_byte_first(can_id: int, payload: bytes):
    assert frame_checksum(start_value(can_id), payload) == crc8_j1850(can_id.to_bytes(2, "little") + payload)


@given(st.integers(0, 0x7FF), st.binary(min_size=7, max_size=7), st.integers(0, 55))
def test_every_single_flipped_bit_is_seen(can_id: int, payload: bytes, bit: int):
    flipped = (int.from_bytes(payload, "little") ^ 1 << bit).to_bytes(7, "little")
    start = start_value(can_id)
    assert frame_checksum(start, payload) != frame_checksum(start, flipped)
