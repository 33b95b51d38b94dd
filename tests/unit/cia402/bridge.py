"""A python-can bus that is a port of the lockstep bus, for masters that are not ours.

Virtual time runs only inside `recv`, in whatever thread calls it (python-can's notifier), and as fast as it can; cyclic
messages are timers of the virtual clock. So a drive sees its master in time, however slowly the master's thread runs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

import can
from can.broadcastmanager import CyclicSendTaskABC

from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame

_STEP_NS = 1_000_000
_STEPS_PER_CALL = 100


class LockstepBridge(can.BusABC):
    """Everything that touches the clock or the port is done by the thread in `recv`; others leave it in a queue."""

    def __init__(self, clock: LockstepClock, bus: LockstepBus) -> None:
        self._clock = clock
        self._inbox: deque[Frame] = deque()
        self._to_do: deque[Callable[[], object]] = deque()
        self.port = bus.attach("foreign master", None, self._inbox.append)
        super().__init__(channel="lockstep")
        self.channel_info = "lockstep bus"

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        can_id, data = msg.arbitration_id, bytes(msg.data)
        self._to_do.append(lambda: self.port.send(can_id, data))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        for _ in range(_STEPS_PER_CALL):
            while self._to_do:
                self._to_do.popleft()()
            if self._inbox:
                frame = self._inbox.popleft()
                message = can.Message(
                    timestamp=frame.t_ns * 1e-9,
                    arbitration_id=frame.can_id,
                    is_extended_id=False,
                    data=frame.data,
                )
                return message, True
            self._clock.run_until(self._clock.now_ns() + _STEP_NS)
        return None, True

    def _send_periodic_internal(
        self,
        msgs: Sequence[can.Message] | can.Message,
        period: float,
        duration: float | None = None,
        autostart: bool = True,
        modifier_callback: Callable[[can.Message], None] | None = None,
    ) -> _CyclicTask:
        (message,) = [msgs] if isinstance(msgs, can.Message) else msgs
        task = _CyclicTask(self, message, round(period * 1e9))
        self._to_do.append(task.fire)
        return task


class _CyclicTask(CyclicSendTaskABC):
    def __init__(self, bridge: LockstepBridge, message: can.Message, period_ns: int) -> None:
        super().__init__(message, period_ns * 1e-9)
        self._bridge = bridge
        self._can_id = message.arbitration_id
        self._data = bytes(message.data)
        self._period_ns = period_ns
        self._stopped = False

    def fire(self) -> None:
        if not self._stopped:
            self._bridge.port.send(self._can_id, self._data)
            clock = self._bridge._clock
            clock.call_at(clock.now_ns() + self._period_ns, self.fire)

    def modify_data(self, messages: can.Message) -> None:
        self._data = bytes(messages.data)

    def stop(self) -> None:
        self._stopped = True
