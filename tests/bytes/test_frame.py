"""Lengths and checksums of frames against other sources than the code itself."""

from __future__ import annotations

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.frame import bit_length, check_frame, crc15


def long_division(bits: str) -> str:
    """Remainder of polynomial division by x^15+x^14+x^10+x^8+x^7+x^4+x^3+1 (CAN 2.0 A, 3.1.1), on strings."""
    divisor = "1100010110011001"
    work = list(bits + "0" * 15)
    for start in range(len(bits)):
        if work[start] == "1":
            for offset, bit in enumerate(divisor):
                work[start + offset] = "01"[work[start + offset] != bit]
    return "".join(work[-15:])


def on_the_wire(can_id: int, data: bytes) -> str:
    """The stuffed bits from start of frame to the end of the CRC sequence."""
    body = f"0{can_id:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    bits = body + long_division(body)
    stuffed = ""
    for bit in bits:
        stuffed += bit
        if re.search(r"(0{5}|1{5})$", stuffed):
            stuffed += "10"[int(bit)]
    return stuffed


def test_the_oracle_has_the_check_value_of_crc_15_can():
    # catalogue of parametrised CRC algorithms: CRC-15/CAN of "123456789" is 059Eh
    assert int(long_division("".join(f"{byte:08b}" for byte in b"123456789")), 2) == 0x059E


def test_the_oracle_never_shows_six_equal_bits():
    assert not re.search(r"0{6}|1{6}", on_the_wire(0, bytes(8)))


identifiers = st.integers(0, 0x7FF)
payloads = st.binary(max_size=8) | st.lists(st.sampled_from([0, 0xFF, 0x0F, 0x78]), max_size=8).map(bytes)


@given(identifiers, payloads)
@example(0x7FF, b"\xff" * 8)
@example(0, bytes(8))
def test_length_and_crc_are_those_of_the_bits_written_out(can_id: int, data: bytes):
    body = f"0{can_id:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    assert crc15(can_id, data) == int(long_division(body), 2)
    # + CRC delimiter, ACK slot, ACK delimiter, end of frame (7), inter-frame space (3)
    assert bit_length(can_id, data) == len(on_the_wire(can_id, data)) + 1 + 1 + 1 + 7 + 3


@pytest.mark.parametrize(
    ("can_id", "data", "bits"),
    [  # from can-utils' can_frame_length(…, CFL_EXACT, …)
        (0x080, "", 51),
        (0x000, "", 53),
        (0x7FF, "", 50),
        (0x123, "01", 58),
        (0x701, "05", 58),
        (0x181, "1122334455667788", 115),
        (0x601, "4000100000000000", 124),
        (0x21C, "0F00F0D8FFFF0000", 120),
        (0x000, "0000000000000000", 127),
        (0x7FF, "FFFFFFFFFFFFFFFF", 126),
        (0x000, "FFFFF0F0FBFF00FF", 129),
    ],
)
def test_length_agrees_with_can_utils(can_id: int, data: str, bits: int):
    assert bit_length(can_id, bytes.fromhex(data)) == bits


@given(identifiers, payloads)
def test_length_stays_within_the_bounds_of_the_standard(can_id: int, data: bytes):
    without_stuffing = 47 + 8 * len(data)
    worst = without_stuffing + (34 + 8 * len(data) - 1) // 4  # 111 and 135 for eight bytes
    assert without_stuffing <= bit_length(can_id, data) <= worst <= 135


def test_any_identifier_without_data_takes_at_most_55_bits():
    lengths = [bit_length(can_id) for can_id in range(0x800)]
    assert min(lengths) >= 47
    assert max(lengths) <= 55


@pytest.mark.parametrize(("can_id", "data"), [(0x800, b""), (-1, b""), (1, bytes(9))])
def test_what_is_no_standard_frame_is_refused(can_id: int, data: bytes):
    with pytest.raises(ValueError, match=r"can_id|data of 9 bytes"):
        check_frame(can_id, data)
