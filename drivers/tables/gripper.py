"""The gripper: hears the mission frame, and says what it is doing."""

from __future__ import annotations

from drivers.objects import DataType, DeviceDef
from drivers.tables.communication import U8, Identity
from drivers.tables.fast import FastFrame, Signal, fast_device
from stack.messages import GripperPhase

EVERY_SECOND_SYNC = 2

FRAMES = (
    FastFrame(
        1,
        "gripper",
        0x2101,
        (
            Signal("state", U8, high=max(GripperPhase)),
            Signal("reserved_1", DataType.UNSIGNED16, high=0),
            Signal("reserved_2", DataType.UNSIGNED24, high=0),
        ),
        EVERY_SECOND_SYNC,
    ),
)


def gripper(node_id: int) -> DeviceDef:
    """Opens and closes as the mission frame says; its state with every second SYNC."""
    return fast_device("gripper", node_id, Identity("gripper", 7), FRAMES, [], [])
