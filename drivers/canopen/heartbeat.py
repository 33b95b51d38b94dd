"""Heartbeat producer 1017h and consumer 1016h, and what gives away a second node of the same id (CiA 301, 7.2.8)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.emcy import EmcyCode, Emergency
from drivers.canopen.line import Handler, Line
from drivers.canopen.nmt import ERROR_CONTROL_BASE, NmtSlave, NmtState
from drivers.clock import Clock, Timer
from drivers.frame import Frame
from drivers.objects import Value

EXCUSED_TIMEOUTS = 2


class HeartbeatProducer:
    """Tells the node's state every 1017h milliseconds, from the boot-up message on."""

    def __init__(self, node_id: int, dictionary: ObjectDictionary, clock: Clock, line: Line, nmt: NmtSlave) -> None:
        self._can_id = ERROR_CONTROL_BASE + node_id
        self._dictionary = dictionary
        self._clock = clock
        self._line = line
        self._nmt = nmt
        self._period_ns = 0
        self._due_ns = 0
        self._timer: Timer | None = None
        dictionary.bind(0x1017, sink=self._changed)

    def configure(self) -> None:
        """Takes over 1017h; the first heartbeat comes one period from now."""
        self.stop()
        self._period_ns = self._dictionary.integer(0x1017) * 1_000_000
        if self._period_ns:
            self._due_ns = self._clock.now_ns() + self._period_ns
            self._timer = self._clock.call_at(self._due_ns, self._beat)

    def stop(self) -> None:
        """Silence until `configure`."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _beat(self) -> None:
        self._due_ns = max(self._due_ns + self._period_ns, self._clock.now_ns())
        self._timer = self._clock.call_at(self._due_ns, self._beat)
        if self._nmt.state is not NmtState.INITIALISING:
            self._line.send(self._can_id, bytes((self._nmt.state,)))  # refused: the consumer's time-out is for that

    def _changed(self, _: Value) -> None:
        self.configure()


@dataclass(slots=True)
class _Watched:
    """One remote node. It is watched from its first heartbeat on, as CiA 301 has it."""

    node_id: int
    timeout_ns: int
    handler: Handler | None = None
    timer: Timer | None = None
    alive: bool = False
    excused: int = 0


class HeartbeatConsumer:
    """Watches the nodes of 1016h; a lost one is EMCY 8130h and `on_lost(node_id)`, a returning one resolves it.

    `on_remote_state(node_id, state)` is called for every heartbeat and boot-up message of a watched node. A node that `excuses` speaks
    for has three time-outs: on a bus that loses frames, three heartbeats in a row are lost now and then.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        clock: Clock,
        line: Line,
        emcy: Emergency,
        on_lost: Callable[[int], None],
        on_remote_state: Callable[[int, int], None],
        excuses: Callable[[int], bool] = lambda node_id: False,
    ) -> None:
        self._dictionary = dictionary
        self._clock = clock
        self._line = line
        self._emcy = emcy
        self._on_lost = on_lost
        self._on_remote_state = on_remote_state
        self._excuses = excuses
        self._slots = [
            entry.definition.subindex
            for entry in dictionary
            if entry.definition.index == 0x1016 and entry.definition.subindex > 0
        ]
        self._watched: list[_Watched] = []
        self._lost: set[int] = set()
        for slot in self._slots:
            dictionary.bind(0x1016, slot, check=self._check_slot(slot), sink=self._changed)

    @property
    def lost(self) -> frozenset[int]:
        """Node ids that were heard once and have fallen silent."""
        return frozenset(self._lost)

    def configure(self) -> None:
        """Takes over 1016h and waits for the first heartbeat of each node in it."""
        self.stop()
        for slot in self._slots:
            word = self._dictionary.integer(0x1016, slot)
            node_id, timeout_ms = word >> 16 & 0xFF, word & 0xFFFF
            if 1 <= node_id <= 127 and timeout_ms:
                watched = _Watched(node_id, timeout_ms * 1_000_000)
                watched.handler = self._hearer(watched)
                self._line.listen(ERROR_CONTROL_BASE + node_id, watched.handler)
                self._watched.append(watched)

    def stop(self) -> None:
        """Watches nobody until `configure`."""
        for watched in self._watched:
            if watched.timer is not None:
                watched.timer.cancel()
            if watched.handler is not None:
                self._line.ignore(ERROR_CONTROL_BASE + watched.node_id, watched.handler)
        self._watched.clear()
        self._lost.clear()
        self._emcy.resolve(EmcyCode.HEARTBEAT)

    def _hearer(self, watched: _Watched) -> Handler:
        def hear(frame: Frame) -> None:
            if len(frame.data) != 1:
                return
            if watched.timer is not None:
                watched.timer.cancel()
            watched.timer = self._clock.call_at(
                self._clock.now_ns() + watched.timeout_ns, lambda: self._time_out(watched)
            )
            watched.excused = 0
            self._lost.discard(watched.node_id)
            if not self._lost:
                self._emcy.resolve(EmcyCode.HEARTBEAT)
            self._on_remote_state(watched.node_id, frame.data[0])

        return hear

    def _time_out(self, watched: _Watched) -> None:
        watched.timer = None
        if watched.excused < EXCUSED_TIMEOUTS and self._excuses(watched.node_id):
            watched.excused += 1
            watched.timer = self._clock.call_at(
                self._clock.now_ns() + watched.timeout_ns, lambda: self._time_out(watched)
            )
            return
        self._lost.add(watched.node_id)
        self._emcy.report(EmcyCode.HEARTBEAT, bytes((watched.node_id,)))
        self._on_lost(watched.node_id)

    def _check_slot(self, slot: int) -> Callable[[Value], None]:
        def check(value: Value) -> None:
            node_id, timeout_ms = int(value) >> 16 & 0xFF, int(value) & 0xFFFF
            others = (self._dictionary.integer(0x1016, other) for other in self._slots if other != slot)
            if timeout_ms and any(word & 0xFFFF and word >> 16 & 0xFF == node_id for word in others):
                raise SdoAbort(AbortCode.PARAMETER_INCOMPATIBLE, f"node {node_id} is watched by another entry of 1016h")

        return check

    def _changed(self, _: Value) -> None:
        self.configure()
