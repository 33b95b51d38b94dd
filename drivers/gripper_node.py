"""The gripper as a node: does what the mission frame asks, and says with every second SYNC what has come of it."""

from __future__ import annotations

from typing import Protocol

from drivers.bus.base import Bus
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode, NodeApplication
from drivers.clock import Clock
from drivers.codec import GRIPPER_STATE, MISSION
from drivers.frame import Frame
from drivers.objects import DeviceDef
from drivers.publisher import Publisher, receive
from stack.messages import Gripper, GripperPhase, GripperState


class Fingers(Protocol):
    """What the node commands."""

    @property
    def phase(self) -> GripperPhase: ...

    def command(self, asked: Gripper) -> None: ...


class GripperNode(NodeApplication):
    """Node 33. Takes commands while it is operational; whatever is not one (wrong checksum, unknown value) it leaves alone."""

    def __init__(self, device: DeviceDef, clock: Clock, bus: Bus, fingers: Fingers) -> None:
        self.node = CanopenNode(device, clock, bus, self)
        self._fingers = fingers
        self._counter = 0
        self._operational = False
        self._publisher = Publisher(self.node, GRIPPER_STATE)
        self._mission = receive(self.node, MISSION)
        for can_id in MISSION.can_ids:
            self.node.subscribe(can_id, self._on_mission)

    def on_nmt_state(self, state: NmtState) -> None:
        self._operational = state is NmtState.OPERATIONAL

    def on_sync(self, counter: int | None) -> None:
        self._counter = (self._counter + 1) & 0xFF
        self._publisher.publish(GripperState(self._fingers.phase, self._counter))

    def _on_mission(self, frame: Frame) -> None:
        mission = self._mission.take()
        if mission is not None and self._operational and mission.gripper is not Gripper.KEEP:
            self._fingers.command(mission.gripper)
