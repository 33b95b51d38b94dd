"""Other people's programs on the server for tools: python-can's logger and player as their own processes, on a busy bus."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from canipulator.serving import ToolPort
from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.socketcand import SocketcandServer
from drivers.tool_bridge import BridgeError, ToolBridge
from logs.bus_log import BusLogWriter

PATIENCE_S = 60.0
CYCLE_S, FRAMES_PER_CYCLE, CYCLES = 0.010, 25, 1000  # 2,500 frames/s for 10 s


def traffic(cycles: int = CYCLES) -> Iterator[list[Frame]]:
    for cycle in range(cycles):
        t_ns = cycle * 10_000_000
        yield [
            Frame(0x180 + i, cycle.to_bytes(7, "little") + bytes([i]), t_ns + i * 130_000)
            for i in range(FRAMES_PER_CYCLE)
        ]


@contextmanager
def tool(name: str, server: SocketcandServer, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    where = ["--bus-kwargs", "host=127.0.0.1", f"port={server.port}", "tcp_tune=True", "-i", "socketcand", "-c", "can0"]
    command = [sys.executable, "-m", f"can.{name}", *where, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def until(condition: object, *, patience_s: float = PATIENCE_S) -> None:
    deadline = time.monotonic() + patience_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline
        time.sleep(0.01)


FILLER = 0x7FF


def flushed(server: SocketcandServer, log: Path) -> bool:
    """Whether the log has what the traffic was; more frames push the logger's file buffer out."""
    for _ in range(200):
        server(Frame(FILLER))
    return log.read_bytes().count(b" can0 ") >= CYCLES * FRAMES_PER_CYCLE


def play(server: SocketcandServer) -> float:
    """The traffic in real time; returns the mean cost of a frame in the thread of the bus, in µs."""
    began, spent = time.perf_counter(), 0.0
    for cycle, frames in enumerate(traffic()):
        time.sleep(max(0.0, began + cycle * CYCLE_S - time.perf_counter()))
        called = time.perf_counter()
        for frame in frames:
            server(frame)
        spent += time.perf_counter() - called
    return spent / (CYCLES * FRAMES_PER_CYCLE) * 1e6


@pytest.mark.slow
def test_logger_misses_nothing_while_another_tool_stalls(tmp_path: Path) -> None:
    log = tmp_path / "logged.log"
    with SocketcandServer(0, monotonic_ns=time.monotonic_ns) as server:
        with (
            tool("logger", server, "-f", str(log)) as logger,
            tool("logger", server, "-f", str(log) + "2.log") as stalled,
        ):
            until(lambda: server.listeners == 2)
            stalled.send_signal(signal.SIGSTOP)
            cost_us = play(server)
            until(lambda: flushed(server, log))
            logger.send_signal(signal.SIGINT)
            logger.communicate(timeout=20)
        with can.LogReader(log) as reader:
            logged = [
                (m.arbitration_id, bytes(m.data), round(m.timestamp * 1e6) * 1000)
                for m in reader
                if m.arbitration_id != FILLER
            ]
        assert logged == [tuple(frame) for frames in traffic() for frame in frames]
        assert server.overrun == 0
    print(f"{cost_us:.2f} µs/frame in the thread of the bus, {server.statistics()}")


AFTERWARDS_HZ, AFTERWARDS_S = 10, 60
"""Frames after those that count: a player that ends at once, with unread frames of its own, resets its connection, and its
system then throws away what a server short of computing time has not had yet (docs/tools.md). It does not come to that here."""


