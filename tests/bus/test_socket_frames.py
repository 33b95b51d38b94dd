"""All frames that have arrived by one system call: on a datagram socket that stamps, as SocketCAN's does; bytes after linux/can.h."""

import errno
import socket
import time
from collections.abc import Iterator

import pytest

from drivers.bus.socket_frames import BATCH, FrameReader, pack

SO_TIMESTAMPNS = 35
Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    """(who sends, who receives with time stamps)"""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
    ):
        receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        receiver.bind(("127.0.0.1", 0))
        sender.connect(receiver.getsockname())
        yield sender, receiver


def test_a_frame_is_packed_as_the_kernel_has_it() -> None:
    # can_id in the machine's order, length, three bytes of padding, eight of data
    assert pack(0x123, b"\x01\x02\x03") == bytes.fromhex("23010000 03 000000 0102030000000000")
    assert pack(0x80000123, b"") == bytes.fromhex("23010080 00 000000 0000000000000000")


@pytest.mark.parametrize("count", [1, BATCH - 1, BATCH, 2 * BATCH + 7])
def test_all_that_has_come_is_read_at_once_in_its_order(pair: Pair, count: int) -> None:
    sender, receiver = pair
    reader = FrameReader(receiver.fileno())
    sent = [(0x100 + i % 0x400, bytes([i & 0xFF]) * (i % 9)) for i in range(count)]
    before_ns = time.time_ns()
    for can_id, data in sent:
        sender.send(pack(can_id, data))
    found = reader.read()
    assert [(can_id, data) for _, can_id, data in found] == sent
    stamps = [stamp_ns for stamp_ns, _, _ in found]
    assert stamps == sorted(stamps)
    assert before_ns - 50_000_000 <= stamps[0] <= stamps[-1] <= time.time_ns() + 50_000_000
    assert reader.read() == []


def test_lengths_that_the_kernel_wrote_do_not_shorten_what_comes_next(pair: Pair) -> None:
    sender, receiver = pair
    reader = FrameReader(receiver.fileno())
    for k in range(5):
        for i in range(3):
            sender.send(pack(0x200 + i, bytes(range(8))))
        assert [data for _, _, data in reader.read()] == [bytes(range(8))] * 3, k


def test_nothing_there_is_no_wait_and_a_socket_that_is_gone_is_an_error(pair: Pair) -> None:
    _, receiver = pair
    reader = FrameReader(receiver.fileno())
    assert reader.read() == []
    receiver.close()
    with pytest.raises(OSError, match="Bad file descriptor") as caught:
        reader.read()
    assert caught.value.errno == errno.EBADF
