"""What the master of drives hears, frame by frame: who is to be told of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from drivers.canopen.nmt import ERROR_CONTROL_BASE
from drivers.canopen.sdo_client import RESPONSE_BASE, SdoClient
from drivers.canopen.sequence import Sequencer
from drivers.cia402.axis import AxisClient
from drivers.cia402.cyclic import CyclicData
from drivers.cia402.master_supervision import SUPERVISED, MasterSupervision
from drivers.cia402.phases import EventKind
from drivers.clock import Clock
from drivers.frame import Frame

EMCY_BASE = 0x080


class Hearing:
    """Feedback, emergencies, SDO answers and heartbeats of the drives that `listen` was called for. `report(axis, kind, text)`."""

    def __init__(
        self,
        clock: Clock,
        sequencer: Sequencer,
        supervision: MasterSupervision,
        cyclic: CyclicData,
        report: Callable[[AxisClient, EventKind, str], None],
    ) -> None:
        self._clock = clock
        self._sequencer = sequencer
        self._supervision = supervision
        self._cyclic = cyclic
        self._report = report
        self._handlers: dict[int, Callable[[Frame], None]] = {}

    @property
    def can_ids(self) -> frozenset[int]:
        """Identifiers that `on_frame` does something with."""
        return frozenset(self._handlers)

    def listen(self, axis: AxisClient, client: SdoClient) -> None:
        """From now on to this drive, too."""
        node = axis.node_id
        self._handlers[axis.feedback_id] = partial(self._on_feedback, axis)
        if axis.velocity_id is not None:
            self._handlers[axis.velocity_id] = partial(self._on_velocity, axis)
        self._handlers[EMCY_BASE + node] = partial(self._supervision.on_emergency, axis)
        self._handlers[RESPONSE_BASE + node] = partial(self._on_sdo, axis, client)
        self._handlers[ERROR_CONTROL_BASE + node] = partial(self._on_heartbeat, axis)

    def on_frame(self, frame: Frame) -> None:
        """Any frame; others than those of `can_ids` are ignored."""
        handler = self._handlers.get(frame.can_id)
        if handler is not None:
            handler(frame)

    def _on_feedback(self, axis: AxisClient, frame: Frame) -> None:
        if len(frame.data) != 8:
            self._malformed(axis, frame, 8)
            return
        axis.take_feedback(frame.data, self._clock.now_ns())
        if axis.phase in SUPERVISED:
            self._supervision.check_status(axis)
        self._sequencer.poll()
        if axis.started and not axis.follows_planner:
            self._cyclic.send_command(axis)

    def _on_velocity(self, axis: AxisClient, frame: Frame) -> None:
        if len(frame.data) == 5:
            axis.take_velocity(frame.data, self._clock.now_ns())
        else:
            self._malformed(axis, frame, 5)

    def _on_sdo(self, axis: AxisClient, client: SdoClient, frame: Frame) -> None:
        if client.idle:  # the answer to a question whether anybody is there
            axis.heard = True
            self._sequencer.poll()
        client.on_frame(frame)

    def _on_heartbeat(self, axis: AxisClient, frame: Frame) -> None:
        self._supervision.on_heartbeat(axis, frame)
        self._sequencer.poll()

    def _malformed(self, axis: AxisClient, frame: Frame, length: int) -> None:
        if axis.started and axis.phase in SUPERVISED:
            axis.needs_configuration = True
            text = f"frame {frame.can_id:03X}h with {len(frame.data)} bytes, must be {length}: its mapping was changed"
            self._report(axis, EventKind.FEEDBACK_MALFORMED, text)
