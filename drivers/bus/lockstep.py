"""The in-process CAN: a discrete-event model of one bus, bit-exact in its timing, on a `Clock` in virtual time.

What it models: arbitration by identifier among all that is pending, exact frame length with stuff bits, bit rate,
inter-frame space, bounded transmit queues. What it does not: propagation delay, clock tolerance, error counters, and
the collision of two nodes that send one identifier in the same instant (they go one after the other).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from heapq import heapify, heappop, heappush

from drivers.bus.base import BusStatistics, Latency, OnFrame
from drivers.bus.interception import Intercept
from drivers.bus.load import LoadMeter
from drivers.clock import LAST, VirtualClock
from drivers.frame import INTERFRAME_BITS, MAX_CAN_ID, MAX_DATA_BYTES, Frame, bit_length, check_frame

NS_PER_S = 1_000_000_000
ERROR_FRAME_BITS = 6 + 6 + 8
"""Error flag, its echo by the other nodes, error delimiter (CAN 2.0 A, chapter 3.1.3)."""


_Request = tuple[int, int, "LockstepPort", bytes, int]
"""A frame that waits for the bus: identifier, sequence number, port, data, time of the request. It is as urgent as it is small."""


class _Id:
    """What the bus keeps per identifier: who hears it (None: to be looked up), and the latency of its frames."""

    __slots__ = ("count", "max_ns", "route", "total_ns")

    def __init__(self) -> None:
        self.route: tuple[tuple[LockstepPort, OnFrame], ...] | None = None
        self.count = 0
        self.total_ns = 0
        self.max_ns = 0


class LockstepPort:
    """A node's controller: bounded transmit queue, acceptance filter, on the bus or off it."""

    __slots__ = ("_bus", "can_ids", "dropped", "name", "on_frame", "online", "queue_limit", "queued", "refused")

    def __init__(
        self, bus: LockstepBus, name: str, can_ids: frozenset[int] | None, on_frame: OnFrame, limit: int
    ) -> None:
        self._bus = bus
        self.name = name
        self.can_ids = can_ids
        self.on_frame = on_frame
        self.queue_limit = limit
        self.queued = 0
        self.refused = 0
        self.dropped = 0
        self.online = True

    def send(self, can_id: int, data: bytes) -> bool:
        """Queues a frame; False and counted as refused when the queue is full or the port is off the bus.

        Raises ValueError for what is no standard data frame.
        """
        return self._bus._request(self, can_id, data)


