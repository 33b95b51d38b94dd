"""SDO server: expedited and segmented transfer, one at a time (CiA 301, 7.2.4). Block transfer: refused, 0504 0001h.

A new request replaces a transfer that is under way: its client has given up. A request that is not eight bytes long is
ignored, as is everything while the node is neither pre-operational nor operational.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.line import Line
from drivers.canopen.nmt import NmtSlave
from drivers.clock import Clock, Timer
from drivers.frame import Frame

REQUEST_BASE = 0x600
RESPONSE_BASE = 0x580
MAX_TRANSFER_BYTES = 1024

# Client command specifiers: the upper three bits of a request.
_DOWNLOAD_SEGMENT, _INITIATE_DOWNLOAD, _INITIATE_UPLOAD, _UPLOAD_SEGMENT, _ABORT = range(5)
_TOGGLE = 0x10
_EXPEDITED = 0x02
_SIZE_GIVEN = 0x01
_LAST = 0x01


@dataclass
class _Transfer:
    """A segmented transfer under way. `announced`: bytes to come, None if the client did not say."""

    upload: bool
    index: int
    subindex: int
    data: bytearray = field(default_factory=bytearray)
    announced: int | None = None
    toggle: int = 0


class SdoServer:
    """Serves one object dictionary on the default pair of identifiers, 600h and 580h + node id."""

    def __init__(
        self,
        node_id: int,
        dictionary: ObjectDictionary,
        clock: Clock,
        line: Line,
        nmt: NmtSlave,
        timeout_ns: int = 1_000_000_000,
    ) -> None:
        self._dictionary = dictionary
        self._clock = clock
        self._line = line
        self._nmt = nmt
        self._timeout_ns = timeout_ns
        self._response_id = RESPONSE_BASE + node_id
        self._transfer: _Transfer | None = None
        self._timer: Timer | None = None
        line.listen(REQUEST_BASE + node_id, self._on_request)

    def reset(self) -> None:
        """Forgets a transfer under way."""
        self._transfer = None
        if self._timer is not None:
            self._timer.cancel()

    def _on_request(self, frame: Frame) -> None:
        if not self._nmt.communicating or len(frame.data) != 8:
            return
        command = frame.data[0]
        specifier = command >> 5
        transfer = self._transfer
        index, subindex = struct.unpack_from("<HB", frame.data, 1)
        if transfer is not None and specifier in (_DOWNLOAD_SEGMENT, _UPLOAD_SEGMENT):
            index, subindex = transfer.index, transfer.subindex
        try:
            if specifier == _INITIATE_DOWNLOAD:
                self._begin_download(command, index, subindex, frame.data[4:])
            elif specifier == _INITIATE_UPLOAD:
                self._begin_upload(index, subindex)
            elif specifier == _DOWNLOAD_SEGMENT and transfer is not None and not transfer.upload:
                self._take_segment(transfer, command, frame.data[1:])
            elif specifier == _UPLOAD_SEGMENT and transfer is not None and transfer.upload:
                self._give_segment(transfer, command)
            elif specifier == _ABORT:
                self.reset()
            else:
                raise SdoAbort(AbortCode.UNKNOWN_COMMAND, f"command {command:02X}h does not fit here")
        except SdoAbort as refusal:
            self._abort(index, subindex, refusal.code)

    def _begin_upload(self, index: int, subindex: int) -> None:
        self.reset()
        data = self._dictionary.upload(index, subindex)
        if 0 < len(data) <= 4:
            command = 0x40 | (4 - len(data)) << 2 | _EXPEDITED | _SIZE_GIVEN
            self._respond(struct.pack("<BHB4s", command, index, subindex, data))
            return
        self._watch(_Transfer(True, index, subindex, bytearray(data)))
        self._respond(struct.pack("<BHBI", 0x40 | _SIZE_GIVEN, index, subindex, len(data)))

    def _give_segment(self, transfer: _Transfer, command: int) -> None:
        self._check_toggle(transfer, command)
        part = bytes(transfer.data[:7])
        del transfer.data[:7]
        last = not transfer.data
        response = transfer.toggle | (7 - len(part)) << 1 | (_LAST if last else 0)
        self._advance(transfer, last)
        self._respond(struct.pack("<B7s", response, part))

    def _begin_download(self, command: int, index: int, subindex: int, rest: bytes) -> None:
        self.reset()
        if command & _EXPEDITED:
            length = 4 - (command >> 2 & 3) if command & _SIZE_GIVEN else self._natural_length(index, subindex)
            self._dictionary.download(index, subindex, rest[:length])
        else:
            announced = struct.unpack("<I", rest)[0] if command & _SIZE_GIVEN else None
            self._dictionary.entry(index, subindex)
            if announced is not None and announced > MAX_TRANSFER_BYTES:
                raise SdoAbort(AbortCode.OUT_OF_MEMORY, f"{announced} bytes: at most {MAX_TRANSFER_BYTES}")
            self._watch(_Transfer(False, index, subindex, announced=announced))
        self._respond(struct.pack("<BHB4x", 0x60, index, subindex))

    def _take_segment(self, transfer: _Transfer, command: int, rest: bytes) -> None:
        self._check_toggle(transfer, command)
        transfer.data += rest[: 7 - (command >> 1 & 7)]
        if len(transfer.data) > MAX_TRANSFER_BYTES:
            raise SdoAbort(AbortCode.OUT_OF_MEMORY, f"more than {MAX_TRANSFER_BYTES} bytes")
        last = bool(command & _LAST)
        response = struct.pack("<B7x", 0x20 | transfer.toggle)
        self._advance(transfer, last)
        if last:
            if transfer.announced not in (None, len(transfer.data)):
                raise SdoAbort(
                    AbortCode.LENGTH_MISMATCH, f"{transfer.announced} bytes announced, {len(transfer.data)} came"
                )
            self._dictionary.download(transfer.index, transfer.subindex, bytes(transfer.data))
        self._respond(response)

    def _natural_length(self, index: int, subindex: int) -> int:
        bits = self._dictionary.entry(index, subindex).definition.data_type.bits
        return (bits + 7) // 8 or 4

    def _check_toggle(self, transfer: _Transfer, command: int) -> None:
        if command & _TOGGLE != transfer.toggle:
            raise SdoAbort(AbortCode.TOGGLE_BIT, "toggle bit did not alternate")

    def _advance(self, transfer: _Transfer, last: bool) -> None:
        transfer.toggle ^= _TOGGLE
        if last:
            self.reset()
        else:
            self._watch(transfer)

    def _watch(self, transfer: _Transfer) -> None:
        """`transfer` is under way; the client has `timeout_ns` for its next segment."""
        self.reset()
        self._transfer = transfer
        self._timer = self._clock.call_at(self._clock.now_ns() + self._timeout_ns, self._time_out)

    def _time_out(self) -> None:
        if self._transfer is not None:
            self._abort(self._transfer.index, self._transfer.subindex, AbortCode.TIMED_OUT)

    def _abort(self, index: int, subindex: int, code: AbortCode) -> None:
        self.reset()
        self._respond(struct.pack("<BHBI", 0x80, index, subindex, code))

    def _respond(self, data: bytes) -> None:
        self._line.send(self._response_id, data)  # a response that the bus refuses is the client's time-out
