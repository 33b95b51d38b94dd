"""A CAN frame and how long it is on the wire, to the bit.

Classical CAN, standard format (11 bit identifier), data frames only: all that CANopen needs.
Frame format, CRC polynomial and bit stuffing after Bosch, CAN Specification 2.0 (1991), part A, chapters 3.1 and 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

MAX_CAN_ID = 0x7FF
MAX_DATA_BYTES = 8
INTERFRAME_BITS = 3
"""Recessive bits between two frames; a frame is received before them, the next one may start after them."""


class Frame(NamedTuple):
    """One data frame. `t_ns` is the time at which its last bit was received."""

    can_id: int
    data: bytes = b""
    t_ns: int = 0


@njit("UniTuple(int64, 2)(int64, int64, uint64)", cache=True)
def _crc_and_stuff_bits(can_id: int, length: int, payload: int) -> tuple[int, int]:
    """CRC-15 and number of stuff bits; `payload` holds the data bytes, the first one most significant.

    CRC polynomial 4599h: x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1. Stuffing covers SOF to the end of the CRC.
    """
    header = (can_id << 7) | length  # SOF, RTR, IDE and r0 are dominant, thus 0
    body_bits = 19 + 8 * length
    crc = 0
    stuff_bits = 0
    run = 0
    last = 2
    for i in range(body_bits + 15):
        if i < 19:
            bit = (header >> (18 - i)) & 1
        elif i < body_bits:
            bit = 1 if (payload >> np.uint64(body_bits - 1 - i)) & np.uint64(1) else 0
        else:
            bit = (crc >> (body_bits + 14 - i)) & 1
        if i < body_bits:
            feedback = bit ^ (crc >> 14)
            crc = (crc << 1) & 0x7FFF
            if feedback:
                crc ^= 0x4599
        if bit == last:
            run += 1
        else:
            run = 1
            last = bit
        if run == 5:  # the complement follows on the wire, and is itself the first bit of the next run
            stuff_bits += 1
            last = 1 - bit
            run = 1
    return crc, stuff_bits


def crc15(can_id: int, data: bytes = b"") -> int:
    """The CRC sequence of a frame, over SOF, identifier, control field and data."""
    crc, _ = _crc_and_stuff_bits(can_id, len(data), int.from_bytes(data, "big"))
    return int(crc)


def bit_length(can_id: int, data: bytes = b"") -> int:
    """Bits that a frame takes on the wire: SOF to end of frame, with stuff bits, and the 3 bits of inter-frame space.

    47 + 8 n + stuff bits for n data bytes: 51 to 55 for a SYNC, at most 135. No checks: see `check_frame`.
    """
    length = len(data)
    # 19 header bits and 15 of the CRC are stuffed; CRC delimiter, ACK slot, ACK delimiter, EOF (7) and the 3 are not
    return 47 + 8 * length + _crc_and_stuff_bits(can_id, length, int.from_bytes(data, "big"))[1]  # type: ignore[no-any-return]


def check_frame(can_id: int, data: bytes) -> None:
    """Raises ValueError unless this is a standard data frame."""
    if not 0 <= can_id <= MAX_CAN_ID:
        raise ValueError(f"can_id {can_id:#x}: must be within 0 … {MAX_CAN_ID:#x} (11 bits)")
    if len(data) > MAX_DATA_BYTES:
        raise ValueError(f"data of {len(data)} bytes: a CAN frame carries at most {MAX_DATA_BYTES}")
