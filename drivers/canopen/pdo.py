"""Process data: reception and transmission (CiA 301, 7.2.2).

Choices where devices differ: an RPDO whose length is not exactly that of its mapping is ignored (EMCY 8210h), also when
it is too long; an RPDO with a value that its object must not take is ignored as a whole (EMCY 8200h).
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.abort import SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.emcy import EmcyCode, Emergency
from drivers.canopen.line import Line
from drivers.canopen.nmt import NmtSlave
from drivers.canopen.pdo_parameters import EVENT_DRIVEN, SYNCHRONOUS_MAX, PdoParameters
from drivers.clock import Clock, Timer
from drivers.frame import Frame
from drivers.objects import Value


class ReceivePdo(PdoParameters):
    """One RPDO. Values reach the dictionary at once (types 254, 255) or at the next SYNC (0 … 240).

    `on_applied(number)` is called when all values of a frame have been stored and their sinks called;
    `on_timeout(number)` when the event timer (sub 5) ran out after a first reception.
    """

    receive = True

    def __init__(
        self,
        number: int,
        dictionary: ObjectDictionary,
        clock: Clock,
        line: Line,
        nmt: NmtSlave,
        emcy: Emergency,
        on_applied: Callable[[int], None],
        on_timeout: Callable[[int], None],
    ) -> None:
        super().__init__(number, dictionary)
        self._clock = clock
        self._line = line
        self._nmt = nmt
        self._emcy = emcy
        self._on_applied = on_applied
        self._on_timeout = on_timeout
        self._listening: int | None = None
        self.pending: bytes | None = None
        """A frame that waits for its SYNC."""
        self.guard: Callable[[bytes], bytes | None] | None = None
        """Gets every frame of the right length and says what of it may pass; None: nothing."""
        self._timeout_ns = 0
        self._deadline: Timer | None = None

    def configure(self) -> None:
        super().configure()
        self._timeout_ns = self._dictionary.integer_or(0, self._base, 5) * 1_000_000
        self.idle()
        wanted = self.cob_id if self.valid else None
        if wanted != self._listening:
            if self._listening is not None:
                self._line.ignore(self._listening, self._on_frame)
            if wanted is not None:
                self._line.listen(wanted, self._on_frame)
            self._listening = wanted

    def idle(self) -> None:
        """Forgets what waits for a SYNC and stops the watch: the node left operational."""
        self.pending = None
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def store(self) -> bool:
        """First half of a SYNC: what came since the last one goes into the dictionary. False: nothing had come."""
        data, self.pending = self.pending, None
        return data is not None and self._store(data)

    def announce(self) -> None:
        """Second half: hooks, after the values of all RPDOs of this SYNC have been stored."""
        for entry in self.layout.entries:
            if entry.sink is not None:
                entry.sink(entry.value)
        self._on_applied(self.number)

    def _on_frame(self, frame: Frame) -> None:
        if not self._nmt.operational:
            return
        layout = self.layout
        if len(frame.data) != layout.length:
            self._emcy.report(EmcyCode.PDO_LENGTH, bytes((self.number, len(frame.data), layout.length)))
            return
        if self._emcy.errors:
            self._emcy.resolve(EmcyCode.PDO_LENGTH)
        data = frame.data if self.guard is None else self.guard(frame.data)
        if data is None:
            return
        if self._timeout_ns:
            self._watch()
        if self.transmission_type <= SYNCHRONOUS_MAX:
            self.pending = data
        elif self._store(data):
            self.announce()

    def _store(self, data: bytes) -> bool:
        values = self.layout.unpack(data)
        if self.layout.guarded and not self._acceptable(values):
            return False
        for entry, value in zip(self.layout.entries, values):  # noqa: B905 (as many as there are, by construction)
            entry.value = value
        return True

    def _acceptable(self, values: tuple[Value, ...]) -> bool:
        for entry, value in zip(self.layout.entries, values, strict=True):
            try:
                entry.validate(value)
            except SdoAbort as refusal:
                self._emcy.report(EmcyCode.PROTOCOL, refusal.code.to_bytes(4, "little") + bytes((self.number,)))
                return False
        if self._emcy.errors:
            self._emcy.resolve(EmcyCode.PROTOCOL)
        return True

    def _watch(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = self._clock.call_at(self._clock.now_ns() + self._timeout_ns, self._expired)
        if self._emcy.errors:
            self._emcy.resolve(EmcyCode.RPDO_TIMEOUT)

    def _expired(self) -> None:
        self._deadline = None
        self._emcy.report(EmcyCode.RPDO_TIMEOUT, bytes((self.number,)))
        self._on_timeout(self.number)


class TransmitPdo(PdoParameters):
    """One TPDO: on SYNC (types 0 … 240) or on events (254, 255: `trigger`, event timer, inhibit time).

    `seal`, if set, gets the packed bytes and returns what goes on the wire (a counter and a checksum, say), None: nothing.
    """

    receive = False

    def __init__(self, number: int, dictionary: ObjectDictionary, clock: Clock, line: Line, nmt: NmtSlave) -> None:
        super().__init__(number, dictionary)
        self.seal: Callable[[bytes], bytes | None] | None = None
        self.sent = 0
        self._clock = clock
        self._line = line
        self._nmt = nmt
        self._syncs = 0
        self._start_value = 0
        self._triggered = False
        self._event_ns = 0
        self._inhibit_ns = 0
        self._free_at_ns = 0
        self._event_timer: Timer | None = None
        self._inhibit_timer: Timer | None = None

    def configure(self) -> None:
        super().configure()
        self._inhibit_ns = self._dictionary.integer_or(0, self._base, 3) * 100_000
        self._event_ns = self._dictionary.integer_or(0, self._base, 5) * 1_000_000
        self.idle()
        if self._nmt.operational:
            self.begin()

    def begin(self) -> None:
        """The node became operational."""
        self.idle()
        self._start_value = self._dictionary.integer_or(0, self._base, 6)
        self._restart_event_timer()

    def idle(self) -> None:
        """Stops all timers: the node left operational."""
        self._triggered = False
        self._syncs = 0
        for timer in (self._event_timer, self._inhibit_timer):
            if timer is not None:
                timer.cancel()
        self._event_timer = self._inhibit_timer = None

    def trigger(self) -> None:
        """Values have changed, says the application: sent now, after the inhibit time, or (type 0) at the SYNC."""
        if not self._nmt.operational or not self.valid:
            return
        if self.transmission_type not in EVENT_DRIVEN:
            self._triggered = True
        elif self._clock.now_ns() >= self._free_at_ns:
            self._transmit()
        elif self._inhibit_timer is None:
            self._inhibit_timer = self._clock.call_at(self._free_at_ns, self._transmit)

    def on_sync(self, counter: int | None) -> None:
        """A SYNC came while the node is operational; `counter` is its value, if it has one."""
        if not self.valid or self.transmission_type > SYNCHRONOUS_MAX:
            return
        if self.transmission_type == 0:
            if self._triggered:
                self._transmit()
            return
        if self._start_value and counter is not None:
            if counter != self._start_value:
                return
            self._start_value = 0
            self._syncs = self.transmission_type - 1
        self._syncs += 1
        if self._syncs >= self.transmission_type:
            self._syncs = 0
            self._transmit()

    def _transmit(self) -> None:
        self._triggered = False
        self._inhibit_timer = None
        data: bytes | None = self.layout.pack()
        if self.seal is not None and data is not None:
            data = self.seal(data)
        if data is None:
            return
        if self._line.send(self.cob_id, data):
            self.sent += 1
        if self.transmission_type in EVENT_DRIVEN:
            self._free_at_ns = self._clock.now_ns() + self._inhibit_ns
            self._restart_event_timer()

    def _restart_event_timer(self) -> None:
        if self._event_timer is not None:
            self._event_timer.cancel()
            self._event_timer = None
        if self.valid and self._event_ns and self.transmission_type in EVENT_DRIVEN:
            self._event_timer = self._clock.call_at(self._clock.now_ns() + self._event_ns, self._on_event_timer)

    def _on_event_timer(self) -> None:
        self._event_timer = None
        if self._clock.now_ns() >= self._free_at_ns:
            self._transmit()
        elif self._inhibit_timer is None:
            self._inhibit_timer = self._clock.call_at(self._free_at_ns, self._transmit)
