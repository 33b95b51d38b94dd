"""Time for everything below `canipulator`: nodes see a `Clock`, and cannot tell virtual time from real time."""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush
from typing import Protocol

LAST = 1 << 30
"""Priority of what has to come after everything else of the same instant (the bus decides its arbitration then)."""


class Timer(Protocol):
    """A call that was asked for and may be called off."""

    def cancel(self) -> None:
        """The callback will not be called; harmless when it already was."""


class Clock(Protocol):
    """Integer nanoseconds that never run backwards, and calls at a time."""

    def now_ns(self) -> int: ...

    def call_at(self, t_ns: int, callback: Callable[[], None], priority: int = 0) -> Timer:
        """Calls `callback` at `t_ns`. Same time: lower `priority` first, then in the order of the requests."""


class VirtualClock(Clock, Protocol):
    """A clock that need not wait."""

    def skip_to(self, t_ns: int) -> bool:
        """Moves time on to `t_ns` now if no event is due before or then. False: time stays, use `call_at`."""


class _LockstepTimer:
    __slots__ = ("callback",)

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        self.callback = None


class LockstepClock:
    """Discrete-event clock: time jumps from event to event, so a run is as fast as its events are computed.

    The order of events depends only on (time, priority, order of request): same calls, same run.
    """

    __slots__ = ("_end_ns", "_heap", "_now_ns", "_sequence")

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns
        self._heap: list[tuple[int, int, int, _LockstepTimer]] = []
        self._sequence = 0
        self._end_ns = -1  # of the `run_until` in progress; -1: none, or it shall stop

    def now_ns(self) -> int:
        return self._now_ns

    def call_at(self, t_ns: int, callback: Callable[[], None], priority: int = 0) -> Timer:
        """See `Clock.call_at`. Raises ValueError for a time in the past; the present instant is allowed."""
        if t_ns < self._now_ns:
            raise ValueError(f"call_at({t_ns} ns): lies {self._now_ns - t_ns} ns in the past; must be now or later")
        timer = _LockstepTimer(callback)
        sequence = self._sequence
        self._sequence = sequence + 1
        heappush(self._heap, (t_ns, priority, sequence, timer))
        return timer

    def run_until(self, t_ns: int) -> None:
        """Runs every event up to and including `t_ns`; time is then `t_ns`, or that of the event that called `stop`.

        Exceptions of callbacks pass through; time then stays at the event that raised.
        """
        self._end_ns = t_ns
        heap = self._heap
        try:
            while heap and heap[0][0] <= t_ns:
                due_ns, _, _, timer = heappop(heap)
                callback = timer.callback
                if callback is None:
                    continue
                self._now_ns = due_ns
                callback()
                if self._end_ns < t_ns:
                    return
            self._now_ns = max(self._now_ns, t_ns)
        finally:
            self._end_ns = -1

    def skip_to(self, t_ns: int) -> bool:
        """See `VirtualClock.skip_to`. Time never gets beyond the end of the `run_until` in progress."""
        heap = self._heap
        if t_ns > self._end_ns or (heap and heap[0][0] <= t_ns):
            return False
        self._now_ns = t_ns
        return True

    def stop(self) -> None:
        """Makes the `run_until` in progress return after the present event; what is scheduled stays scheduled."""
        self._end_ns = -1
