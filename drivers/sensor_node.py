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
    """Sends what `read` sees every `period_ns` while operational; None (feature not seen) sends nothing."""

    def __init__(
        self,
        device: DeviceDef,
        clock: Clock,
        bus: Bus,
        read: Callable[[], TrackedPose | None],
        period_ns: int,
    ) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._clock = clock
        self._read = read
        self._period_ns = period_ns
        self._counter = 0
        self._running = False
        self._publisher = Publisher(self.node, TRACKED_POSE)

    def on_nmt_state(self, state: NmtState) -> None:
        operational = state is NmtState.OPERATIONAL
        if operational and not self._running:
            self._clock.call_at(self._clock.now_ns() + self._period_ns, self._sample)
        self._running = operational

    def _sample(self) -> None:
        if not self._running:
            return
        self._clock.call_at(self._clock.now_ns() + self._period_ns, self._sample)
        seen = self._read()
        if seen is not None:
            self._counter = (self._counter + 1) & 0xFF
            self._publisher.publish(replace(seen, counter=self._counter))
