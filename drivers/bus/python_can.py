"""A real wire: any interface that python-can knows, one socket for all nodes of a process.

Where an interface gives back what it has sent, that is what the nodes of the process hear of each other: delivered is what
was on the wire, in the order of the wire. Where it does not, own frames are handed out when they were given away.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable

import can

from drivers.bus.base import BusStatistics, OnFrame
from drivers.bus.carrier import NS_PER_S, Arrival, BusError, open_carrier, reason
from drivers.bus.load import LoadMeter
from drivers.frame import MAX_CAN_ID, MAX_DATA_BYTES, Frame, bit_length, check_frame

STRANGE_NS = NS_PER_S
"""A stamp that is further away from now than this is not believed: somebody has set the clock."""

COMPARED_NS = 50_000_000


class PythonCanPort:
    """One node's access: acceptance filter and counters."""

    __slots__ = ("_bus", "can_ids", "dropped", "name", "on_frame", "refused")

    def __init__(self, bus: PythonCanBus, name: str, can_ids: frozenset[int] | None, on_frame: OnFrame) -> None:
        self._bus = bus
        self.name = name
        self.can_ids = can_ids
        self.on_frame = on_frame
        self.refused = 0
        self.dropped = 0

    def send(self, can_id: int, data: bytes) -> bool:
        """False and counted as refused when the interface does not take it. Raises ValueError for no standard data frame."""
        return self._bus.transmit(self, can_id, data)


