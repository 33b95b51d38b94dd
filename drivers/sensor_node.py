"""The two sensors as nodes: force and torque at every SYNC, a tracked pose after the SYNC by which there is a new one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drivers.bus.base import Bus
from drivers.canopen.emcy import EmcyCode
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode, NodeApplication
from drivers.clock import Clock
from drivers.codec import TRACKED_POSE, WRENCH
from drivers.objects import DeviceDef
from drivers.publisher import Publisher
from drivers.tables.sensors import FORCE_SCALE_N, TORQUE_SCALE_NM
from stack.messages import TrackedPose, Vector, Wrench

_ENDS = np.repeat([32767 * FORCE_SCALE_N, 32767 * TORQUE_SCALE_NM], 3)
"""What six INTEGER16 can just hold: (6,) N and N·m."""
STUCK_SYNCS = 5
"""Readings on end that are the same to the last bit; no reading of a sensor with noise is."""
AFTER_PHYSICS = 5
"""Clock priority of whatever looks at the world: after the tick of the same instant."""


class ForceSensorNode(NodeApplication):
    """Samples `read` — a wrench (6,) in the end-point frame — at every SYNC. What is no number, or at the end of the wire's range or
    beyond it in any direction, or, from a sensor that `flickers` (has noise), the same `STUCK_SYNCS` times on end, is no measurement:
    an emergency message instead of a frame."""

    def __init__(
        self, device: DeviceDef, clock: Clock, bus: Bus, read: Callable[[], Vector], *, flickers: bool = False
    ) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._read = read
        self._flickers = flickers
        self._last: Vector = np.full(6, np.nan)
        self._same = 1
        self._counter = 0
        self._publisher = Publisher(self.node, WRENCH)

    def on_sync(self, counter: int | None) -> None:
        wrench = self._read()
        self._same = self._same + 1 if np.array_equal(wrench, self._last) else 1
        self._last = wrench
        stuck = self._flickers and self._same >= STUCK_SYNCS
        if stuck or not np.all(np.abs(wrench) < _ENDS):  # NaN compares as False
            self._publisher.mute()  # what is no measurement is not sent: the listeners' time-outs are for that
            self.node.emcy.report(EmcyCode.SENSOR)
            return
        self._counter = (self._counter + 1) & 0xFF
        self.node.emcy.resolve(EmcyCode.SENSOR)
        self._publisher.publish(Wrench(wrench, self._counter))


class TrackerNode(NodeApplication):
    """Takes a picture every `period_ns` while operational; what has been worked out of one by a SYNC is sent right after it.

    `expose(t_ns)` takes the picture, `deliver(t_ns)` gives what the newest one that is done shows, with its age at `t_ns`, the SYNC;
    None (nothing new, feature not seen) sends nothing. An age counted to an instant that all nodes share stays right however long
    the frames wait for the bus: a millisecond there is 0.2 mm at 0.2 m/s.
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
    ) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._clock = clock
        self._expose = expose
        self._deliver = deliver
        self._period_ns = period_ns
        self._counter = 0
        self._running = False
        self._publisher = Publisher(self.node, TRACKED_POSE)

    def on_nmt_state(self, state: NmtState) -> None:
        operational = state is NmtState.OPERATIONAL
        if operational and not self._running:
            self._call_at((self._clock.now_ns() // self._period_ns + 1) * self._period_ns, self._picture)
        self._running = operational

    def on_sync(self, counter: int | None) -> None:
        seen = self._deliver(self._clock.now_ns())
        if seen is not None:
            self._counter = (self._counter + 1) & 0xFF
            self._publisher.publish(replace(seen, counter=self._counter))

    def _call_at(self, t_ns: int, callback: Callable[[], None]) -> None:
        self._clock.call_at(t_ns, callback, AFTER_PHYSICS)

    def _picture(self) -> None:
        if not self._running:
            return
        now_ns = self._clock.now_ns()
        self._expose(now_ns)
        self._call_at(now_ns + self._period_ns, self._picture)
