"""SDO client: reads and writes objects of one node, expedited or segmented, one transfer at a time.

Protocol after CiA 301, 7.2.4.3 (initiate 40h/2xh, segments 6xh/0xh, abort 80h). Values are raw bytes here;
`drivers/canopen/sequence.py` turns them into numbers.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.canopen.abort import AbortCode
from drivers.canopen.sdo_abort import SdoAborted, SdoTimeout, StepError
from drivers.clock import Clock, Timer
from drivers.frame import Frame

REQUEST_BASE = 0x600
RESPONSE_BASE = 0x580
RESEND_NS = 1_000_000
"""A frame that the port refused is offered again after this time."""

OnDone = Callable[[bytes | StepError], None]


@dataclass(slots=True)
class _Transfer:
    """One request: `payload` None reads; else it is what to write."""

    index: int
    subindex: int
    payload: bytes | None
    on_done: OnDone
    attempt: int = 0
    in_segments: bool = False
    toggle: int = 0
    offset: int = 0
    announced: int | None = None
    received: bytearray = field(default_factory=bytearray)

    @property
    def multiplexer(self) -> bytes:
        return self.index.to_bytes(2, "little") + bytes((self.subindex,))


class SdoClient:
    """Client of the default SDO server of `node_id`. Requests queue up; each ends in exactly one call of its `on_done`.

    `on_done` gets the bytes read (empty after a write), or `SdoAborted`, or `SdoTimeout` after `attempts` attempts of
    `timeout_ns` each. Every frame of a transfer restarts the time-out. Late answers of an attempt that was given up
    are told apart by their multiplexer and ignored.
    """

    def __init__(
        self,
        node_id: int,
        send: Callable[[int, bytes], bool],
        clock: Clock,
        timeout_ns: int = 200_000_000,
        attempts: int = 3,
    ) -> None:
        self.node_id = node_id
        self.ignored = 0
        """Answers that belonged to no transfer."""
        self.refused = 0
        """Frames that the port did not take at once."""
        self._send = send
        self._clock = clock
        self._timeout_ns = timeout_ns
        self._attempts = attempts
        self._queue: deque[_Transfer] = deque()
        self._active: _Transfer | None = None
        self._timer: Timer | None = None
        self._resend: Timer | None = None

    @property
    def idle(self) -> bool:
        return self._active is None

    def upload(self, index: int, subindex: int, on_done: OnDone) -> None:
        """Reads an object."""
        self._enqueue(_Transfer(index, subindex, None, on_done))

    def download(self, index: int, subindex: int, data: bytes, on_done: OnDone) -> None:
        """Writes an object."""
        self._enqueue(_Transfer(index, subindex, bytes(data), on_done))

    def cancel(self) -> None:
        """Gives up all requests without calling their `on_done`; the server is told to drop the one in flight."""
        self._queue.clear()
        if self._active is not None:
            self._transmit_abort(self._active, AbortCode.GENERAL)
            self._release()

    def on_frame(self, frame: Frame) -> None:
        """Takes a frame with id 580h + node. Frames of another length than 8 are no SDO and are ignored."""
        transfer = self._active
        data = frame.data
        if transfer is None or len(data) != 8:
            self.ignored += 1
        elif data[0] == 0x80:
            if data[1:4] == transfer.multiplexer:
                code = int.from_bytes(data[4:8], "little")
                self._finish(SdoAborted(code, transfer.index, transfer.subindex))
            else:
                self.ignored += 1
        elif not transfer.in_segments:
            self._on_initiated(transfer, data)
        elif transfer.attempt > 1 and data[0] & 0xC0 == 0x40 and data[1:4] == transfer.multiplexer:
            self.ignored += 1  # the initiate response of an attempt given up, 4xh or 60h
        elif transfer.payload is None:
            self._on_upload_segment(transfer, data)
        else:
            self._on_download_segment(transfer, data, transfer.payload)

    def _enqueue(self, transfer: _Transfer) -> None:
        self._queue.append(transfer)
        if self._active is None:
            self._next()

    def _next(self) -> None:
        if self._queue:
            self._active = self._queue.popleft()
            self._initiate(self._active)

    def _initiate(self, transfer: _Transfer) -> None:
        transfer.attempt += 1
        transfer.in_segments = False
        transfer.toggle = transfer.offset = 0
        transfer.announced = None
        transfer.received.clear()
        payload = transfer.payload
        if payload is None:
            request = b"\x40" + transfer.multiplexer + bytes(4)
        elif 1 <= len(payload) <= 4:
            command = 0x23 | (4 - len(payload)) << 2  # expedited, size indicated
            request = bytes((command,)) + transfer.multiplexer + payload.ljust(4, b"\0")
        else:
            request = b"\x21" + transfer.multiplexer + len(payload).to_bytes(4, "little")
        self._transmit(request)

    def _on_initiated(self, transfer: _Transfer, data: bytes) -> None:
        command = data[0]
        if data[1:4] != transfer.multiplexer:
            self.ignored += 1
            return
        if command == 0x60 if transfer.payload is None else command >> 5 == 2:
            self.ignored += (
                1  # a late answer to a request of the other kind for this object: written twice, now read back
            )
            return
        if transfer.payload is not None:
            if command != 0x60:
                self._abort(transfer, AbortCode.UNKNOWN_COMMAND)
            elif 1 <= len(transfer.payload) <= 4:
                self._finish(b"")
            else:
                transfer.in_segments = True
                self._send_segment(transfer, transfer.payload)
        elif command >> 5 != 2:
            self._abort(transfer, AbortCode.UNKNOWN_COMMAND)
        elif command & 0x02:  # expedited; without a size indication all four bytes count
            self._finish(bytes(data[4 : 8 - (command >> 2 & 3 if command & 1 else 0)]))
        else:
            transfer.announced = int.from_bytes(data[4:8], "little") if command & 1 else None
            transfer.in_segments = True
            self._transmit(b"\x60" + bytes(7))

    def _on_upload_segment(self, transfer: _Transfer, data: bytes) -> None:
        command = data[0]
        if command >> 5 != 0:
            self._abort(transfer, AbortCode.UNKNOWN_COMMAND)
            return
        if command & 0x10 != transfer.toggle:
            self._abort(transfer, AbortCode.TOGGLE_BIT)
            return
        transfer.received += data[1 : 8 - (command >> 1 & 7)]
        transfer.toggle ^= 0x10
        length, announced = len(transfer.received), transfer.announced
        is_last = bool(command & 1)
        if announced is not None and (length > announced or (is_last and length != announced)):
            self._abort(transfer, AbortCode.LENGTH_MISMATCH)
        elif is_last:
            self._finish(bytes(transfer.received))
        else:
            self._transmit(bytes((0x60 | transfer.toggle,)) + bytes(7))

    def _on_download_segment(self, transfer: _Transfer, data: bytes, payload: bytes) -> None:
        if data[0] >> 5 != 1:
            self._abort(transfer, AbortCode.UNKNOWN_COMMAND)
        elif data[0] & 0x10 != transfer.toggle:
            self._abort(transfer, AbortCode.TOGGLE_BIT)
        elif transfer.offset >= len(payload):
            self._finish(b"")
        else:
            transfer.toggle ^= 0x10
            self._send_segment(transfer, payload)

    def _send_segment(self, transfer: _Transfer, payload: bytes) -> None:
        chunk = payload[transfer.offset : transfer.offset + 7]
        transfer.offset += len(chunk)
        command = transfer.toggle | (7 - len(chunk)) << 1 | (transfer.offset >= len(payload))
        self._transmit(bytes((command,)) + chunk.ljust(7, b"\0"))

    def _abort(self, transfer: _Transfer, code: int) -> None:
        self._transmit_abort(transfer, code)
        self._finish(SdoAborted(code, transfer.index, transfer.subindex))

    def _transmit_abort(self, transfer: _Transfer, code: int) -> None:
        self._send(REQUEST_BASE + self.node_id, b"\x80" + transfer.multiplexer + code.to_bytes(4, "little"))

    def _transmit(self, data: bytes) -> None:
        self._stop_timers()
        self._timer = self._clock.call_at(self._clock.now_ns() + self._timeout_ns, self._on_timeout)
        self._offer(data)

    def _offer(self, data: bytes) -> None:
        if not self._send(REQUEST_BASE + self.node_id, data):
            self.refused += 1
            self._resend = self._clock.call_at(self._clock.now_ns() + RESEND_NS, lambda: self._offer(data))

    def _on_timeout(self) -> None:
        transfer = self._active
        assert transfer is not None
        self._transmit_abort(transfer, AbortCode.TIMED_OUT)
        if transfer.attempt < self._attempts:
            self._initiate(transfer)
        else:
            self._finish(SdoTimeout(transfer.index, transfer.subindex, transfer.attempt, self._timeout_ns))

    def _finish(self, result: bytes | StepError) -> None:
        transfer = self._active
        assert transfer is not None
        self._release()
        transfer.on_done(result)
        if self._active is None:
            self._next()

    def _release(self) -> None:
        self._active = None
        self._stop_timers()

    def _stop_timers(self) -> None:
        for timer in (self._timer, self._resend):
            if timer is not None:
                timer.cancel()
        self._timer = self._resend = None
