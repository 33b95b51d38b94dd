"""The server for tools against python-can's own client: hand-shake, frames, injection, clients that stall, leave or talk nonsense."""

import socket
import time
from collections.abc import Callable, Iterator

import can
import pytest

from drivers.frame import Frame
from drivers.socketcand import MAX_CLIENTS, SocketcandServer

PATIENCE_S = 20.0
"""After so long without what has to come a test fails; it does not wait for it otherwise."""


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


@pytest.fixture
def server() -> Iterator[SocketcandServer]:
    with SocketcandServer(0, monotonic_ns=time.monotonic_ns) as server:
        yield server


@pytest.fixture
def open_server() -> Iterator[SocketcandServer]:
    with SocketcandServer(0, monotonic_ns=time.monotonic_ns, allow_inject=True) as server:
        yield server


def client(server: SocketcandServer, name: str = "can0") -> can.BusABC:
    listeners = server.listeners
    bus = can.Bus(interface="socketcand", channel=name, host="127.0.0.1", port=server.port)
    until(lambda: server.listeners > listeners)
    return bus


def plain(server: SocketcandServer, *commands: bytes) -> socket.socket:
    """A connection that has got the answers to `commands`."""
    connection = socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S)
    assert connection.recv(100) == b"< hi >"
    for command in commands:
        connection.sendall(command)
        assert connection.recv(100) == b"< ok >"
    return connection


def receive(bus: can.BusABC, count: int) -> list[tuple[int, bytes, float]]:
    found = []
    while len(found) < count:
        message = bus.recv(PATIENCE_S)
        assert message is not None, f"{count - len(found)} frames did not come"
        found.append((message.arbitration_id, bytes(message.data), message.timestamp))
    return found


FRAMES = [Frame(0x80, b"", 10_000_000), Frame(0x181, bytes(range(8)), 10_060_000), Frame(0x7FF, b"\x00", 10_190_000)]


def test_python_can_gets_every_frame_in_order_with_its_time(server: SocketcandServer) -> None:
    with client(server) as bus, client(server, "vcan0") as other:
        for frame in FRAMES:
            server(frame)
        for each in (bus, other):
            assert receive(each, 3) == [(0x80, b"", 0.01), (0x181, bytes(range(8)), 0.01006), (0x7FF, b"\x00", 0.01019)]


def test_only_this_machine_can_connect(server: SocketcandServer) -> None:
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", server.port), timeout=1):
        pass


def test_the_first_frame_keeps_away_from_the_answer(server: SocketcandServer) -> None:
    """python-can takes whatever it receives after `rawmode` for the answer."""
    with plain(server, b"< open can0 >") as connection:
        connection.sendall(b"< rawmode >")
        until(lambda: server.listeners == 1)
        server(FRAMES[1])
        assert connection.recv(100) == b"< ok >"
        assert connection.recv(100) == b"< frame 181 0.010060 0001020304050607 >"


def test_without_listeners_nothing_is_kept(server: SocketcandServer) -> None:
    with plain(server, b"< open can0 >") as connection:
        for _ in range(1000):
            server(FRAMES[1])
        connection.sendall(b"< rawmode >")
        assert connection.recv(100) == b"< ok >"
        until(lambda: server.listeners == 1)
        server(FRAMES[0])
        assert connection.recv(100) == b"< frame 080 0.010000  >"


def test_listen_only_answers_with_an_error(server: SocketcandServer) -> None:
    with plain(server, b"< open can0 >", b"< rawmode >") as connection:
        connection.sendall(b"< send 123 1 AB >")
        assert connection.recv(200).startswith(b"< error listen-only")
        connection.sendall(b"< echo >")
        assert connection.recv(200) == b"< echo >"
    until(lambda: server.statistics().refused == 1)
    assert server.take() is None


def test_injection_where_allowed(open_server: SocketcandServer) -> None:
    with client(open_server) as bus:
        bus.send(can.Message(arbitration_id=0x60B, data=[0x40, 0x41, 0x60, 0], is_extended_id=False))
        bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        until(lambda: open_server.statistics().injected == 2)
    assert [open_server.take(), open_server.take(), open_server.take()] == [
        Frame(0x60B, b"\x40\x41\x60\x00"),
        Frame(0x80),
        None,
    ]


@pytest.mark.parametrize("command", [b"< send 123 2 1 >", b"< send 00000123 0 >", b"< send >"])
def test_what_is_no_frame_is_refused(open_server: SocketcandServer, command: bytes) -> None:
    with plain(open_server, b"< open can0 >", b"< rawmode >") as connection:
        connection.sendall(command)
        assert connection.recv(200).startswith(b"< error send: ")
    assert open_server.take() is None


def test_no_sending_before_a_bus_is_open(open_server: SocketcandServer) -> None:
    with plain(open_server) as connection:
        connection.sendall(b"< send 123 0 >")
        assert connection.recv(200) == b"< error open a bus first >"
    assert open_server.take() is None


def test_a_player_faster_than_the_bus_waits_and_loses_nothing(open_server: SocketcandServer) -> None:
    count = 20_000
    stream = b"".join(b"< send %03X 4 %s >" % (i % 0x800, i.to_bytes(4, "big").hex(" ").encode()) for i in range(count))
    with plain(open_server, b"< open can0 >", b"< rawmode >") as connection:
        connection.settimeout(0.1)
        sent, taken = 0, []
        deadline = time.monotonic() + PATIENCE_S
        while len(taken) < count:
            assert time.monotonic() < deadline
            if sent < len(stream):
                sent += connection.send(stream[sent : sent + 50_000])
            while (frame := open_server.take()) is not None:
                taken.append(int.from_bytes(frame.data, "big"))
    assert taken == list(range(count))