class LockstepBus:
    """One CAN bus on a virtual clock. Same requests, same frames at the same nanosecond."""

    def __init__(
        self,
        clock: VirtualClock,
        bitrate: int = 1_000_000,
        *,
        queue_limit: int = 64,
        load_window_ns: int = 100_000_000,
        intercept: Intercept | None = None,
    ) -> None:
        """`bitrate` in bit/s, must divide 1e9 (as all CANopen bit rates do); `queue_limit` in frames per port."""
        if not 0 < bitrate <= 1_000_000 or NS_PER_S % bitrate:
            raise ValueError(f"bitrate {bitrate} bit/s: must be within 1 … 1000000 and divide 1e9 (800k, 500k, …)")
        if queue_limit < 1:
            raise ValueError(f"queue_limit {queue_limit}: must be at least 1 frame")
        self.bitrate = bitrate
        self.intercept = intercept
        self._clock = clock
        self._bit_ns = NS_PER_S // bitrate
        self._queue_limit = queue_limit
        self._ports: dict[str, LockstepPort] = {}
        self._observers: tuple[OnFrame, ...] = ()
        self._pending: list[_Request] = []
        self._on_wire: _Request | None = None
        self._free_ns = clock.now_ns()  # when the next frame may start, once nothing is on the wire
        self._arbitration_due = False
        self._sequence = 0
        self._ids: dict[int, _Id] = {}
        self._load = LoadMeter(clock.now_ns(), load_window_ns)
        self._bits = 0
        self._error_frames = 0

    def attach(self, name: str, can_ids: Iterable[int] | None, on_frame: OnFrame) -> LockstepPort:
        """See `Bus.attach`. Raises ValueError when `name` is taken."""
        if name in self._ports:
            raise ValueError(f"port name {name!r} is taken: names of ports must differ")
        accepted = None if can_ids is None else frozenset(can_ids)
        port = LockstepPort(self, name, accepted, on_frame, self._queue_limit)
        self._ports[name] = port
        self._forget_routes()
        return port

    def observe(self, on_frame: OnFrame) -> None:
        self._observers = (*self._observers, on_frame)

    def disconnect(self, name: str) -> None:
        """Takes a port off the bus (bus-off, cut cable): its queue is lost, sends are refused, it hears nothing.

        A frame of it that is on the wire right now still ends: its time is spent, but nobody gets it.
        """
        port = self._ports[name]
        port.online = False
        kept = [request for request in self._pending if request[2] is not port]
        lost = len(self._pending) - len(kept)
        port.dropped += lost
        port.queued -= lost
        heapify(kept)
        self._pending = kept
        self._forget_routes()

    def reconnect(self, name: str) -> None:
        """The port takes part again from now on."""
        self._ports[name].online = True
        self._forget_routes()

    @property
    def port_names(self) -> tuple[str, ...]:
        """Every port, in the order in which they were attached."""
        return tuple(self._ports)

    def statistics(self) -> BusStatistics:
        """The traffic since the bus was made."""
        now_ns = self._clock.now_ns()
        seen = {can_id: entry for can_id, entry in sorted(self._ids.items()) if entry.count}
        return BusStatistics(
            frames=sum(entry.count for entry in seen.values()),
            bits=self._bits,
            busy_ns=self._load.busy_ns,
            load_mean=self._load.mean(now_ns),
            load_peak=self._load.peak(now_ns),
            window_ns=self._load.window_ns,
            error_frames=self._error_frames,
            refused={port.name: port.refused for port in self._ports.values()},
            dropped={port.name: port.dropped for port in self._ports.values()},
            latency={
                can_id: Latency(entry.count, entry.total_ns / entry.count, entry.max_ns)
                for can_id, entry in seen.items()
            },
        )

    def _forget_routes(self) -> None:
        for entry in self._ids.values():
            entry.route = None

    def _request(self, port: LockstepPort, can_id: int, data: bytes) -> bool:
        if not 0 <= can_id <= MAX_CAN_ID or len(data) > MAX_DATA_BYTES:
            check_frame(can_id, data)
        if port.queued >= port.queue_limit or not port.online:
            port.refused += 1
            return False
        port.queued += 1
        now_ns = self._clock.now_ns()
        sequence = self._sequence
        self._sequence = sequence + 1
        heappush(self._pending, (can_id, sequence, port, bytes(data), now_ns))
        if self._on_wire is None and not self._arbitration_due:
            self._schedule_arbitration(now_ns)
        return True

    def _schedule_arbitration(self, now_ns: int) -> None:
        self._arbitration_due = True
        free_ns = self._free_ns
        # LAST: whatever is requested in the same instant takes part
        self._clock.call_at(free_ns if free_ns > now_ns else now_ns, self._arbitrate, LAST)

    def _arbitrate(self) -> None:
        """Frame after frame for as long as nothing else happens meanwhile; otherwise the clock calls when it is time to go on.

        `_arbitration_due` holds all the while: whatever is sent takes part in the next round.
        """
        clock, bit_ns = self._clock, self._bit_ns
        while self._pending:  # a port that goes off the bus takes its requests with it
            request = heappop(self._pending)
            bits = bit_length(request[0], request[3])
            start_ns = clock.now_ns()
            self._free_ns = free_ns = start_ns + bits * bit_ns
            self._bits += bits
            self._load.add(start_ns, free_ns)
            end_ns = free_ns - INTERFRAME_BITS * bit_ns
            if not clock.skip_to(end_ns):
                self._on_wire = request
                clock.call_at(end_ns, self._end_frame)
                break
            self._receive(request, end_ns)
            if self._pending and not clock.skip_to(self._free_ns):
                clock.call_at(self._free_ns, self._arbitrate, LAST)
                return
        self._arbitration_due = False

    def _end_frame(self) -> None:
        request = self._on_wire
        assert request is not None
        self._on_wire = None
        now_ns = self._clock.now_ns()
        self._receive(request, now_ns)
        if self._pending and not self._arbitration_due:
            self._schedule_arbitration(now_ns)

    def _receive(self, request: _Request, now_ns: int) -> None:
        """The last bit of a frame that everybody looks at."""
        can_id, _, port, data, requested_ns = request
        frame = Frame(can_id, data, now_ns)
        if not port.online:
            port.queued -= 1
            port.dropped += 1
        elif self.intercept is None:
            port.queued -= 1
            self._deliver(port, frame, requested_ns)
        else:
            self._deliver_unless_faulty(request, frame)

    def _deliver(self, port: LockstepPort, frame: Frame, requested_ns: int) -> None:
        can_id = frame.can_id
        entry = self._ids.get(can_id)
        if entry is None or entry.route is None:
            entry = self._look_up(can_id)
        latency_ns = frame.t_ns - requested_ns
        entry.count += 1
        entry.total_ns += latency_ns
        if latency_ns > entry.max_ns:
            entry.max_ns = latency_ns
        for observer in self._observers:
            observer(frame)
        for receiver, on_frame in entry.route or ():
            if receiver is not port:
                on_frame(frame)

    def _look_up(self, can_id: int) -> _Id:
        entry = self._ids.setdefault(can_id, _Id())
        entry.route = tuple(
            (port, port.on_frame)
            for port in self._ports.values()
            if port.online and (port.can_ids is None or can_id in port.can_ids)
        )
        return entry

    def _deliver_unless_faulty(self, request: _Request, frame: Frame) -> None:
        assert self.intercept is not None
        port, requested_ns = request[2], request[4]
        verdict = None if request[1] < 0 else self.intercept(port.name, frame)  # a repeated frame was judged already
        if verdict is not None and verdict.wire_error:
            self._add_error_frame()
            heappush(self._pending, request)  # keeps its age: first again among its identifier
        else:
            port.queued -= 1
            if verdict is None:
                self._deliver(port, frame, requested_ns)
            elif verdict.drop:
                port.dropped += 1
            else:
                late = frame._replace(
                    data=frame.data if verdict.data is None else verdict.data, t_ns=frame.t_ns + verdict.delay_ns
                )
                arrive = partial(self._deliver, port, late, requested_ns)
                if verdict.delay_ns:
                    self._clock.call_at(late.t_ns, arrive)
                else:
                    arrive()
                if verdict.repeat:
                    port.queued += 1
                    heappush(self._pending, (request[0], ~request[1], *request[2:]))
        if verdict is not None and verdict.bus_off:
            self.disconnect(port.name)

    def _add_error_frame(self) -> None:
        """The error frame takes the place of the inter-frame space that was already counted, and brings its own."""
        start_ns = self._free_ns
        self._free_ns = start_ns + ERROR_FRAME_BITS * self._bit_ns
        self._error_frames += 1
        self._bits += ERROR_FRAME_BITS
        self._load.add(start_ns, self._free_ns)
