"""What is wrong with a drive: the code that it went to FAULT with, and when that may be reset."""

from __future__ import annotations

from drivers.canopen.emcy import EmcyCode
from drivers.canopen.node import CanopenNode, CommunicationLoss
from drivers.cia402.axis_watch import Alarm

CODE_OF_LOSS = {
    CommunicationLoss.HEARTBEAT: EmcyCode.HEARTBEAT,
    CommunicationLoss.RPDO: EmcyCode.RPDO_TIMEOUT,
    CommunicationLoss.SYNC: EmcyCode.SYNC_LOST,
    CommunicationLoss.NMT: EmcyCode.COMMUNICATION,
    CommunicationLoss.DUPLICATE: EmcyCode.CAN_ID_COLLISION,
}
CODE_OF_ALARM = {
    Alarm.SENSOR: EmcyCode.SENSOR,
    Alarm.FOLLOWING_ERROR: EmcyCode.FOLLOWING_ERROR,
    Alarm.OVERSPEED: EmcyCode.VELOCITY,
    Alarm.RATE_ERROR: EmcyCode.VELOCITY,
    Alarm.POSITION_LIMIT: EmcyCode.REFERENCE_LIMIT,
}
_RESET = (
    EmcyCode.OVER_CURRENT,
    *CODE_OF_ALARM.values(),
    EmcyCode.SYNC_LOST,
    EmcyCode.RPDO_TIMEOUT,
    EmcyCode.COMMUNICATION,
)


class Faults:
    """The fault of one drive; every one is an emergency message of its node as well."""

    def __init__(self, node: CanopenNode) -> None:
        self._node = node
        self.forget()

    def forget(self) -> None:
        """As after power-on."""
        self.code: EmcyCode | None = None
        self.following_error = False

    def note(self, code: EmcyCode) -> None:
        """A fault has appeared; the first one gives the drive's error code."""
        self._node.emcy.report(code)
        self.following_error |= code is EmcyCode.FOLLOWING_ERROR
        if self.code is None:
            self.code = code

    def clear(self) -> bool:
        """Fault reset. False: the cause is still there. An encoder that is still broken will report again."""
        if self.code is EmcyCode.HEARTBEAT and self._node.heartbeat_consumer.lost:
            return False
        self._node.emcy.resolve(*_RESET)
        self.forget()
        return True

    def recovered(self, set_point: bool) -> None:
        """A SYNC came, with a set point or without: losses that did not end in FAULT are over."""
        if self.code is None:
            self._node.emcy.resolve(EmcyCode.SYNC_LOST)
            if set_point:
                self._node.emcy.resolve(EmcyCode.RPDO_TIMEOUT)

    def error_code(self) -> int:
        """603Fh: the fault, else the newest of the node's present errors, else 0."""
        if self.code is not None:
            return self.code
        return next(reversed(self._node.emcy.errors), 0)
