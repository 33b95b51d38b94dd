"""A node's end of the bus: one port, frames handed out by identifier."""

from __future__ import annotations

from collections.abc import Callable

from drivers.bus.base import Bus, Port
from drivers.frame import Frame

Handler = Callable[[Frame], None]


class Line:
    """Sends and receives for all services of one node.

    `refused` counts frames that the bus did not take (queue full, bus off): they are lost, and whoever needs them
    on the wire has to look at what `send` returns. With `connected` False nothing goes in or out: a node without power.
    """

    def __init__(self, name: str, bus: Bus) -> None:
        self.name = name
        self.refused = 0
        self.connected = True
        self._bus = bus
        self._port: Port | None = None
        self._handlers: dict[int, list[Handler]] = {}
        self._dispatch: dict[int, Handler] = {}
        self._heard: set[int] = set()

    def connect(self) -> None:
        """Attaches to the bus for everything that is listened to by now."""
        self._heard = set(self._handlers)
        self._port = self._bus.attach(self.name, sorted(self._heard), self._on_frame)

    def listen(self, can_id: int, handler: Handler) -> None:
        """`handler` gets the frames of `can_id` from now on, after those that listened earlier."""
        self._handlers.setdefault(can_id, []).append(handler)
        self._compile(can_id)
        if self._port is not None and can_id not in self._heard:
            # a port's filter is fixed when it is made, and identifiers may be changed over SDO
            self._heard.add(can_id)
            self._bus.attach(f"{self.name} {can_id:03X}h", [can_id], self._on_frame)

    def ignore(self, can_id: int, handler: Handler) -> None:
        """Ends what `listen` began; harmless if there was nothing."""
        handlers = self._handlers.get(can_id, [])
        if handler in handlers:
            handlers.remove(handler)
        self._compile(can_id)

    def send(self, can_id: int, data: bytes) -> bool:
        """Whether the bus took the frame."""
        if self._port is None or not self.connected:
            return False
        if self._port.send(can_id, data):
            return True
        self.refused += 1
        return False

    def _compile(self, can_id: int) -> None:
        handlers = tuple(self._handlers.get(can_id, ()))
        if not handlers:
            self._dispatch.pop(can_id, None)
        elif len(handlers) == 1:
            self._dispatch[can_id] = handlers[0]
        else:

            def every(frame: Frame) -> None:
                for handler in handlers:
                    handler(frame)

            self._dispatch[can_id] = every

    def _on_frame(self, frame: Frame) -> None:
        handler = self._dispatch.get(frame.can_id)
        if handler is not None and self.connected:
            handler(frame)