class PythonCanBus:
    """`Bus` and `FrameSource` over python-can. Nothing is handed out but by `hand_out`: the caller's loop moves everything.

    Error, remote, extended and FD frames are not for CANopen nodes: they are ignored, error frames are counted.
    """

    def __init__(
        self,
        url: str,
        now_ns: Callable[[], int],
        *,
        bitrate: int = 1_000_000,
        stamp_clock_ns: Callable[[], int] | None = None,
        pace: float = 1.0,
        load_window_ns: int = 100_000_000,
    ) -> None:
        """`url`: see `open_carrier`. `now_ns` is the time of the run, which goes on by `pace` in a second of real time.

        `stamp_clock_ns` is the clock in which the interface stamps its frames (the real-time clock for SocketCAN); without it
        a frame has arrived when it was read. `bitrate` (bit/s) goes to the interface, and says what the load is.
        Raises BusError for what cannot be opened.
        """
        self.url = url
        self.bitrate = bitrate
        self.now_ns = now_ns
        self._stamp_clock_ns = stamp_clock_ns
        self._pace = pace
        self._carrier = open_carrier(url, bitrate)
        self._ports: dict[str, PythonCanPort] = {}
        self._observers: tuple[OnFrame, ...] = ()
        self._routes: dict[int, tuple[tuple[PythonCanPort, OnFrame], ...]] = {}
        self._sent: dict[int, deque[tuple[bytes, PythonCanPort]]] = {}
        self._arrived: deque[tuple[int, int, bytes, PythonCanPort | None]] = deque()
        self._last_ns = now_ns()
        self._load = LoadMeter(self._last_ns, load_window_ns)
        self._compared = (0, -(1 << 62))
        self._bit_ns = NS_PER_S // bitrate
        self._wire_ns = self._last_ns
        self._frames = self._bits = self._error_frames = 0

    def attach(self, name: str, can_ids: Iterable[int] | None, on_frame: OnFrame) -> PythonCanPort:
        """See `Bus.attach`. Raises ValueError when `name` is taken in this process."""
        if name in self._ports:
            raise ValueError(f"port name {name!r} is taken: names of ports must differ")
        port = PythonCanPort(self, name, None if can_ids is None else frozenset(can_ids), on_frame)
        self._ports[name] = port
        self._routes.clear()
        return port

    def observe(self, on_frame: OnFrame) -> None:
        """See `Bus.observe`."""
        self._observers = (*self._observers, on_frame)

    def transmit(self, port: PythonCanPort, can_id: int, data: bytes) -> bool:
        """What `Port.send` does."""
        if not 0 <= can_id <= MAX_CAN_ID or len(data) > MAX_DATA_BYTES:
            check_frame(can_id, data)
        data = bytes(data)
        if not self._carrier.send(can_id, data):
            port.refused += 1
            return False
        if self._carrier.gives_back:
            self._sent.setdefault(can_id, deque()).append((data, port))
        else:
            self._arrived.append((self.now_ns(), can_id, data, port))
        return True

    def first_ns(self) -> int | None:
        """See `FrameSource.first_ns`. Raises BusError when the bus has gone away."""
        try:
            arrivals = self._carrier.receive()
        except (can.CanError, OSError) as error:
            raise self._gone(error) from error
        if arrivals:
            self._take(arrivals)
        return self.waiting_ns()

    def waiting_ns(self) -> int | None:
        """See `FrameSource.waiting_ns`."""
        return self._arrived[0][0] if self._arrived else None

    def wait(self, timeout_ns: int) -> None:
        """See `FrameSource.wait`. Raises BusError when the bus has gone away."""
        if self._arrived:
            return
        try:
            arrivals = self._carrier.wait(max(timeout_ns, 0) * 1e-9 / self._pace)
        except (can.CanError, OSError) as error:
            raise self._gone(error) from error
        if arrivals:
            self._take(arrivals)

    def hand_out(self, t_ns: int) -> None:
        """See `FrameSource.hand_out`."""
        _, can_id, data, sender = self._arrived.popleft()
        frame = Frame(can_id, data, t_ns)
        self._count(frame)
        for observer in self._observers:
            observer(frame)
        route = self._routes.get(can_id)
        if route is None:
            route = self._look_up(can_id)
        for port, on_frame in route:
            if port is not sender:
                on_frame(frame)

    def forget_arrived(self) -> None:
        """Throws away what has arrived and was not handed out: for a node that has only now become ready to listen."""
        self.first_ns()
        self._arrived.clear()

    def statistics(self) -> BusStatistics:
        """The traffic that was heard; its load is an estimate by exact frame length at `bitrate`."""
        now_ns = self.now_ns()
        return BusStatistics(
            frames=self._frames,
            bits=self._bits,
            busy_ns=self._load.busy_ns,
            load_mean=self._load.mean(now_ns),
            load_peak=self._load.peak(now_ns),
            window_ns=self._load.window_ns,
            error_frames=self._error_frames,
            refused={port.name: port.refused for port in self._ports.values()},
            dropped={port.name: port.dropped for port in self._ports.values()},
        )

    def close(self) -> None:
        """Gives the interface back. May be called again."""
        with contextlib.suppress(can.CanError, OSError):
            self._carrier.close()

    def _take(self, arrivals: list[Arrival]) -> None:
        """Into the queue, with the interface's stamps in the time of the run; none before the frame before."""
        now_ns = self.now_ns() if self._stamp_clock_ns is None else 0
        for stamp_ns, can_id, data in arrivals:
            if can_id < 0:
                self._error_frames += 1
                continue
            arrival_ns = now_ns if self._stamp_clock_ns is None else self._in_run_time(stamp_ns, self._stamp_clock_ns)
            self._last_ns = max(self._last_ns, arrival_ns)
            self._arrived.append((self._last_ns, can_id, data, self._sender(can_id, data)))

    def _in_run_time(self, stamp_ns: int, stamp_clock_ns: Callable[[], int]) -> int:
        """The two clocks are compared anew with the first stamp after `COMPARED_NS`: reading them takes two system calls."""
        run_ns, clock_ns = self._compared
        if abs(stamp_ns - clock_ns) >= COMPARED_NS:
            run_ns, clock_ns = self._compared = (self.now_ns(), stamp_clock_ns())
        age_ns = clock_ns - stamp_ns
        return run_ns - (round(age_ns * self._pace) if abs(age_ns) < STRANGE_NS else 0)

    def _gone(self, error: Exception) -> BusError:
        return BusError(f"{self.url}: the bus has gone away: {reason(error)}")

    def _sender(self, can_id: int, data: bytes) -> PythonCanPort | None:
        """The port that sent this, if it was one of ours. What it sent before and did not come back was lost."""
        sent = self._sent.get(can_id)
        if not sent:
            return None
        for lost, (sent_data, port) in enumerate(sent):
            if sent_data == data:
                for _ in range(lost):
                    sent.popleft()[1].dropped += 1
                sent.popleft()
                return port
        return None

    def _count(self, frame: Frame) -> None:
        bits = bit_length(frame.can_id, frame.data)
        self._frames += 1
        self._bits += bits
        start_ns = max(self._wire_ns, frame.t_ns)
        self._wire_ns = start_ns + bits * self._bit_ns
        self._load.add(start_ns, self._wire_ns)

    def _look_up(self, can_id: int) -> tuple[tuple[PythonCanPort, OnFrame], ...]:
        route = self._routes[can_id] = tuple(
            (port, port.on_frame) for port in self._ports.values() if port.can_ids is None or can_id in port.can_ids
        )
        return route
