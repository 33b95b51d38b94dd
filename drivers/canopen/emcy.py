"""Emergency objects: error register 1001h, history 1003h, emergency and error-reset messages (CiA 301, 7.2.7)."""

from __future__ import annotations

import struct
from collections import deque
from enum import IntEnum, IntFlag

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.line import Line
from drivers.canopen.nmt import NmtSlave
from drivers.clock import Clock, Timer
from drivers.objects import Value

_RETRY_NS = 1_000_000
_QUEUE_LENGTH = 16


class EmcyCode(IntEnum):
    """Error codes in use, after CiA 301 table 26 and CiA 402."""

    ERROR_RESET = 0x0000
    OVER_CURRENT = 0x2310
    SENSOR = 0x7300
    COMMUNICATION = 0x8100
    HEARTBEAT = 0x8130
    BUS_OFF_RECOVERED = 0x8140
    CAN_ID_COLLISION = 0x8150
    PROTOCOL = 0x8200
    PDO_LENGTH = 0x8210
    SYNC_LENGTH = 0x8240
    RPDO_TIMEOUT = 0x8250
    VELOCITY = 0x8400
    FOLLOWING_ERROR = 0x8611
    REFERENCE_LIMIT = 0x8612
    SYNC_LOST = 0x8700
    GATE = 0xFF01


class ErrorRegister(IntFlag):
    """Bits of 1001h; GENERIC is set with any other."""

    NONE = 0
    GENERIC = 1
    CURRENT = 1 << 1
    COMMUNICATION = 1 << 4
    PROFILE = 1 << 5
    MANUFACTURER = 1 << 7


def register_bit(code: int) -> ErrorRegister:
    """The bit of 1001h that belongs to a class of error codes."""
    group = code >> 12
    if group == 0xF:
        return ErrorRegister.MANUFACTURER
    if group == 0x2:
        return ErrorRegister.CURRENT
    if group == 0x8 and code < 0x8300:
        return ErrorRegister.COMMUNICATION
    return ErrorRegister.PROFILE


class Emergency:
    """The errors of one node: `report` when one appears, `resolve` when it is gone.

    Each error is reported once as long as it lasts. Messages wait while the node may not send (stopped, inhibit time,
    full queue of the bus); the register and the history are always up to date. Newest error first in the history.
    """

    def __init__(self, dictionary: ObjectDictionary, clock: Clock, line: Line, nmt: NmtSlave) -> None:
        self._dictionary = dictionary
        self._clock = clock
        self._line = line
        self._nmt = nmt
        self.errors: dict[int, ErrorRegister] = {}
        """The present errors, oldest first, with their bits of 1001h."""
        self._waiting: deque[bytes] = deque(maxlen=_QUEUE_LENGTH)
        self._timer: Timer | None = None
        self._slots = sum(1 for entry in dictionary if entry.definition.index == 0x1003) - 1
        self._history: deque[int] = deque(maxlen=max(self._slots, 1))
        dictionary.bind(0x1001, source=lambda: int(self.register))
        dictionary.bind(0x1003, source=lambda: len(self._history), check=_only_zero, sink=self._clear_history)
        for slot in range(1, self._slots + 1):
            dictionary.bind(0x1003, slot, source=lambda slot=slot: self._past(slot))  # type: ignore[misc]

    @property
    def register(self) -> ErrorRegister:
        """Present value of 1001h."""
        bits = ErrorRegister.NONE
        for bit in self.errors.values():
            bits |= bit | ErrorRegister.GENERIC
        return bits

    def report(self, code: EmcyCode, detail: bytes = b"") -> None:
        """An error has appeared; `detail`: up to five bytes of the manufacturer's own."""
        if code in self.errors:
            return
        self.errors[code] = register_bit(code)
        self._history.appendleft(code | int.from_bytes(detail[:2], "little") << 16)
        self._post(code, detail)

    def resolve(self, *codes: EmcyCode) -> None:
        """Errors are gone: each that was there is followed by one error-reset message (0000h) with what remains."""
        for code in codes:
            if self.errors.pop(code, None) is not None:
                self._post(EmcyCode.ERROR_RESET, b"")

    def reset(self) -> None:
        """As after power-on: no errors, nothing waiting. The history stays, it is there to survive a reset."""
        self.errors.clear()
        self._waiting.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def flush(self) -> None:
        """Sends what waits, as far as the state of the node and the inhibit time allow."""
        while self._waiting and self._timer is None and self._nmt.communicating:
            cob_id = self._dictionary.integer(0x1014)
            if cob_id >> 31:
                self._waiting.clear()
            elif self._line.send(cob_id & 0x7FF, self._waiting[0]):
                self._waiting.popleft()
                self._pause(self._dictionary.integer_or(0, 0x1015) * 100_000)
            else:
                self._pause(_RETRY_NS)

    def _post(self, code: int, detail: bytes) -> None:
        self._waiting.append(struct.pack("<HB5s", code, self.register, detail[:5]))
        self.flush()

    def _pause(self, duration_ns: int) -> None:
        if duration_ns > 0:
            self._timer = self._clock.call_at(self._clock.now_ns() + duration_ns, self._resume)

    def _resume(self) -> None:
        self._timer = None
        self.flush()

    def _past(self, slot: int) -> int:
        if slot > len(self._history):
            raise SdoAbort(AbortCode.NO_DATA, f"1003h holds {len(self._history)} errors")
        return self._history[slot - 1]

    def _clear_history(self, _: Value) -> None:
        self._history.clear()


def _only_zero(value: Value) -> None:
    if value != 0:
        raise SdoAbort(AbortCode.INVALID_VALUE, f"1003h:0 = {value}: only 0 may be written, it clears the history")
