"""Network management, slave side: boot-up, states, and what a node may do in which of them (CiA 301, 7.3.2)."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from drivers.canopen.line import Line
from drivers.clock import Clock, Timer
from drivers.frame import Frame

NMT_CAN_ID = 0x000
ERROR_CONTROL_BASE = 0x700
BOOT_UP = b"\x00"
_RETRY_NS = 10_000_000


class NmtState(IntEnum):
    """As the heartbeat tells it."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(IntEnum):
    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


_TARGET = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}


class NmtSlave:
    """The state of one node.

    `on_state(state)` is called on every change, with INITIALISING first of all in a reset; `on_reset(whole)` then
    restores the defaults (`whole`: the application's too). A frame of the wrong length is ignored. `locked` keeps the
    node out of operational; only a reset lifts it.
    """

    def __init__(
        self,
        node_id: int,
        clock: Clock,
        line: Line,
        on_state: Callable[[NmtState], None],
        on_reset: Callable[[bool], None],
    ) -> None:
        self.state = NmtState.INITIALISING
        self.operational = False
        """PDOs are sent and taken."""
        self.communicating = False
        """SDO, EMCY and SYNC are alive: pre-operational or operational."""
        self.locked = False
        self._node_id = node_id
        self._clock = clock
        self._line = line
        self._on_state = on_state
        self._on_reset = on_reset
        self._retry: Timer | None = None
        line.listen(NMT_CAN_ID, self._on_frame)

    def command(self, command: NmtCommand) -> None:
        """Does what a master's frame would do; a master node uses it on itself."""
        if command in (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION):
            self.reset(whole=command is NmtCommand.RESET_NODE)
        elif self.state is not NmtState.INITIALISING and not (command is NmtCommand.START and self.locked):
            self.enter(_TARGET[command])

    def enter(self, state: NmtState) -> None:
        """Goes to `state` and tells so, unless that is the present one."""
        if state is not self.state:
            self.state = state
            self.operational = state is NmtState.OPERATIONAL
            self.communicating = state in (NmtState.OPERATIONAL, NmtState.PRE_OPERATIONAL)
            self._on_state(state)

    def reset(self, whole: bool) -> None:
        """Through INITIALISING to PRE_OPERATIONAL, with the boot-up message in between."""
        self.locked = False
        self.enter(NmtState.INITIALISING)
        self._on_reset(whole)
        self._boot_up()

    def power_off(self) -> None:
        """Nothing is pending afterwards; `reset` begins again."""
        self.state = NmtState.INITIALISING
        self.operational = self.communicating = False
        if self._retry is not None:
            self._retry.cancel()

    def _boot_up(self) -> None:
        if self.state is not NmtState.INITIALISING:
            return
        if self._line.send(ERROR_CONTROL_BASE + self._node_id, BOOT_UP):
            self.enter(NmtState.PRE_OPERATIONAL)
        else:  # a master waits for the boot-up message: it must not get lost in a full queue
            self._retry = self._clock.call_at(self._clock.now_ns() + _RETRY_NS, self._boot_up)

    def _on_frame(self, frame: Frame) -> None:
        if len(frame.data) != 2 or frame.data[1] not in (0, self._node_id):
            return
        try:
            command = NmtCommand(frame.data[0])
        except ValueError:
            return
        self.command(command)
