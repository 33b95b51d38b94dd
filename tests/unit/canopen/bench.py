"""A small device with objects of every type, node id 5, and a tester on the same lockstep bus."""

from __future__ import annotations

import struct

from drivers.bus.lockstep import LockstepBus
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode, CommunicationLoss, NodeApplication
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.objects import Access, DataType, DeviceDef, ObjectDef, PdoDef, PdoKind

NODE = 5
MS = 1_000_000
D = DataType

OBJECTS = (
    ObjectDef(0x1008, 0, "Device name", D.VISIBLE_STRING, Access.CONST, "FIR-v1748-B538662"),
    ObjectDef(0x1006, 0, "Cycle period", D.UNSIGNED32),
    ObjectDef(0x2000, 0, "Level", D.INTEGER16, mappable=True),
    ObjectDef(0x2001, 0, "Gain", D.REAL32, default=1.5, mappable=True),
    ObjectDef(0x2002, 0, "Wide", D.REAL64, default=0.25),
    ObjectDef(0x2003, 0, "Place", D.INTEGER24, mappable=True),
    ObjectDef(0x2004, 0, "Flag", D.BOOLEAN, mappable=True),
    ObjectDef(0x2005, 0, "Percent", D.UNSIGNED8, default=50, mappable=True, low=0, high=100),
    ObjectDef(0x2006, 0, "Measured", D.UNSIGNED32, Access.RO, 7, mappable=True),
    ObjectDef(0x2007, 0, "Secret", D.UNSIGNED8, Access.WO),
    ObjectDef(0x2008, 0, "Note", D.VISIBLE_STRING, default="x"),
    ObjectDef(0x2009, 0, "Private", D.UNSIGNED8),
    ObjectDef(0x200A, 0, "List: entries", D.UNSIGNED8, Access.CONST, 2),
    ObjectDef(0x200A, 1, "List 1", D.INTEGER32, default=-1, mappable=True),
    ObjectDef(0x200A, 2, "List 2", D.INTEGER32, default=-2, mappable=True),
    ObjectDef(0x200B, 0, "Small", D.INTEGER8, mappable=True),
)
PDOS = (
    PdoDef(PdoKind.RPDO, 1, 0x200 + NODE, ((0x2000, 0), (0x2005, 0)), 1),
    PdoDef(PdoKind.RPDO, 2, 0x300 + NODE, ((0x2001, 0),), 255),
    PdoDef(PdoKind.RPDO, 3, 0x400 + NODE, (), 255, enabled=False),
    PdoDef(PdoKind.TPDO, 1, 0x180 + NODE, ((0x2000, 0), (0x2006, 0)), 1),
    PdoDef(PdoKind.TPDO, 2, 0x280 + NODE, ((0x2003, 0), (0x2004, 0), (0x2005, 0)), 255),
    PdoDef(PdoKind.TPDO, 3, 0x380 + NODE, ((0x2000, 0),), 0),
)
DEVICE = DeviceDef("bench", NODE, OBJECTS, PDOS)


class Recorder(NodeApplication):
    """Writes down what it is told."""

    def __init__(self) -> None:
        self.events: list[object] = []

    def on_reset(self, whole: bool) -> None:
        self.events.append(("reset", whole))

    def on_nmt_state(self, state: NmtState) -> None:
        self.events.append(state)

    def on_rpdo(self, number: int) -> None:
        self.events.append(("rpdo", number))

    def on_sync(self, counter: int | None) -> None:
        self.events.append(("sync", counter))

    def on_communication_loss(self, loss: CommunicationLoss) -> None:
        self.events.append(loss)

    def on_remote_state(self, node_id: int, state: int) -> None:
        self.events.append(("remote", node_id, state))


class Bench:
    """Powered on, pre-operational after the first millisecond. `heard` has every frame that the node sent."""

    def __init__(self, device: DeviceDef = DEVICE, power: bool = True) -> None:
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock)
        self.heard: list[Frame] = []
        self.port = self.bus.attach("tester", None, self.heard.append)
        self.application = Recorder()
        self.node = CanopenNode(device, self.clock, self.bus, self.application)
        if power:
            self.node.power_on()
            self.run(MS)

    def run(self, duration_ns: int) -> None:
        self.clock.run_until(self.clock.now_ns() + duration_ns)

    def tell(self, can_id: int, data: bytes | str) -> list[str]:
        """Sends a frame (hex or bytes), waits a millisecond; what the node sent meanwhile, as `id#data`."""
        self.heard.clear()
        self.port.send(can_id, bytes.fromhex(data) if isinstance(data, str) else data)
        self.run(MS)
        return [f"{frame.can_id:03X}#{frame.data.hex().upper()}" for frame in self.heard]

    def sdo(self, request: str) -> str:
        """One SDO request; the data of the one reply, hex."""
        replies = [line[4:] for line in self.tell(0x600 + NODE, request) if line.startswith(f"{0x580 + NODE:03X}")]
        (reply,) = replies
        return reply

    def write(self, index: int, subindex: int, data: bytes) -> int:
        """Expedited download; 0 or the abort code."""
        reply = bytes.fromhex(self.sdo(struct.pack("<BHB4s", 0x23 | 4 - len(data) << 2, index, subindex, data).hex()))
        return 0 if reply[0] == 0x60 else int.from_bytes(reply[4:], "little")

    def read(self, index: int, subindex: int = 0) -> int:
        """Expedited upload of an unsigned number; negative: minus the abort code."""
        reply = bytes.fromhex(self.sdo(struct.pack("<BHB4x", 0x40, index, subindex).hex()))
        number = int.from_bytes(reply[4:], "little")
        return -number if reply[0] == 0x80 else number

    def operational(self) -> None:
        self.tell(0x000, "0105")
        assert self.node.nmt.state is NmtState.OPERATIONAL

    def sent(self, can_id: int) -> list[bytes]:
        return [frame.data for frame in self.heard if frame.can_id == can_id]
