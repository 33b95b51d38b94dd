"""A CANopen device: the services of CiA 301 bound to one object dictionary, one clock and one bus."""

from __future__ import annotations

from enum import Enum

from drivers.bus.base import Bus
from drivers.canopen.dictionary import ObjectDictionary
from drivers.canopen.emcy import EmcyCode, Emergency
from drivers.canopen.heartbeat import HeartbeatConsumer, HeartbeatProducer
from drivers.canopen.line import Handler, Line
from drivers.canopen.nmt import ERROR_CONTROL_BASE, NmtCommand, NmtSlave, NmtState
from drivers.canopen.pdo import ReceivePdo, TransmitPdo
from drivers.canopen.sdo import SdoServer
from drivers.canopen.sync import SyncConsumer, SyncProducer
from drivers.clock import Clock
from drivers.frame import Frame
from drivers.objects import DeviceDef, PdoKind, Value

SYNC_PATIENCE_NS = 100_000_000
_COMMUNICATION_AREA = (0x1000, 0x1FFF)
_WHOLE_DICTIONARY = (0x1000, 0xFFFF)


class CommunicationLoss(Enum):
    """Why a node has to reckon with being alone."""

    HEARTBEAT = "heartbeat of a watched node lost"
    RPDO = "no RPDO within its event time"
    SYNC = "no SYNC within its period"
    NMT = "left operational"
    DUPLICATE = "another node has the same id"


class NodeApplication:
    """What a device does beyond communication: override what is needed, pass an instance to CanopenNode."""

    def on_reset(self, whole: bool) -> None:
        """Objects have their power-on values again: all of them (`whole`), or those of the communication area."""

    def on_nmt_state(self, state: NmtState) -> None:
        """The NMT state has changed; INITIALISING comes before `on_reset`."""

    def on_rpdo(self, number: int) -> None:
        """All values of this RPDO are in the dictionary, and those of every other RPDO of the same SYNC."""

    def on_sync(self, counter: int | None) -> None:
        """A SYNC: after the RPDOs that became valid with it, before the TPDOs that sample at it."""

    def on_communication_loss(self, loss: CommunicationLoss) -> None:
        """Somebody this node depends on cannot be heard any more."""

    def on_remote_state(self, node_id: int, state: int) -> None:
        """Heartbeat or boot-up message (state 0) of a watched node."""