def test_what_was_sent_before_a_reset_still_counts(open_server: SocketcandServer) -> None:
    """A player closes with frames unread, which resets the connection: what it sent must be on the bus all the same."""
    with plain(open_server, b"< open can0 >", b"< rawmode >") as connection:
        until(lambda: open_server.listeners == 1)
        for _ in range(2000):
            open_server(FRAMES[1])
        until(lambda: open_server.statistics().sent == 2000)
        connection.sendall(b"< send 123 0 >" * 1000)
    until(lambda: open_server.statistics().injected == 1000)


def test_a_stalled_client_loses_its_own_frames_only(server: SocketcandServer) -> None:
    count = 60_000
    with plain(server, b"< open can0 >", b"< rawmode >") as stalled, client(server) as bus:
        slowest_ns, got = 0, []
        for i in range(count):
            began_ns = time.perf_counter_ns()
            server(Frame(0x181, i.to_bytes(4, "big"), i * 1000))
            slowest_ns = max(slowest_ns, time.perf_counter_ns() - began_ns)
            if i % 500 == 499:
                got += receive(bus, 500)
        assert [int.from_bytes(data, "big") for _, data, _ in got] == list(range(count))
        until(lambda: server.statistics().lost > 0)
        assert server.overrun == 0
        assert slowest_ns < 100_000_000  # a call that waited for the client would not come back at all
        stalled.settimeout(0.5)
        text = drain(stalled)
    whole = text.count(b">")
    assert text.startswith(b"< frame 181 0.000000 00000000 >< frame 181")
    assert 0 < whole < count
    assert (
        server.statistics().lost + whole >= count - 300
    )  # what is lost is counted; a piece may be cut off with the connection


def drain(connection: socket.socket) -> bytes:
    pieces = []
    try:
        while piece := connection.recv(1 << 20):
            pieces.append(piece)
    except TimeoutError:
        pass
    return b"".join(pieces)


def test_garbage_hurts_nobody(server: SocketcandServer) -> None:
    with client(server) as bus, plain(server) as vandal:
        for piece in (
            b"\x00\xff" * 5000,
            b"<" * 5000,
            b"> > >",
            b"< open >",
            b"< send 1 1 1 >",
            b"GET / HTTP/1.1\r\n\r\n",
        ):
            vandal.sendall(piece)
        vandal.sendall(b"< echo >")
        text = b""
        while not text.endswith(b"< echo >"):
            text += vandal.recv(4096)
        server(FRAMES[1])
        assert receive(bus, 1)[0][0] == 0x181
    until(lambda: server.statistics().garbage > 3)


@pytest.mark.slow
def test_answers_to_one_who_never_reads_are_bounded(server: SocketcandServer) -> None:
    with plain(server, b"< open can0 >") as deaf, client(server) as bus:
        deaf.settimeout(0.2)
        for _ in range(200):
            try:
                deaf.send(b"< echo >" * 5000)
            except TimeoutError:
                break
        server(FRAMES[1])
        assert receive(bus, 1)[0][0] == 0x181


def test_clients_come_and_go(server: SocketcandServer) -> None:
    for _ in range(50):
        with plain(server, b"< open can0 >", b"< rawmode >"):
            until(lambda: server.listeners == 1)
            server(FRAMES[1])
        until(lambda: server.listeners == 0)
    assert server.statistics().clients == 50
    with client(server) as bus:
        server(FRAMES[2])
        assert receive(bus, 1)[0][0] == 0x7FF


def test_one_client_too_many_is_told_so(server: SocketcandServer) -> None:
    crowd = [plain(server) for _ in range(MAX_CLIENTS)]
    with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as late:
        assert late.recv(200).startswith(b"< error 32 clients")
        assert late.recv(200) == b""
    for connection in crowd:
        connection.close()


def test_a_full_read_of_python_can_ends_with_a_frame() -> None:
    """It reads 1024 bytes at a time, and writes a warning into the user's screen for each frame that this cuts."""
    with SocketcandServer(0, monotonic_ns=time.monotonic_ns) as server:
        connection = plain(server, b"< open can0 >", b"< rawmode >")
        until(lambda: server.listeners == 1)
        for frame in FRAMES * 100:
            server(frame)
    with connection:
        pieces = list(iter(lambda: connection.recv(1024), b""))
    assert {len(piece) for piece in pieces[:-1]} == {1024}
    assert all(piece.startswith(b"< frame ") and piece.endswith(b" >") for piece in pieces)


def test_closing_sends_what_is_queued() -> None:
    with SocketcandServer(0, monotonic_ns=time.monotonic_ns) as server:
        connection = plain(server, b"< open can0 >", b"< rawmode >")
        until(lambda: server.listeners == 1)
        for frame in FRAMES * 1000:
            server(frame)
    with connection:
        assert drain(connection).count(b"< frame ") == 3000
    assert server.statistics().sent == 3000
    assert server.statistics().lost == 0


def test_a_port_that_is_taken(server: SocketcandServer) -> None:
    with pytest.raises(OSError):
        SocketcandServer(server.port, monotonic_ns=time.monotonic_ns)
