"""Synchronisation object: consumer and producer (CiA 301, 7.2.5; 1005h, 1006h, 1019h)."""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.emcy import EmcyCode, Emergency
from drivers.canopen.line import Line
from drivers.canopen.nmt import NmtSlave
from drivers.clock import Clock, Timer
from drivers.frame import Frame
from drivers.objects import Value

GENERATES = 1 << 30
OnSync = Callable[[int | None], None]


class SyncConsumer:
    """Hears the SYNC. `on_sync(counter)` is called in every state in which SYNC is alive.

    With 1019h set, a SYNC carries a counter: one of another length is not taken (EMCY 8240h), and `missed` counts the
    gaps in the counter.
    """

    def __init__(
        self, dictionary: ObjectDictionary, line: Line, nmt: NmtSlave, emcy: Emergency, on_sync: OnSync
    ) -> None:
        self.received = 0
        self.missed = 0
        self._dictionary = dictionary
        self._line = line
        self._nmt = nmt
        self._emcy = emcy
        self._on_sync = on_sync
        self._can_id: int | None = None
        self._overflow = 0
        self._last: int | None = None

    def configure(self) -> None:
        """Takes over 1005h and 1019h."""
        can_id = self._dictionary.integer(0x1005) & 0x7FF
        if can_id != self._can_id:
            if self._can_id is not None:
                self._line.ignore(self._can_id, self._on_frame)
            self._line.listen(can_id, self._on_frame)
            self._can_id = can_id
        self._overflow = self._dictionary.integer_or(0, 0x1019)
        self._last = None

    def _on_frame(self, frame: Frame) -> None:
        if not self._nmt.communicating:
            return
        if len(frame.data) != (1 if self._overflow else 0):
            self._emcy.report(EmcyCode.SYNC_LENGTH, bytes((len(frame.data),)))
            return
        if self._emcy.errors:
            self._emcy.resolve(EmcyCode.SYNC_LENGTH)
        self.received += 1
        counter = None
        if self._overflow:
            counter = frame.data[0]
            if self._last is not None:
                self.missed += (counter - self._last - 1) % self._overflow
            self._last = counter
        self._on_sync(counter)


class SyncProducer:
    """Sends the SYNC while bit 30 of 1005h is set, every 1006h microseconds, on multiples of that period.

    `on_sync` is called for the producer's own node, right after the frame was given to the bus.
    A period that a late clock has passed over is left out, never made up for.
    """

    def __init__(
        self, dictionary: ObjectDictionary, clock: Clock, line: Line, nmt: NmtSlave, on_sync: OnSync, priority: int = 10
    ) -> None:
        self.sent = 0
        self._dictionary = dictionary
        self._clock = clock
        self._line = line
        self._nmt = nmt
        self._on_sync = on_sync
        self._priority = priority
        self._counter = 0
        self._overflow = 0
        self._period_ns = 0
        self._timer: Timer | None = None
        dictionary.bind(0x1005, check=self._check_cob_id)
        if (0x1019, 0) in dictionary:
            dictionary.bind(0x1019, check=self._check_overflow)

    @property
    def period_ns(self) -> int:
        """Present period; 0 while nothing is produced."""
        return self._period_ns

    def configure(self) -> None:
        """Takes over 1005h, 1006h and 1019h, and begins anew or falls silent."""
        self.stop()
        self._overflow = self._dictionary.integer_or(0, 0x1019)
        self._counter = 0
        if self._dictionary.integer(0x1005) & GENERATES:
            self._period_ns = self._dictionary.integer_or(0, 0x1006) * 1000
            if self._period_ns:
                self._schedule()

    def stop(self) -> None:
        """No further SYNC until `configure`."""
        self._period_ns = 0
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _schedule(self) -> None:
        due_ns = (self._clock.now_ns() // self._period_ns + 1) * self._period_ns
        self._timer = self._clock.call_at(due_ns, self._produce, self._priority)

    def _produce(self) -> None:
        self._schedule()
        if not self._nmt.communicating:
            return
        counter = None
        if self._overflow:
            counter = self._counter = self._counter % self._overflow + 1
        if self._line.send(self._dictionary.integer(0x1005) & 0x7FF, b"" if counter is None else bytes((counter,))):
            self.sent += 1
            self._on_sync(counter)

    def _check_cob_id(self, value: Value) -> None:
        word, present = int(value), self._dictionary.integer(0x1005)
        if word & 0x1FFF_FFFF > 0x7FF or word & 1 << 29:
            raise SdoAbort(AbortCode.INVALID_VALUE, f"1005h = {word:08X}h: an identifier of 11 bits")
        if present & GENERATES and word & GENERATES and word & 0x7FF != present & 0x7FF:
            raise SdoAbort(AbortCode.INVALID_VALUE, "clear bit 30 before giving the SYNC another identifier")

    def _check_overflow(self, value: Value) -> None:
        if value == 1:
            raise SdoAbort(AbortCode.INVALID_VALUE, "1019h: 0 or 2 … 240")
        if self._period_ns:
            raise SdoAbort(AbortCode.DEVICE_STATE, "1019h: stop the SYNC before changing its counter")
