"""Time on a real wire: the nodes' `Clock` on a clock that cannot be stopped, and the loop that merges timers with frames.

Events come in the order of time: a timer at the time it is due, a frame at the time it arrived. Nothing happens before
the injected clock has got there, and what is late is made up for in the right order: after a pause, the frames that
arrived meanwhile are heard before a time-out that they would have prevented. In each callback `now_ns()` is the time
of its event, so periods that are made of `now_ns() + period` keep to their grid and do not drift.
"""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush
from typing import Protocol

from drivers.clock import Timer

CATCH_UP_NS = 2_000_000
LATE_NS = 2_000_000


class FrameSource(Protocol):
    """Where frames come from; a bus."""

    def first_ns(self) -> int | None:
        """Takes in what has arrived. Arrival of the oldest frame that was not handed out yet, None if there is none."""

    def waiting_ns(self) -> int | None:
        """The same of what was taken in already: nothing is asked of the system."""

    def hand_out(self, t_ns: int) -> None:
        """Gives the oldest frame to all who hear it, stamped `t_ns`."""

    def wait(self, timeout_ns: int) -> None:
        """Returns when a frame has arrived, or after `timeout_ns`."""


class _Timer:
    __slots__ = ("callback",)

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        self.callback = None


class RealTimeClock:
    """Timers by `now_ns`, frames from `source`, one thread.

    A timer that is called later than `late_ns` is an overrun: `overruns` counts them, `max_lateness_ns` is the worst of all.
    One that is later than `catch_up_ns` is told the present time instead of its own, so that whoever has to do something
    once per period (a SYNC) leaves out what cannot be made up for.

    The system is asked once a round: the time, then what has arrived. All that happened up to that time is then known, and is
    gone through in order. System calls may cost as much as a callback (a user-mode kernel answers even «what time is it?» by one).
    """

    def __init__(
        self,
        now_ns: Callable[[], int],
        source: FrameSource,
        *,
        catch_up_ns: int = CATCH_UP_NS,
        late_ns: int = LATE_NS,
        grain_ns: int = 1,
    ) -> None:
        """`now_ns` must never run backwards.

        `grain_ns`: nobody is woken up for a timer but at multiples of this; it is called by the next of them at the latest, and
        with the time at which it was due. Lateness counts from there. A frame wakes up at once.
        """
        self.overruns = 0
        self.max_lateness_ns = 0
        self._read = now_ns
        self._source = source
        self._catch_up_ns = catch_up_ns
        self._late_ns = late_ns
        self._grain_ns = grain_ns
        self._now_ns = now_ns()
        self._heap: list[tuple[int, int, int, _Timer]] = []
        self._sequence = 0
        self._running = False
        self._stopped = False

    def now_ns(self) -> int:
        """Time of the event in progress; between runs, the present."""
        if not self._running:
            self._now_ns = max(self._now_ns, self._read())
        return self._now_ns

    def call_at(self, t_ns: int, callback: Callable[[], None], priority: int = 0) -> Timer:
        """See `Clock.call_at`. What lies in the past is due at once: here time goes on while one computes."""
        timer = _Timer(callback)
        sequence = self._sequence
        self._sequence = sequence + 1
        heappush(self._heap, (t_ns, priority, sequence, timer))
        return timer

    def run_until(self, t_ns: int) -> None:
        """Runs every event up to `t_ns`, and returns then, or soon after `stop`. Exceptions pass through."""
        self._running, self._stopped = True, False
        try:
            while not self._stopped:
                present_ns = self._read()
                if self._round(t_ns, present_ns) or self._stopped:
                    continue
                waiting_ns = self._source.waiting_ns()
                if waiting_ns is not None and waiting_ns > t_ns:
                    return
                if present_ns >= t_ns:
                    self._now_ns = max(self._now_ns, t_ns)
                    return
                due_ns = self._on_grain(self._heap[0][0]) if self._heap else t_ns
                self._source.wait(min(due_ns, t_ns) - present_ns)
        finally:
            self._running = False

    def _round(self, t_ns: int, present_ns: int) -> bool:
        """All that has happened up to `present_ns`, in order, and what of it is due by `t_ns`. False: nothing was."""
        heap, source = self._heap, self._source
        arrival_ns, worked = source.first_ns(), False
        while not self._stopped:
            due_ns = heap[0][0] if heap else t_ns + 1
            if arrival_ns is not None and arrival_ns <= due_ns:
                if arrival_ns > t_ns:
                    break
                self._now_ns = max(self._now_ns, arrival_ns)
                source.hand_out(self._now_ns)
            elif due_ns <= present_ns and due_ns <= t_ns:
                self._call(due_ns, present_ns)
            else:
                break
            worked = True
            arrival_ns = source.waiting_ns()
        return worked

    def _on_grain(self, t_ns: int) -> int:
        return -(-t_ns // self._grain_ns) * self._grain_ns

    def stop(self) -> None:
        """Makes the `run_until` in progress return after the present event. May be called from a signal handler."""
        self._stopped = True

    def forget_lateness(self) -> None:
        """Counts overruns anew: what came before belongs to the preparation."""
        self.overruns = self.max_lateness_ns = 0

    def _call(self, due_ns: int, present_ns: int) -> None:
        callback = heappop(self._heap)[3].callback
        if callback is None:
            return
        lateness_ns = present_ns - self._on_grain(due_ns)
        if lateness_ns > self.max_lateness_ns:
            self.max_lateness_ns = lateness_ns
        if lateness_ns > self._late_ns:
            self.overruns += 1
        self._now_ns = max(self._now_ns, due_ns if lateness_ns <= self._catch_up_ns else present_ns)
        callback()