def frames_to_play() -> Iterator[Frame]:
    for frames in traffic():
        yield from frames
    for i in range(AFTERWARDS_HZ * AFTERWARDS_S):
        yield Frame(FILLER, b"", CYCLES * 10_000_000 + i * 1_000_000_000 // AFTERWARDS_HZ)


@pytest.mark.slow
def test_player_misses_nothing(tmp_path: Path) -> None:
    """Its frames come back to it, as they would from a bus, and it never reads them."""
    log = tmp_path / "played.log"
    with BusLogWriter(log) as writer:
        for frame in frames_to_play():
            writer(frame)
    heard: list[Frame] = []
    with (
        SocketcandServer(0, monotonic_ns=time.monotonic_ns, allow_inject=True) as server,
        tool("player", server, str(log)) as player,
    ):
        deadline = time.monotonic() + PATIENCE_S
        while FILLER not in {frame.can_id for frame in heard[-100:]}:
            assert time.monotonic() < deadline, f"{len(heard)} frames heard, {server.statistics()}"
            assert player.poll() is None, player.communicate()
            while (frame := server.take()) is not None:
                heard.append(frame)
                server(frame)
                deadline = time.monotonic() + PATIENCE_S  # it keeps real time as well as the machine lets it
            time.sleep(0.002)
        player.send_signal(signal.SIGINT)
        assert player.wait(20) == 0
    played = [frame for frame in heard if frame.can_id != FILLER]
    assert [(f.can_id, f.data) for f in played] == [(f.can_id, f.data) for frames in traffic() for f in frames]


def test_frames_of_a_tool_keep_their_order_on_the_modelled_bus() -> None:
    """A SYNC does not overtake the set point before it, however late the server is: an adapter's queue is no arbitration."""
    sent = [Frame(can_id, bytes([n])) for n in range(20) for can_id in (0x080, 0x219)]
    clock = LockstepClock()
    bus = LockstepBus(clock)
    node = bus.attach("node", (), lambda _: None)
    wire: list[Frame] = []
    bus.observe(wire.append)
    with SocketcandServer(0, monotonic_ns=time.monotonic_ns, allow_inject=True) as server:
        tools = ToolPort(server, bus)
        with can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=server.port) as client:
            for frame in sent:
                client.send(can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False))
            until(lambda: server.statistics().injected == len(sent))
        node.send(0x7FF, b"")  # those of others arbitrate as ever: this one waits for all that are more urgent
        tools.pump()
        clock.run_until(20_000_000)
    assert [(f.can_id, f.data) for f in wire] == [*((f.can_id, f.data) for f in sent), (0x7FF, b"")]


class TestBridge:
    """`canipulator attach`, on python-can's virtual bus."""

    @pytest.fixture
    def bridged(self) -> Iterator[tuple[can.BusABC, can.BusABC]]:
        """(a node on the bus, a tool on the server)"""
        stop = threading.Event()
        with (
            SocketcandServer(0, monotonic_ns=time.monotonic_ns, allow_inject=True, extended=True) as server,
            ToolBridge("virtual", "bridge", server) as bridge,
            can.Bus(interface="virtual", channel="bridge") as node,
        ):
            thread = threading.Thread(target=bridge.pump, args=(lambda: not stop.is_set(),))
            thread.start()
            with can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=server.port) as client:
                until(lambda: server.listeners == 1)
                yield node, client
            stop.set()
            thread.join()

    @pytest.mark.parametrize("extended", [False, True])
    def test_both_ways(self, bridged: tuple[can.BusABC, can.BusABC], extended: bool) -> None:
        node, client = bridged
        there = can.Message(arbitration_id=0x123, data=[1, 2], is_extended_id=extended)
        back = can.Message(arbitration_id=0x7F, data=bytes(8), is_extended_id=extended)
        node.send(there)
        assert there.equals(client.recv(5), timestamp_delta=None, check_channel=False, check_direction=False)
        client.send(back)
        assert back.equals(node.recv(5), timestamp_delta=None, check_channel=False, check_direction=False)
        # as on a wire: whoever watches sees what tools send
        assert back.equals(client.recv(5), timestamp_delta=None, check_channel=False, check_direction=False)

    def test_what_the_protocol_cannot_say_is_left_out(self, bridged: tuple[can.BusABC, can.BusABC]) -> None:
        node, client = bridged
        node.send(can.Message(arbitration_id=1, is_remote_frame=True, is_extended_id=False))
        node.send(can.Message(arbitration_id=2, is_error_frame=True))
        node.send(can.Message(arbitration_id=3, is_extended_id=False))
        received = client.recv(5)
        assert received is not None
        assert received.arbitration_id == 3

    def test_a_bus_that_is_none(self) -> None:
        with (
            SocketcandServer(0, monotonic_ns=time.monotonic_ns) as server,
            pytest.raises(BridgeError, match="nothing:can0 cannot be opened"),
        ):
            ToolBridge("nothing", "can0", server)
