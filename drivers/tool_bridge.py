"""Between a python-can bus and the server for tools: what is on the one goes out on the other, and back where allowed."""

from __future__ import annotations

from collections.abc import Callable

import can

from drivers.bus.carrier import reason
from drivers.frame import Frame
from drivers.socketcand import SocketcandServer
from drivers.socketcand_protocol import EXTENDED, MAX_EXTENDED_ID

POLL_S = 0.002
"""How long a frame from a tool may have to wait for the bus while that is silent."""


class BridgeError(RuntimeError):
    """The bus cannot be opened, or has gone."""


class ToolBridge:
    """A python-can bus and the server that is fed from it. A context manager that closes the bus, not the server.

    Classical data frames with identifiers of 11 and 29 bits; remote, error and FD frames cannot be expressed in the
    protocol and are left out, counted in `skipped`. Frames from tools are seen by all tools once they are on the wire.
    """

    def __init__(self, interface: str, channel: str, server: SocketcandServer) -> None:
        """Raises BridgeError where python-can cannot open `channel` of `interface`."""
        try:
            self._bus = can.Bus(interface=interface, channel=channel, receive_own_messages=True)
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            raise BridgeError(f"{interface}:{channel} cannot be opened: {reason(error)}") from error
        self.skipped = 0
        self._server = server
        self._unsent: can.Message | None = None

    def __enter__(self) -> ToolBridge:
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.shutdown()

    def pump(self, go_on: Callable[[], bool]) -> None:
        """Carries frames both ways for as long as `go_on` says so. Raises BridgeError when the bus is gone."""
        while go_on():
            try:
                message = self._bus.recv(POLL_S)
            except (can.CanError, OSError) as error:
                raise BridgeError(f"{self._bus.channel_info} has gone: {reason(error)}") from error
            if message is not None:
                self._publish(message)
            self._send()

    def _publish(self, message: can.Message) -> None:
        if message.is_error_frame or message.is_remote_frame or message.is_fd:
            self.skipped += 1
            return
        can_id = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
        self._server(Frame(can_id, bytes(message.data), round(message.timestamp * 1e6) * 1000))

    def _send(self) -> None:
        """All that tools want to send. What the interface does not take now is tried again later, in order."""
        while (message := self._unsent or self._next()) is not None:
            try:
                self._bus.send(message)
            except can.CanOperationError:
                self._unsent = message
                return
            self._unsent = None

    def _next(self) -> can.Message | None:
        frame = self._server.take()
        return None if frame is None else _message(frame)


def _message(frame: Frame) -> can.Message:
    extended = bool(frame.can_id & EXTENDED)
    return can.Message(
        arbitration_id=frame.can_id & MAX_EXTENDED_ID,
        is_extended_id=extended,
        data=frame.data,
    )
