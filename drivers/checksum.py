"""CRC-8 SAE J1850: polynomial 1Dh, start FFh, final exclusive or FFh, not reflected (check value 4Bh)."""

from __future__ import annotations


def _shift_byte(value: int) -> int:
    for _ in range(8):
        value = (value << 1 ^ 0x1D) & 0xFF if value & 0x80 else value << 1
    return value


_TABLE = bytes(_shift_byte(value) for value in range(256))


def crc8_j1850(data: bytes) -> int:
    """The checksum of `data`, 0 … 255."""
    table = _TABLE
    crc = 0xFF
    for byte in data:
        crc = table[crc ^ byte]
    return crc ^ 0xFF


def start_value(can_id: int) -> int:
    """State of the CRC after the identifier, low byte first: with it in the checksum, no frame passes as another."""
    return _TABLE[_TABLE[0xFF ^ (can_id & 0xFF)] ^ (can_id >> 8)]


def frame_checksum(start: int, payload: bytes) -> int:
    """Checksum of a fast frame: of its identifier (`start`, see `start_value`) and its first seven bytes."""
    table = _TABLE
    a, b, c, d, e, f, g = payload
    return table[table[table[table[table[table[table[start ^ a] ^ b] ^ c] ^ d] ^ e] ^ f] ^ g] ^ 0xFF
