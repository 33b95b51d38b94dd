"""A server of the socketcand protocol on 127.0.0.1, so that CAN tools can watch a bus on machines without CAN sockets.

It has a thread of its own and never holds up the bus: the bus's thread only appends to a bounded queue, and only while
somebody listens. A client that does not read loses its own frames, nobody else's.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.frame import Frame
from drivers.socketcand_client import Client, Terms
from drivers.socketcand_protocol import encode_frame, error

HOST = "127.0.0.1"
DEFAULT_PORT = 29536
POLL_S = 0.002
"""How often the queue is looked at while somebody listens. Nobody wakes the server: that would cost the bus's thread a system call."""
MAX_CLIENTS = 32
QUEUE_FRAMES = 8192
"""Per client, beside some 10,000 in the buffers of the system: seconds of a full bus."""
BACKLOG_FRAMES = 65_536
INJECT_FRAMES = 1024
QUIET_NS = 250_000_000
DRAIN_NS = 1_000_000_000
"""How long `close` goes on sending to clients that take what they are sent."""


@dataclass(frozen=True, slots=True)
class ServerStatistics:
    """What the server did: frames are counted per client that they were sent to, refused commands and garbage likewise."""

    clients: int = 0
    sent: int = 0
    lost: int = 0
    injected: int = 0
    refused: int = 0
    garbage: int = 0


class SocketcandServer:
    """Serves the frames that it is called with (as an observer of a bus). A context manager; starts and ends its thread.

    A client gets every frame that was on the wire since it asked for raw mode, its own included. Frames that clients
    send wait in `take` for the bus's thread; when it is slower than they are, they are not read from until there is room.
    """

    def __init__(
        self,
        port: int = DEFAULT_PORT,
        *,
        monotonic_ns: Callable[[], int],
        allow_inject: bool = False,
        extended: bool = False,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        """`port` 0 takes a free one. Raises OSError when it cannot be had, ValueError for a queue without room."""
        if queue_frames < 1:
            raise ValueError(f"queue_frames {queue_frames}: must be at least 1")
        self._listener = socket.create_server((HOST, port), backlog=MAX_CLIENTS)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.overrun = 0
        """Frames that the server's own thread was too slow for: lost to all clients."""
        self.listeners = 0
        """Clients that get frames now."""
        self._frames: deque[Frame] = deque()
        self._injected: deque[Frame] = deque()
        self._monotonic_ns = monotonic_ns
        self._terms = Terms(queue_frames, QUIET_NS, self._inject if allow_inject else None, extended)
        self._clients: dict[socket.socket, Client] = {}
        self._gone = ServerStatistics()
        self._selector = selectors.DefaultSelector()
        self._waker, self._woken = socket.socketpair()
        self._closing = False
        self._thread = threading.Thread(target=self._serve, name="socketcand", daemon=True)

    def __enter__(self) -> SocketcandServer:
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Sends what is queued to everybody who takes it (a second at most), then closes all connections."""
        self._closing = True
        self._waker.send(b"!")
        self._thread.join()
        for end in (self._waker, self._woken, self._listener):
            end.close()
        self._selector.close()

    def __call__(self, frame: Frame) -> None:
        """A frame on the wire. From the bus's thread; never blocks, does nothing while nobody listens."""
        if self.listeners:
            if len(self._frames) < BACKLOG_FRAMES:
                self._frames.append(frame)
            else:
                self.overrun += 1

    def take(self) -> Frame | None:
        """The next frame that a client wants on the bus, without a time. From the bus's thread."""
        return self._injected.popleft() if self._injected else None

    def statistics(self) -> ServerStatistics:
        """The counts up to now; exact once the server is closed."""
        total = self._gone
        for client in list(self._clients.values()):
            total = _add(total, client)
        return total

    def _inject(self, frame: Frame) -> bool:
        if len(self._injected) >= INJECT_FRAMES:
            return False
        self._injected.append(frame)
        return True

    def _serve(self) -> None:
        while not self._closing:
            for key, _ in self._selector.select(POLL_S if self._busy() else None):
                if key.fileobj is self._listener:
                    self._accept()
                elif isinstance(key.data, Client):
                    self._attend(key.data)
            self._distribute()
        self._drain()

    def _busy(self) -> bool:
        return self.listeners > 0 or any(client.waiting for client in self._clients.values())

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:  # gone again, or no file descriptors left
            return
        if len(self._clients) >= MAX_CLIENTS:
            with contextlib.suppress(OSError):
                connection.send(error(f"{MAX_CLIENTS} clients are connected, no more are served"))
            connection.close()
            return
        client = Client(connection, self._terms, self._monotonic_ns)
        self._clients[connection] = client
        self._selector.register(connection, selectors.EVENT_READ, client)
        self._flush(client)

    def _attend(self, client: Client) -> None:
        if client.waiting or client.receive():
            self._count_listeners()
        else:
            self._drop(client)

    def _distribute(self) -> None:
        """All that came since the last time, to all that listen."""
        queued = self._frames
        batch = [encode_frame(queued.popleft()) for _ in range(len(queued))]
        for client in list(self._clients.values()):
            if client.listening and batch:
                client.queue(batch)
            if client.waiting:
                client.carry_on()
            self._flush(client)

    def _flush(self, client: Client) -> None:
        """Sends, and waits for what can happen next: room to write, or something to read unless the bus has to take it first."""
        client.flush()
        events = selectors.EVENT_WRITE if client.blocked else 0
        if not client.waiting:
            events |= selectors.EVENT_READ
        self._watch(client, events)

    def _watch(self, client: Client, events: int) -> None:
        key = self._selector.get_map().get(client.connection)
        if key is None:
            if events:
                self._selector.register(client.connection, events, client)
        elif not events:
            self._selector.unregister(client.connection)
        elif key.events != events:
            self._selector.modify(client.connection, events, client)

    def _drop(self, client: Client) -> None:
        self._watch(client, 0)
        del self._clients[client.connection]
        self._gone = _add(self._gone, client)
        client.close()
        self._count_listeners()

    def _count_listeners(self) -> None:
        self.listeners = sum(client.listening for client in self._clients.values())

    def _drain(self) -> None:
        """The end: what is queued still goes out to everybody who takes it."""
        self._distribute()
        until_ns = self._monotonic_ns() + DRAIN_NS
        pause = threading.Event()
        while self._monotonic_ns() < until_ns and not all(client.drained for client in self._clients.values()):
            pause.wait(POLL_S)
            for client in list(self._clients.values()):
                self._flush(client)
        for client in list(self._clients.values()):
            client.hang_up()
            self._drop(client)


def _add(total: ServerStatistics, client: Client) -> ServerStatistics:
    return ServerStatistics(
        total.clients + 1,
        total.sent + client.sent,
        total.lost + client.lost,
        total.injected + client.injected,
        total.refused + client.refused,
        total.garbage + client.garbage,
    )
