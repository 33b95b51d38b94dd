"""What carries frames out of the process and in: python-can for every interface it knows, and a short way for SocketCAN.

Both are opened by python-can. On a SocketCAN socket its `recv` costs three system calls a frame, where all that has arrived
can be had by one (recvmmsg).
"""

from __future__ import annotations

import contextlib
import errno
import logging
import select
import socket
from typing import Any, NamedTuple, Protocol

import can

from drivers.bus.socket_frames import FrameReader, pack

GIVES_BACK = frozenset({"socketcan", "virtual"})
"""Interfaces whose `receive_own_messages` was tried and found to keep the order of the wire."""
SERVED, HOST = "served", "127.0.0.1"
RECEIVE_BUFFER_BYTES = 4 << 20
NS_PER_S = 1_000_000_000
_SO_RCVBUFFORCE = 33
"""Not in Python's module: beyond the system's limit, for those with CAP_NET_ADMIN."""
_ERROR_FRAME = 0x2000_0000
_NOT_OURS = 0xC000_0000
"""Extended and remote frames."""


class BusError(OSError):
    """A bus that cannot be opened, or that has gone away; the message is one line for the person who named it."""


class Arrival(NamedTuple):
    """A data frame as it came in; `stamp_ns` in the interface's own clock. `can_id` -1: an error frame."""

    stamp_ns: int
    can_id: int
    data: bytes


class Carrier(Protocol):
    """`gives_back`: what is sent is received, too."""

    gives_back: bool

    def send(self, can_id: int, data: bytes) -> bool:
        """False when the interface does not take the frame."""

    def receive(self) -> list[Arrival]:
        """All that is there, in the order of the wire. Raises OSError or can.CanError when the bus has gone away."""

    def wait(self, timeout_s: float) -> list[Arrival]:
        """Waits for something to receive; may return it at once, or nothing for the caller to look himself."""

    def close(self) -> None: ...


class PythonCanCarrier:
    """Any interface of python-can."""

    def __init__(self, bus: can.BusABC, gives_back: bool) -> None:
        self.gives_back = gives_back
        self._bus = bus

    def send(self, can_id: int, data: bytes) -> bool:
        try:
            self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        except (can.CanError, OSError):
            return False
        return True

    def receive(self) -> list[Arrival]:
        return self.wait(0.0)

    def wait(self, timeout_s: float) -> list[Arrival]:
        arrivals: list[Arrival] = []
        while (message := self._bus.recv(timeout_s)) is not None:
            stamp_ns = round(message.timestamp * NS_PER_S)
            if message.is_error_frame:
                arrivals.append(Arrival(stamp_ns, -1, b""))
            elif not (message.is_extended_id or message.is_remote_frame or message.is_fd):
                arrivals.append(Arrival(stamp_ns, message.arbitration_id, bytes(message.data)))
            timeout_s = 0.0
        return arrivals

    def close(self) -> None:
        self._bus.shutdown()


class SocketCarrier:
    """The socket of a `socketcan` bus, which keeps it open."""

    gives_back = True

    def __init__(self, bus: can.BusABC, carrier: socket.socket) -> None:
        self._bus = bus
        self._socket = carrier
        carrier.setblocking(False)
        for option in (socket.SO_RCVBUF, _SO_RCVBUFFORCE):  # as far as the system allows: what does not fit in is lost
            with contextlib.suppress(OSError):
                carrier.setsockopt(socket.SOL_SOCKET, option, RECEIVE_BUFFER_BYTES)
        self._reader = FrameReader(carrier.fileno())

    def send(self, can_id: int, data: bytes) -> bool:
        try:
            self._socket.send(pack(can_id, data))
        except OSError:
            return False
        return True

    def receive(self) -> list[Arrival]:
        return [
            Arrival(stamp_ns, -1 if can_id & _ERROR_FRAME else can_id, data)
            for stamp_ns, can_id, data in self._reader.read()
            if not can_id & _NOT_OURS
        ]

    def wait(self, timeout_s: float) -> list[Arrival]:
        select.select([self._socket], [], [], timeout_s)
        return []

    def close(self) -> None:
        self._bus.shutdown()


def open_carrier(url: str, bitrate: int) -> Carrier:
    """`interface:channel`, with further arguments of python-can as `?key=value&key=value`, or `served:port`. Raises BusError.

    `served`: what a `--serve` of this project serves on 127.0.0.1, which gives back what it was sent.
    """
    interface, channel, arguments = _parse(url)
    served = interface == SERVED
    if served:
        interface, channel, arguments = "socketcand", "can0", _at_server(url, channel)
    gives_back = served or interface in GIVES_BACK
    if interface in GIVES_BACK:
        arguments["receive_own_messages"] = True
    logging.getLogger("can").addHandler(logging.NullHandler())  # what it would print is in the exception as well
    try:
        bus = can.Bus(interface=interface, channel=channel, **{"bitrate": bitrate, **arguments})
    except (can.CanError, ImportError, OSError, TypeError, ValueError) as error:
        raise BusError(f"{url}: cannot be opened: {reason(error)}") from error
    carrier = getattr(bus, "socket", None)
    if interface == "socketcan" and isinstance(carrier, socket.socket):
        return SocketCarrier(bus, carrier)
    return PythonCanCarrier(bus, gives_back)


def _parse(url: str) -> tuple[str, str, dict[str, Any]]:
    interface, colon, rest = url.partition(":")
    channel, _, query = rest.partition("?")
    if not interface or not colon or not channel:
        raise BusError(f"--bus {url!r}: must be lockstep, or interface:channel of python-can, e.g. socketcan:vcan0")
    if interface not in (SERVED, *can.VALID_INTERFACES):
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise BusError(f"--bus {url!r}: python-can has no interface {interface!r}; it has {known}")
    arguments: dict[str, Any] = {}
    for pair in filter(None, query.split("&")):
        key, _, text = pair.partition("=")
        arguments[key] = int(text) if text.isdecimal() else text
    return interface, channel, arguments


def _at_server(url: str, port: str) -> dict[str, Any]:
    if not (port.isdecimal() and 0 < int(port) < 1 << 16):
        raise BusError(f"--bus {url!r}: must be served:PORT, the port that the server has said, on this machine")
    return {"host": HOST, "port": int(port), "tcp_tune": True}


def reason(error: Exception) -> str:
    """The system's words, and what they mean here."""
    number = getattr(error, "errno", None)
    if number == errno.EAFNOSUPPORT:
        return "this kernel has no CAN sockets"
    if number == errno.ENODEV:
        return "there is no such interface (ip link add dev vcan0 type vcan; ip link set vcan0 up)"
    if number == errno.ENETDOWN:
        return "the interface is down (ip link set … up)"
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return " ".join(str(text).split())
