"""A lockstep run that CAN tools can watch: the bus served on 127.0.0.1, virtual time held back to real time."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator

import click

from canipulator.pacing import Pacer
from config.errors import ConfigError
from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.socketcand import HOST, SocketcandServer

STEP_NS = 5_000_000
"""Virtual time between two looks at the real clock and at what tools want to send."""
TOOLS = "tools"
"""Name of the port that injects the frames of tools."""


def open_server(port: int, *, allow_inject: bool, extended: bool = False) -> SocketcandServer:
    """The server, its port taken. Raises ConfigError where it cannot be had."""
    if not 0 <= port <= 65_535:
        raise ConfigError(f"port {port}: must be within 0 (any free one) … 65535")
    try:
        return SocketcandServer(port, monotonic_ns=time.monotonic_ns, allow_inject=allow_inject, extended=extended)
    except OSError as error:
        raise ConfigError(f"port {port} of {HOST}: {_reason(error)}; choose another one, or 0 for any") from None


def _reason(error: OSError) -> str:
    """The system's words alone: Python's name the address again."""
    return os.strerror(error.errno) if error.errno is not None else str(error)


def announce(server: SocketcandServer, *, allow_inject: bool) -> None:
    """Says on stderr how a tool gets to the bus."""
    rights = "tools may send" if allow_inject else "listen-only"
    click.echo(f"tools: socketcand on {HOST}:{server.port}, any bus name, {rights}", err=True)


def report(server: SocketcandServer) -> None:
    """Says on stderr what the server did."""
    done = server.statistics()
    text = f"tools: {done.clients} served, {done.sent} frames to them, {done.lost + server.overrun} lost by slow ones"
    if done.injected or done.refused:
        text += f", {done.injected} from them, {done.refused} refused"
    click.echo(text, err=True)


class ServedRun:
    """How a lockstep run is served: made before the run, so that a port that is taken is known before anything is written."""

    def __init__(self, port: int, *, allow_inject: bool, pace: float, step_ns: int = STEP_NS) -> None:
        """`step_ns`: virtual time for which a frame of a tool may have to wait.

        Raises ConfigError for a port that cannot be had and for a pace that is not positive.
        """
        if not 0.0 < pace < float("inf"):
            raise ConfigError(f"--pace {pace:g}: must be a positive number of simulated seconds per second")
        self._pace = pace
        self._step_ns = step_ns
        self._allow_inject = allow_inject
        self._server = open_server(port, allow_inject=allow_inject)

    @contextlib.contextmanager
    def paced(self, clock: LockstepClock, bus: LockstepBus) -> Iterator[Callable[[int], None]]:
        """While open, the bus is served. Gives what takes the place of `clock.run_until`."""
        server = self._server
        bus.observe(server)
        tools = ToolPort(server, bus) if self._allow_inject else None
        announce(server, allow_inject=self._allow_inject)
        with server:
            pacer = Pacer(self._pace, clock.now_ns())

            def run_until(t_ns: int) -> None:
                while (now_ns := clock.now_ns()) < t_ns:
                    if tools is not None:
                        tools.pump()
                    step_end_ns = min(now_ns + self._step_ns, t_ns)
                    clock.run_until(step_end_ns)
                    pacer.wait(step_end_ns)

            yield run_until
        report(server)
        if pacer.slipped_ns:
            click.echo(f"tools: {pacer.slipped_ns * 1e-9:.1f} s behind a pace of {pacer.factor:g}", err=True)


class ToolPort:
    """What tools send goes out in the order in which they sent it, as from the queue of a CAN adapter: one frame at a time takes part
    in the arbitration. A SYNC that a starved process reads together with the set points before it must not overtake them.
    """

    def __init__(self, server: SocketcandServer, bus: LockstepBus) -> None:
        self._server = server
        self._port = bus.attach(TOOLS, (), _hear_nothing)
        bus.observe(self._on_frame)

    def pump(self) -> None:
        """The next frame that a tool wants to send goes onto the bus, if the one before it has gone out; the rest stays with the server."""
        if not self._port.queued and (frame := self._server.take()) is not None:
            self._port.send(frame.can_id, frame.data)

    def _on_frame(self, _: Frame) -> None:
        self.pump()


def _hear_nothing(_: Frame) -> None:
    """The tools' port takes no frames: clients get theirs as an observer does, everything in the order of the wire."""
