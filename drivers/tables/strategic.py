"""The strategic node: the twist that the TCP shall have, and what it is doing."""

from __future__ import annotations

from drivers.objects import DataType, DeviceDef
from drivers.tables.communication import U8, U32, Identity
from drivers.tables.fast import FastFrame, Signal, fast_device, vector

I16 = DataType.INTEGER16

VELOCITY_SCALE_M_PER_S = 50e-6
ANGULAR_VELOCITY_SCALE_RAD_PER_S = 1e-4

FRAMES = (
    FastFrame(1, "twist_linear", 0x2101, vector("vx vy vz", I16, "m/s", VELOCITY_SCALE_M_PER_S)),
    FastFrame(2, "twist_angular", 0x2102, vector("wx wy wz", I16, "rad/s", ANGULAR_VELOCITY_SCALE_RAD_PER_S)),
    FastFrame(4, "mission", 0x2104, (Signal("mode", U8), Signal("step", U8), Signal("reserved", U32, high=0))),
)


def strategic(node_id: int, watched: list[int]) -> DeviceDef:
    return fast_device("strategic", node_id, Identity("strategic", 4), FRAMES, [], watched)
