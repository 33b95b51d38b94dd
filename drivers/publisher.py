"""Messages out, messages in: the fast frames of one node between the codec and its PDOs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from drivers.canopen.node import CanopenNode
from drivers.canopen.pdo import TransmitPdo
from drivers.clock import Clock
from drivers.codec import Assembler, MessageCodec
from drivers.frame import Frame
from drivers.frame_codec import CodecError
from drivers.gate import CounterGate

M = TypeVar("M")
_SYNCHRONOUS_MAX = 240
LOG_RESOLUTION_NS = 1000
COUNTER_TIMEOUT_NS = 200_000_000
"""A sender that was silent for this long may have begun to count anew."""


class Publisher(Generic[M]):
    """Sends one kind of message through the TPDOs of `node` that carry it.

    Event-driven PDOs go out at once, synchronous ones with the next SYNC. The objects that they map show, over SDO, what was sent last.
    `limited` counts messages with a value that the wire cannot carry and that was clipped.
    """

    def __init__(self, node: CanopenNode, codec: MessageCodec[M]) -> None:
        self.limited = 0
        self._codec = codec
        self._pdos = [_Carrier(self._tpdo(node, can_id)) for can_id in codec.can_ids]
        self._node = node

    def publish(self, message: M) -> None:
        """Takes over the message; before the node is operational nothing goes out."""
        frames, limited = self._codec.encode(message)
        self.limited += limited
        for carrier, (_, data) in zip(self._pdos, frames, strict=True):
            carrier.data = data
            carrier.muted = False
            pdo = carrier.pdo
            if pdo.valid and pdo.transmission_type > _SYNCHRONOUS_MAX and self._node.nmt.operational:
                self._node.line.send(pdo.cob_id, data)

    def mute(self) -> None:
        """There is no message: synchronous PDOs stay silent until the next `publish`, rather than repeat the last one."""
        for carrier in self._pdos:
            carrier.muted = True

    @staticmethod
    def _tpdo(node: CanopenNode, can_id: int) -> TransmitPdo:
        for pdo in node.tpdo.values():
            if pdo.cob_id == can_id:
                return pdo
        raise KeyError(f"{node.device.name} has no TPDO with identifier {can_id:03X}h")


class _Carrier:
    """One TPDO whose bytes are those of the last message."""

    def __init__(self, pdo: TransmitPdo) -> None:
        self.pdo = pdo
        self.data = bytes(pdo.layout.length)
        self.muted = False
        pdo.seal = lambda _: None if self.muted else self.data
        for position, entry in enumerate(pdo.layout.entries):
            entry.source = lambda position=position: self.pdo.layout.unpack(self.data)[position]


@dataclass(slots=True)
class Receiver(Generic[M]):
    """The last message of one kind. `rejected` counts frames that could not be read (length, checksum, value), `gate` messages by counter.

    `received_ns` is rounded down to whole microseconds, as logs are: what follows from it can be replayed from a log bit for bit.
    """

    clock: Clock
    assembler: Assembler[M]
    message: M | None = None
    received_ns: int = 0
    rejected: int = 0
    gate: CounterGate = field(default_factory=lambda: CounterGate(COUNTER_TIMEOUT_NS))

    def on_frame(self, frame: Frame) -> None:
        """Takes a frame of this message."""
        try:
            message = self.assembler.feed(frame.can_id, frame.data)
        except CodecError:
            self.rejected += 1
            return
        if message is None:
            return
        # one that was repeated on its way, or overtaken, must not pass as fresh
        if self.gate.judge(message.counter, frame.t_ns) is None:  # type: ignore[attr-defined]
            self.message = message
            self.received_ns = frame.t_ns - frame.t_ns % LOG_RESOLUTION_NS

    def fresh(self, timeout_ns: int) -> M | None:
        """The last message, or None when it is older than `timeout_ns` or was never received."""
        if self.message is None or self.clock.now_ns() - self.received_ns > timeout_ns:
            return None
        return self.message

    def take(self) -> M | None:
        """The message that came since the last call, if any."""
        message, self.message = self.message, None
        return message


def receive(node: CanopenNode, codec: MessageCodec[Any]) -> Receiver[Any]:
    """A receiver of `codec`'s message, subscribed at `node`."""
    receiver: Receiver[Any] = Receiver(node.clock, codec.assembler())
    for can_id in codec.can_ids:
        node.subscribe(can_id, receiver.on_frame)
    return receiver
