"""One tool that is connected to the socketcand server: its hand-shake, what it sends, and the queue of what it gets."""

from __future__ import annotations

import contextlib
import enum
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from drivers.frame import Frame
from drivers.socketcand_protocol import ECHO, HI, OK, Command, CommandReader, error, pad, parse_send

RECEIVE_BYTES = 4096
PIECE_BYTES = 1024
"""python-can's client reads so much at a time and grumbles on the terminal, in the middle of a viewer's screen, when that cuts a
frame. So that much is sent at a time, whole frames, the last one padded while more is to follow."""
ANSWER_LIMIT = 4096
"""Bytes of answers that wait for a client; it loses further ones."""
SEND_BUFFER_BYTES = 1 << 18
_QUICK_ACKNOWLEDGE: int | None = getattr(socket, "TCP_QUICKACK", None)
MAX_NAME = 16
"""Of a bus, as in the protocol."""


class _Mode(enum.Enum):
    NO_BUS = enum.auto()
    OPEN = enum.auto()
    RAW = enum.auto()


@dataclass(frozen=True, slots=True)
class Terms:
    """What a client may do and how much is kept for it.

    queue_frames: frames that wait for a client at most. quiet_ns: time between the answer to `rawmode` and the first
    frame: python-can's client wants the answer alone in what it receives. inject: takes a frame for the bus, False when
    it cannot now (asked again later); None: listen-only. extended: whether the bus carries 29-bit identifiers.
    """

    queue_frames: int
    quiet_ns: int
    inject: Callable[[Frame], bool] | None
    extended: bool


class Client:
    """A connection. Every method belongs to the server's thread; none blocks."""

    def __init__(self, connection: socket.socket, terms: Terms, monotonic_ns: Callable[[], int]) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.connection = connection
        self.blocked = False
        """The system takes no more bytes for it now."""
        self._deaf = False  # nothing can be sent to it any more; what it sent before it went may still be there to read
        self.sent = self.lost = self.injected = self.refused = 0
        self._terms = terms
        self._monotonic_ns = monotonic_ns
        self._mode = _Mode.NO_BUS
        self._quiet_until_ns = 0
        self._reader = CommandReader()
        self._waiting: Frame | None = None
        self._answers = bytearray(HI)
        self._frames: deque[bytes] = deque()
        self._unsent: memoryview = memoryview(b"")

    @property
    def listening(self) -> bool:
        """Whether it gets frames."""
        return self._mode is _Mode.RAW and not self._deaf

    @property
    def garbage(self) -> int:
        return self._reader.garbage

    @property
    def waiting(self) -> bool:
        """Whether a frame of it cannot get to the bus: nothing more is read from it until then."""
        return self._waiting is not None

    @property
    def drained(self) -> bool:
        """Whether nothing is left to be sent to it."""
        return self._deaf or not (self._unsent or self._answers or self._frames)

    def queue(self, frames: list[bytes]) -> None:
        """Frames for it, encoded. Those that find its queue full are lost to it, and counted."""
        room = self._terms.queue_frames - len(self._frames)
        if room < len(frames):
            self.lost += len(frames) - max(room, 0)
            frames = frames[: max(room, 0)]
        self._frames.extend(frames)

    def flush(self) -> None:
        """Sends what the system takes. `blocked` says whether it took everything that may be sent now."""
        self.blocked = False
        while not self._deaf and self._next_piece():
            try:
                taken = self.connection.send(self._unsent)
            except BlockingIOError:
                self.blocked = True
                return
            except OSError:
                self._deaf = True
                return
            self._unsent = self._unsent[taken:]
            self._acknowledge()

    def _acknowledge(self) -> None:
        """Acknowledges at once what comes next (Linux forgets this with every exchange).

        Otherwise the client's system holds small pieces back until we answer, and a player that ends without having read
        its frames resets the connection: what is held back then is lost.
        """
        if _QUICK_ACKNOWLEDGE is not None:
            with contextlib.suppress(OSError):
                self.connection.setsockopt(socket.IPPROTO_TCP, _QUICK_ACKNOWLEDGE, 1)

    def _next_piece(self) -> bool:
        if self._unsent:
            return True
        if self._answers:
            self._unsent = memoryview(bytes(self._answers))
            self._answers.clear()
            return True
        if not self._frames or self._monotonic_ns() < self._quiet_until_ns:
            return False
        piece, size = [], 0
        while self._frames and size + len(self._frames[0]) <= PIECE_BYTES:
            piece.append(self._frames.popleft())
            size += len(piece[-1])
        self.sent += len(piece)
        if self._frames:
            piece[-1] = pad(piece[-1], PIECE_BYTES - size)
        self._unsent = memoryview(b"".join(piece))
        return True

    def receive(self) -> bool:
        """Reads once and carries out the commands. False: the client has closed the connection, and all is read."""
        try:
            data = self.connection.recv(RECEIVE_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            return False
        if not data:
            return False
        self._acknowledge()
        self._reader.feed(data)
        self.carry_on()
        return True

    def carry_on(self) -> None:
        """Carries out commands until none is left or the bus takes no more frames."""
        if self._waiting is not None:
            self._inject(self._waiting)
        while self._waiting is None and (command := self._reader.next()) is not None:
            self._carry_out(command)

    def _carry_out(self, command: Command) -> None:
        word = command.word
        if word == "send":
            self._send(command)
        elif word == "echo":
            self._answer(ECHO)
        elif word == "open":
            self._open(command)
        elif word == "rawmode" and self._mode is not _Mode.NO_BUS:
            if self._mode is _Mode.OPEN:
                self._quiet_until_ns = self._monotonic_ns() + self._terms.quiet_ns
            self._mode = _Mode.RAW
            self._answer(OK)
        elif word == "rawmode":
            self._answer(error("open a bus first"))
        elif word in ("bcmmode", "controlmode", "isotpmode", "sendrtr"):
            self._answer(error(f"{word} is not served here, only rawmode is"))
        else:
            self._answer(error("unknown command"))

    def _open(self, command: Command) -> None:
        """Whatever its name, there is one bus."""
        if self._mode is not _Mode.NO_BUS:
            self._answer(error("a bus is open already"))
        elif len(command.arguments) != 1 or len(command.arguments[0]) > MAX_NAME:
            self._answer(error(f"open: must name one bus, of at most {MAX_NAME} letters"))
        else:
            self._mode = _Mode.OPEN
            self._answer(OK)

    def _send(self, command: Command) -> None:
        if self._terms.inject is None:
            self.refused += 1
            self._answer(error("listen-only: start the server with --allow-inject to send"))
            return
        if self._mode is _Mode.NO_BUS:
            self.refused += 1
            self._answer(error("open a bus first"))
            return
        try:
            frame = parse_send(command.arguments, extended=self._terms.extended)
        except ValueError as wrong:
            self.refused += 1
            self._answer(error(str(wrong)))
            return
        self._inject(frame)

    def _inject(self, frame: Frame) -> None:
        assert self._terms.inject is not None
        if self._terms.inject(frame):
            self._waiting = None
            self.injected += 1
        else:
            self._waiting = frame

    def _answer(self, element: bytes) -> None:
        if len(self._answers) + len(element) <= ANSWER_LIMIT:
            self._answers += element

    def hang_up(self) -> None:
        """Says that nothing more will come. What the client still sends is read away: unread, it would cost it our last frames."""
        with contextlib.suppress(OSError):  # BlockingIOError, too: nothing there
            self.connection.shutdown(socket.SHUT_WR)
            for _ in range(64):
                if not self.connection.recv(RECEIVE_BYTES):
                    break

    def close(self) -> None:
        self.connection.close()
