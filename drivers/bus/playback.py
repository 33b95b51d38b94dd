"""A recorded bus: everybody's frames come from a log, except those of the nodes that are attached, which are compared with it.

Times are those of the log. What the attached nodes send is taken off their queues when the log says that it was on the wire, so they
meet the same queue, the same order and the same instants as in the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from heapq import merge
from typing import NamedTuple

from drivers.bus.base import OnFrame
from drivers.clock import LAST, LockstepClock
from drivers.frame import INTERFRAME_BITS, Frame, bit_length, check_frame

RESOLUTION_NS = 1000
"""Of the times in a log: they are rounded down to whole microseconds."""
IDLE_BITS = 400
"""A bus that has been free for so long had nobody who wanted to send (two frames and their error frames are shorter)."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A frame of the log and what was sent in its place. `recorded` None: sent, but never seen on the wire; `sent` None: not sent."""

    recorded: Frame | None
    sent: Frame | None
    sync_count: int
    """SYNC frames up to then, this one included."""

    @property
    def same(self) -> bool:
        """Whether identifier and bytes agree."""
        return self.recorded is not None and self.sent is not None and self.recorded.data == self.sent.data


class _OnWire(NamedTuple):
    """A frame as it was sent, and as everybody got it (None: nobody did)."""

    sent: Frame
    received: Frame | None


def _on_wire(frames: Iterable[Frame], as_sent: Iterable[Frame]) -> Iterable[_OnWire]:
    """Both logs as one, in the order of the times; two frames of one identifier cannot end in the same microsecond."""
    before = {(frame.t_ns, frame.can_id): frame for frame in as_sent}
    if not before:
        return (_OnWire(frame, frame) for frame in frames)
    entries = [_OnWire(before.pop((frame.t_ns, frame.can_id), frame), frame) for frame in frames]
    swallowed = [_OnWire(frame, None) for frame in before.values()]
    return merge(entries, swallowed, key=lambda entry: entry.sent.t_ns)


class PlaybackPort:
    """A node's access: what it sends waits until the log says that the wire was its."""

    __slots__ = ("_bus", "can_ids", "name", "on_frame", "queued", "refused")

    def __init__(self, bus: PlaybackBus, name: str, can_ids: frozenset[int] | None, on_frame: OnFrame) -> None:
        self._bus = bus
        self.name = name
        self.can_ids = can_ids
        self.on_frame = on_frame
        self.queued = 0
        self.refused = 0

    def send(self, can_id: int, data: bytes) -> bool:
        """Queues a frame; False and counted as refused when the queue is full. Raises ValueError for what is no standard data frame."""
        return self._bus._request(self, can_id, data)


class PlaybackBus:
    """Plays `frames` (in the order of their times) on `clock` to whatever is attached.

    `own_ids`: identifiers that the attached nodes send. Each such frame of the log, and each frame sent in excess, is given to `on_pair`
    in the order of the wire. Frames that wait when the log ends are left alone: they may have been on their way.
    `as_sent`: frames (in the order of their times) that an injected fault kept from everybody, or that came out of it with other bytes, as
    they were when they were sent: they take their time on the wire and their sender is compared with them.
    """

    def __init__(
        self,
        clock: LockstepClock,
        frames: Iterable[Frame],
        own_ids: frozenset[int],
        on_pair: Callable[[Pair], None],
        *,
        as_sent: Iterable[Frame] = (),
        sync_id: int = 0x080,
        bitrate: int = 1_000_000,
        queue_limit: int = 64,
    ) -> None:
        self._clock = clock
        self._frames: Iterator[_OnWire] = iter(_on_wire(frames, as_sent))
        self._own_ids = own_ids
        self._on_pair = on_pair
        self._sync_id = sync_id
        self._bit_ns = 1_000_000_000 // bitrate
        self._queue_limit = queue_limit
        self._ports: list[PlaybackPort] = []
        self._observers: list[OnFrame] = []
        self._pending: list[tuple[PlaybackPort, Frame]] = []
        self._free_ns = 0
        self._syncs = 0
        self.ended = False
        """The log has been played to its end."""

    def attach(self, name: str, can_ids: Iterable[int] | None, on_frame: OnFrame) -> PlaybackPort:
        """See `Bus.attach`."""
        port = PlaybackPort(self, name, None if can_ids is None else frozenset(can_ids), on_frame)
        self._ports.append(port)
        return port

    def observe(self, on_frame: OnFrame) -> None:
        """`on_frame` gets every frame of the log."""
        self._observers.append(on_frame)

    def start(self) -> None:
        """Schedules the first frame; the clock does the rest."""
        self._next()

    def _request(self, port: PlaybackPort, can_id: int, data: bytes) -> bool:
        check_frame(can_id, data)
        if port.queued >= self._queue_limit:
            port.refused += 1
            return False
        port.queued += 1
        self._pending.append((port, Frame(can_id, bytes(data), self._clock.now_ns())))
        return True

    def _next(self) -> None:
        entry = next(self._frames, None)
        if entry is None:
            self.ended = True
            self._clock.stop()
            return
        frame = entry.sent
        start_ns = frame.t_ns - (bit_length(frame.can_id, frame.data) - INTERFRAME_BITS) * self._bit_ns
        # begun at LAST, ended at 0: the places that a lockstep bus gives arbitration and reception among the events of an instant
        self._clock.call_at(max(start_ns, self._clock.now_ns()), lambda: self._begin(entry, start_ns), LAST)

    def _begin(self, entry: _OnWire, start_ns: int) -> None:
        self._look_for_excess(entry.sent, start_ns)
        self._clock.call_at(max(entry.sent.t_ns, self._clock.now_ns()), lambda: self._end(entry))

    def _look_for_excess(self, frame: Frame, start_ns: int) -> None:
        """What waits and would have won this arbitration, or could have gone before it, was not sent in the run."""
        idle_ns = IDLE_BITS * self._bit_ns
        for entry in list(self._pending):
            port, waiting = entry
            ready_ns = max(waiting.t_ns, self._free_ns)
            passed_over = waiting.can_id < frame.can_id and waiting.t_ns + RESOLUTION_NS <= start_ns
            if passed_over or ready_ns + idle_ns <= start_ns:
                self._take(entry)
                port.queued -= 1
                self._on_pair(Pair(None, waiting, self._syncs))

    def _end(self, entry: _OnWire) -> None:
        can_id, t_ns = entry.sent.can_id, entry.sent.t_ns
        self._free_ns = t_ns + INTERFRAME_BITS * self._bit_ns
        self._syncs += can_id == self._sync_id
        if can_id in self._own_ids:
            self._on_pair(Pair(entry.sent, self._sent(can_id), self._syncs))
        if entry.received is not None:
            self._deliver(entry.received)
        self._next()

    def _deliver(self, frame: Frame) -> None:
        for observer in self._observers:
            observer(frame)
        if frame.can_id not in self._own_ids:
            for port in tuple(self._ports):
                if port.can_ids is None or frame.can_id in port.can_ids:
                    port.on_frame(frame)

    def _sent(self, can_id: int) -> Frame | None:
        """The oldest frame that waits under this identifier; its sender gets its place in the queue back."""
        for entry in self._pending:
            if entry[1].can_id == can_id:
                self._take(entry)
                entry[0].queued -= 1
                return entry[1]
        return None

    def _take(self, entry: tuple[PlaybackPort, Frame]) -> None:
        """By identity: equal frames of one instant are different entries."""
        self._pending = [other for other in self._pending if other is not entry]