class CanopenNode:
    """One node. Nothing happens before `power_on`; afterwards frames and the clock drive it, no thread, no sleep.

    `node.dictionary` has the objects, `node.nmt.state` the state, `node.tpdo[n].trigger()` sends an event-driven PDO,
    `node.emcy.report(...)` tells of an error, `node.subscribe` hears foreign frames.
    """

    def __init__(self, device: DeviceDef, clock: Clock, bus: Bus, application: NodeApplication | None = None) -> None:
        self._synced_ns: int | None = None
        self.device = device
        self.node_id = device.node_id
        self.clock = clock
        self.application = application or NodeApplication()
        self.dictionary = dictionary = ObjectDictionary(device)
        self.line = line = Line(device.name, bus)
        self.nmt = nmt = NmtSlave(device.node_id, clock, line, self._on_nmt_state, self._on_reset)
        self.emcy = emcy = Emergency(dictionary, clock, line, nmt)
        self.sdo = SdoServer(device.node_id, dictionary, clock, line, nmt)
        self.heartbeat_producer = HeartbeatProducer(device.node_id, dictionary, clock, line, nmt)
        self.heartbeat_consumer = HeartbeatConsumer(
            dictionary, clock, line, emcy, self._on_heartbeat_lost, self._on_remote_state, self._excuses
        )
        self.sync_consumer = SyncConsumer(dictionary, line, nmt, emcy, self._on_sync)
        self.sync_producer = SyncProducer(dictionary, clock, line, nmt, self._on_sync)
        self.rpdo: dict[int, ReceivePdo] = {}
        self.tpdo: dict[int, TransmitPdo] = {}
        for pdo in device.pdos:
            if pdo.kind is PdoKind.RPDO:
                self.rpdo[pdo.number] = ReceivePdo(
                    pdo.number, dictionary, clock, line, nmt, emcy, self._on_rpdo, self._on_rpdo_timeout
                )
            else:
                self.tpdo[pdo.number] = TransmitPdo(pdo.number, dictionary, clock, line, nmt)
        for index in (0x1005, 0x1006, 0x1019):
            if (index, 0) in dictionary:
                dictionary.bind(index, sink=self._on_sync_parameter)
        line.listen(ERROR_CONTROL_BASE + device.node_id, self._on_own_id)
        self._configure()
        self._silence()
        line.connected = False
        line.connect()

    def power_on(self) -> None:
        """Boots: defaults, boot-up message, pre-operational."""
        self.line.connected = True
        self.nmt.reset(whole=True)

    def power_off(self) -> None:
        """Gone from the bus at once, without a word; `power_on` boots again."""
        self.line.connected = False
        self.nmt.power_off()
        self._silence()

    def subscribe(self, can_id: int, handler: Handler) -> None:
        """`handler` gets every frame of `can_id`, in whatever state the node is."""
        self.line.listen(can_id, handler)

    def start(self) -> None:
        """What an NMT start command does; for the node that is the NMT master itself."""
        self.nmt.command(NmtCommand.START)

    def _configure(self) -> None:
        self.sync_consumer.configure()
        for pdo in (*self.rpdo.values(), *self.tpdo.values()):
            pdo.configure()
        self.heartbeat_consumer.configure()
        self.heartbeat_producer.configure()
        self.sync_producer.configure()

    def _silence(self) -> None:
        self.heartbeat_producer.stop()
        self.heartbeat_consumer.stop()
        self.sync_producer.stop()
        self.sdo.reset()
        self.emcy.reset()
        self._idle_pdos()

    def _idle_pdos(self) -> None:
        for pdo in (*self.rpdo.values(), *self.tpdo.values()):
            pdo.idle()

    def _on_reset(self, whole: bool) -> None:
        self._silence()
        self.dictionary.restore_defaults(*(_WHOLE_DICTIONARY if whole else _COMMUNICATION_AREA))
        self._configure()
        self.application.on_reset(whole)

    def _on_nmt_state(self, state: NmtState) -> None:
        if state is NmtState.OPERATIONAL:
            for pdo in self.tpdo.values():
                pdo.begin()
        else:
            self._idle_pdos()
        if state is NmtState.STOPPED:
            self.sdo.reset()
        self.application.on_nmt_state(state)
        self.emcy.flush()

    def _on_sync(self, counter: int | None) -> None:
        self._synced_ns = self.clock.now_ns()
        if self.nmt.operational:
            stored = [pdo for pdo in self.rpdo.values() if pdo.pending is not None and pdo.store()]
            for received in stored:
                received.announce()
        self.application.on_sync(counter)
        if self.nmt.operational:
            for pdo in self.tpdo.values():
                if pdo.valid:
                    pdo.on_sync(counter)

    def _on_sync_parameter(self, _: Value) -> None:
        self.sync_consumer.configure()
        self.sync_producer.configure()

    def _on_rpdo(self, number: int) -> None:
        self.application.on_rpdo(number)

    def _on_rpdo_timeout(self, _: int) -> None:
        self._lost(CommunicationLoss.RPDO)

    def _on_heartbeat_lost(self, _: int) -> None:
        self._lost(CommunicationLoss.HEARTBEAT)

    def _excuses(self, node_id: int) -> bool:
        """Whether a node whose heartbeat is overdue may be there all the same: SYNC comes. Then it has three time-outs, not one."""
        return self._synced_ns is not None and self.clock.now_ns() - self._synced_ns < SYNC_PATIENCE_NS

    def _on_remote_state(self, node_id: int, state: int) -> None:
        self.application.on_remote_state(node_id, state)

    def _on_own_id(self, _: Frame) -> None:
        """A port never hears itself: this is another node with our id. Neither of the two may go on."""
        if self.nmt.state is NmtState.INITIALISING:
            return
        self.nmt.locked = True
        self.emcy.report(EmcyCode.CAN_ID_COLLISION, bytes((self.node_id,)))
        self._lost(CommunicationLoss.DUPLICATE)
        if self.nmt.operational:
            self.nmt.enter(NmtState.PRE_OPERATIONAL)

    def _lost(self, loss: CommunicationLoss) -> None:
        """The application first, so that it knows why; then the error behaviour of 1029h:1."""
        self.application.on_communication_loss(loss)
        if loss is not CommunicationLoss.HEARTBEAT:
            return
        behaviour = self.dictionary.integer_or(0, 0x1029, 1)
        if behaviour == 0 and self.nmt.operational:
            self.nmt.enter(NmtState.PRE_OPERATIONAL)
        elif behaviour == 2 and self.nmt.communicating:
            self.nmt.enter(NmtState.STOPPED)
