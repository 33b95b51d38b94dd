"""The two sensors as nodes: force and torque at every SYNC, a tracked pose at a rate of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from drivers.bus.base import Bus
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode, NodeApplication
from drivers.clock import Clock
from drivers.codec import TRACKED_POSE, WRENCH
from drivers.objects import DeviceDef
from drivers.publisher import Publisher
from stack.messages import TrackedPose, Vector, Wrench

AFTER_PHYSICS = 5
"""Clock priority of whatever looks at the world: after the tick of the same instant."""


class ForceSensorNode(NodeApplication):
    """Samples `read` — a wrench (6,) in the end-point frame — at every SYNC."""

    def __init__(self, device: DeviceDef, clock: Clock, bus: Bus, read: Callable[[], Vector]) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._read = read
        self._counter = 0
        self._publisher = Publisher(self.node, WRENCH)

    def on_sync(self, counter: int | None) -> None:
        self._counter = (self._counter + 1) & 0xFF
        self._publisher.publish(Wrench(self._read(), self._counter))


class TrackerNode(NodeApplication):
    """Takes a picture every `period_ns` while operational and sends what was seen in it `latency_ns` later.

    `expose(t_ns)` takes the picture, `deliver(t_ns)` gives what the one that is due shows; None (feature not seen) sends nothing.
    """

    def __init__(
        self,
        device: DeviceDef,
        clock: Clock,
        bus: Bus,
        expose: Callable[[int], None],
        deliver: Callable[[int], TrackedPose | None],
        *,
        period_ns: int,
        latency_ns: int,
    ) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._clock = clock
        self._expose = expose
        self._deliver = deliver
        self._period_ns = period_ns
        self._latency_ns = latency_ns
        self._counter = 0
        self._running = False
        self._publisher = Publisher(self.node, TRACKED_POSE)

    def on_nmt_state(self, state: NmtState) -> None:
        operational = state is NmtState.OPERATIONAL
        if operational and not self._running:
            self._call_at((self._clock.now_ns() // self._period_ns + 1) * self._period_ns, self._picture)
        self._running = operational

    def _call_at(self, t_ns: int, callback: Callable[[], None]) -> None:
        self._clock.call_at(t_ns, callback, AFTER_PHYSICS)

    def _picture(self) -> None:
        if not self._running:
            return
        now_ns = self._clock.now_ns()
        self._expose(now_ns)
        self._call_at(now_ns + self._latency_ns, self._send)
        self._call_at(now_ns + self._period_ns, self._picture)

    def _send(self) -> None:
        seen = self._deliver(self._clock.now_ns())
        if seen is not None:
            self._counter = (self._counter + 1) & 0xFF
            self._publisher.publish(replace(seen, counter=self._counter))
