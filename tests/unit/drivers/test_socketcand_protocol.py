"""The words of the socketcand protocol. Examples of bytes are those of the protocol's own description (doc/protocol.md)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.frame import Frame
from drivers.socketcand_protocol import (
    EXTENDED,
    LONGEST_ELEMENT,
    Command,
    CommandReader,
    encode_frame,
    parse_send,
)


def read(stream: bytes, piece: int = 1 << 20) -> tuple[list[Command], int]:
    reader = CommandReader()
    found = []
    for start in range(0, len(stream), piece):
        reader.feed(stream[start : start + piece])
        while (command := reader.next()) is not None:
            found.append(command)
    return found, reader.garbage


@pytest.mark.parametrize(
    ("frame", "element"),
    [
        (Frame(0x123, bytes.fromhex("11223344"), 23_424_242_000), b"< frame 123 23.424242 11223344 >"),
        (Frame(0x080, b"", 999), b"< frame 080 0.000000  >"),  # two spaces, or python-can fails on it
        (Frame(EXTENDED | 0x1AAAAAAA, b"\x01\xf1", 10**18), b"< frame 1AAAAAAA 1000000000.000000 01F1 >"),
        (Frame(EXTENDED | 0x7, b"\x00", 1_000_000), b"< frame 00000007 0.001000 00 >"),
    ],
)
def test_frames_as_clients_expect_them(frame: Frame, element: bytes) -> None:
    assert encode_frame(frame) == element


@pytest.mark.parametrize(
    ("element", "frame"),
    [
        (b"< send 123 0 >", Frame(0x123)),
        (b"< send 123 0  >", Frame(0x123)),  # python-can's form
        (b"< send 1AAAAAAA 2 1 F1 >", Frame(EXTENDED | 0x1AAAAAAA, b"\x01\xf1")),
        (b"< send 60b 8 40 41 60 0 0 0 0 0 >", Frame(0x60B, bytes.fromhex("4041600000000000"))),
    ],
)
def test_frames_that_clients_send(element: bytes, frame: Frame) -> None:
    (command,), garbage = read(element)
    assert command.word == "send"
    assert garbage == 0
    assert parse_send(command.arguments, extended=True) == frame


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("", "must be 'send ID LENGTH BYTES'"),
        ("123", "must be 'send ID LENGTH BYTES'"),
        ("123 2 1", "length 2, but 1 bytes"),
        ("123 9 1 2 3 4 5 6 7 8 9", "length 9 is above 8"),
        ("123 1 100", "data byte 100 is above FF"),
        ("123 1 -1", "data byte '-1' is no hex"),
        ("123 1 0x1", "data byte '0x1' is no hex"),
        ("800 0", "above 7FF"),
        ("00000123 0", "29 bits, this bus carries 11"),
        ("FFFFFFFF 0", "above 1FFFFFFF"),
        ("١٢٣ 0", "no hex"),
    ],
)
def test_what_is_no_frame_is_named(arguments: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_send(tuple(arguments.split()), extended=False)


def test_several_commands_in_one_piece() -> None:
    found, garbage = read(b"< open can0 >< rawmode >\n< echo >")
    assert found == [Command("open", ("can0",)), Command("rawmode"), Command("echo")]
    assert garbage == 0


@pytest.mark.parametrize(
    "junk", [b"GET / HTTP/1.1\r\n\r\n", b"\xff\x00<", b"< >", b">>", b"<" * 999, b"< " + b"a" * 500 + b" >"]
)
def test_commands_are_found_again_after_garbage(junk: bytes) -> None:
    found, garbage = read(junk + b"< echo >")
    assert found == [Command("echo")]
    assert garbage >= 1


@given(st.lists(st.sampled_from([b"< echo >", b"<", b">", b" ", b"< send 1 0 >", b"x", b"\xff"])), st.integers(1, 7))
def test_pieces_do_not_matter_to_whole_commands(parts: list[bytes], piece: int) -> None:
    assert read(b"".join(parts), piece)[0] == read(b"".join(parts))[0]


@given(st.lists(st.binary(max_size=300)))
def test_an_open_element_is_bounded(pieces: list[bytes]) -> None:
    reader = CommandReader()
    for piece in pieces:
        reader.feed(piece)
        while reader.next() is not None:
            pass
        assert len(reader._buffer) <= LONGEST_ELEMENT
