"""The strategic node: the twist that the TCP shall have, and what it is doing."""

from __future__ import annotations

from drivers.objects import DataType, DeviceDef
from drivers.tables.communication import U8, Identity
from drivers.tables.fast import FastFrame, Signal, fast_device, vector
from stack.messages import Gripper

I16, I24, U24 = DataType.INTEGER16, DataType.INTEGER24, DataType.UNSIGNED24

VELOCITY_SCALE_M_PER_S = 50e-6
ANGULAR_VELOCITY_SCALE_RAD_PER_S = 1e-4
JOINT_SCALE_RAD = 1e-6
"""rad; m for joint 2, the lift"""
JOINT_REFERENCE_COB_ID = 0x1E3
"""TPDOs 5 to 8 have no identifiers of their own; these are TPDOs 1 to 4 of node 99, which nobody is."""

FRAMES = (
    FastFrame(1, "twist_linear", 0x2101, vector("vx vy vz", I16, "m/s", VELOCITY_SCALE_M_PER_S)),
    FastFrame(2, "twist_angular", 0x2102, vector("wx wy wz", I16, "rad/s", ANGULAR_VELOCITY_SCALE_RAD_PER_S)),
    FastFrame(
        4,
        "mission",
        0x2104,
        (
            Signal("mode", U8),
            Signal("step", U8),
            Signal("gripper", U8, high=max(Gripper)),
            Signal("reserved", U24, high=0),
        ),
    ),
    *(
        FastFrame(
            5 + pair,
            f"joint_reference_{pair + 1}",
            0x2105 + pair,
            vector(f"q{2 * pair + 1} q{2 * pair + 2}", I24, "rad", JOINT_SCALE_RAD),
            cob_id=JOINT_REFERENCE_COB_ID + 0x100 * pair,
        )
        for pair in range(4)
    ),
)


def strategic(node_id: int, watched: list[int]) -> DeviceDef:
    return fast_device("strategic", node_id, Identity("strategic", 4), FRAMES, [], watched)
