"""The socketcand protocol's words, in bytes: what a client asks for, and frames as they go out to it.

After the protocol description and the raw mode of the socketcand project (doc/protocol.md, state_raw.c). Elements look like
`< word arguments >`. What is served here is the raw mode: `open`, `rawmode`, `echo` and `send`; frames go out as
`< frame 181 23.424242 1122 >`. Remote frames cannot be expressed.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.frame import MAX_CAN_ID, MAX_DATA_BYTES, Frame

EXTENDED = 0x8000_0000
"""Flag in `Frame.can_id` for a 29-bit identifier, as in SocketCAN. Such frames only pass through to real interfaces."""
MAX_EXTENDED_ID = 0x1FFF_FFFF
LONGEST_ELEMENT = 128
"""Bytes from `<` to `>`. The longest that is served, `send` with eight bytes, takes less than 50."""
HI, OK, ECHO = b"< hi >", b"< ok >", b"< echo >"


@dataclass(frozen=True, slots=True)
class Command:
    """One element of a client: the word and what follows it."""

    word: str
    arguments: tuple[str, ...] = ()


def error(text: str) -> bytes:
    """The answer to what cannot be done. `text` must not hold angle brackets."""
    return f"< error {text} >".encode("ascii", "replace")


def encode_frame(frame: Frame) -> bytes:
    """A frame as a client gets it: padded upper-case hex without spaces. Without data, two spaces stay (python-can counts them)."""
    can_id, data, t_ns = frame
    name = f"{can_id & MAX_EXTENDED_ID:08X}" if can_id & EXTENDED else f"{can_id:03X}"
    microseconds = t_ns // 1000
    seconds = microseconds // 1_000_000
    return b"< frame %s %d.%06d %s >" % (
        name.encode(),
        seconds,
        microseconds - seconds * 1_000_000,
        data.hex().upper().encode(),
    )


def pad(element: bytes, count: int) -> bytes:
    """The same element, `count` bytes longer: clients pass over spaces in front of its end."""
    return element[:-1] + b" " * count + element[-1:]


def parse_send(arguments: tuple[str, ...], *, extended: bool) -> Frame:
    """`send ID LENGTH BYTE…` -> frame without a time. Eight digits make an identifier an extended one.

    Raises ValueError that says what is wrong, `extended` identifiers included where they cannot be sent.
    """
    if len(arguments) < 2:
        raise ValueError("send: must be 'send ID LENGTH BYTES', in hex")
    name, length, *data = arguments
    can_id = _hex(name, "identifier", MAX_EXTENDED_ID)
    if len(name) == 8:
        if not extended:
            raise ValueError(f"send: identifier {name} has 29 bits, this bus carries 11")
        can_id |= EXTENDED
    elif can_id > MAX_CAN_ID:
        raise ValueError(f"send: identifier {name} is above 7FF; one of 29 bits takes eight digits")
    if _hex(length, "length", MAX_DATA_BYTES) != len(data):
        raise ValueError(f"send: length {length}, but {len(data)} bytes follow")
    return Frame(can_id, bytes(_hex(byte, "data byte", 0xFF) for byte in data))


def _hex(digits: str, what: str, highest: int) -> int:
    if not 1 <= len(digits) <= 8 or not all(digit in "0123456789abcdefABCDEF" for digit in digits):
        raise ValueError(f"send: {what} {digits[:8]!r} is no hex number")
    value = int(digits, 16)
    if value > highest:
        raise ValueError(f"send: {what} {digits} is above {highest:X}")
    return value


class CommandReader:
    """Cuts a stream of bytes into commands. It holds at most one element that is still open, and counts what is none."""

    __slots__ = ("_buffer", "garbage")

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.garbage = 0
        """Pieces that were no element: thrown away."""

    def feed(self, data: bytes) -> None:
        """More bytes of the stream; take out the commands before the next."""
        self._buffer += data

    def next(self) -> Command | None:
        """The next whole command. None: more bytes have to come."""
        buffer = self._buffer
        while buffer:
            end = buffer.find(b">")
            if end < 0:
                self._keep_open_element()
                return None
            element = bytes(buffer[:end])
            del buffer[: end + 1]
            start = element.rfind(b"<")
            words = element[start + 1 :].decode("ascii", "replace").split() if start >= 0 else []
            if element[: max(start, 0)].strip() or not words or end - start > LONGEST_ELEMENT:
                self.garbage += 1
            if words and end - start <= LONGEST_ELEMENT:
                return Command(words[0], tuple(words[1:]))
        return None

    def _keep_open_element(self) -> None:
        """Of bytes without an end, what may still become an element."""
        start = self._buffer.rfind(b"<")
        if start < 0:
            start = len(self._buffer)
        if self._buffer[:start].strip() or len(self._buffer) - start > LONGEST_ELEMENT:
            self.garbage += 1
        if len(self._buffer) - start > LONGEST_ELEMENT:
            start = len(self._buffer)
        del self._buffer[:start]
