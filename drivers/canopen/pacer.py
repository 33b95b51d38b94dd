"""Keeps a burst of SDO requests from filling the bus: heartbeats have the lowest priority of all, and would starve behind it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from drivers.clock import Clock

Send = Callable[[int, bytes], bool]


class Pacer:
    """Passes frames on at least `gap_ns` apart, in the order in which they came. `gap_ns = 0` passes everything at once.

    `send` has the meaning of a port's; a frame that the port refuses is offered again after the next gap.
    """

    def __init__(self, send: Send, clock: Clock, gap_ns: int) -> None:
        if gap_ns < 0:
            raise ValueError(f"gap_ns {gap_ns}: must not be negative")
        self._send = send
        self._clock = clock
        self._gap_ns = gap_ns
        self._free_ns = 0
        self._waiting: deque[tuple[int, bytes]] = deque()

    def send(self, can_id: int, data: bytes) -> bool:
        """True: sent, or will be."""
        if self._gap_ns == 0:
            return self._send(can_id, data)
        now_ns = self._clock.now_ns()
        if not self._waiting and now_ns >= self._free_ns:
            self._free_ns = now_ns + self._gap_ns
            return self._send(can_id, data)
        if not self._waiting:
            self._clock.call_at(self._free_ns, self._next)
        self._waiting.append((can_id, data))
        return True

    def _next(self) -> None:
        if self._send(*self._waiting[0]):
            self._waiting.popleft()
        self._free_ns = self._clock.now_ns() + self._gap_ns
        if self._waiting:
            self._clock.call_at(self._free_ns, self._next)
