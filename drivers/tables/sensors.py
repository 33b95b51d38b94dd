"""The two sensors: force and torque at the gripper, and a tracker that sees the TCP."""

from __future__ import annotations

from drivers.objects import DataType, DeviceDef
from drivers.tables.communication import U8, U16, Identity
from drivers.tables.fast import EVERY_SYNC, FastFrame, Signal, fast_device, vector
from drivers.tables.planner import POSITION_SCALE_M, ROTATION_SCALE_RAD

I16, I24 = DataType.INTEGER16, DataType.INTEGER24

FORCE_SCALE_N = 0.01
TORQUE_SCALE_NM = 0.001
AGE_SCALE_S = 1e-5

FORCE_FRAMES = (
    FastFrame(1, "force", 0x2101, vector("fx fy fz", I16, "N", FORCE_SCALE_N), EVERY_SYNC),
    FastFrame(2, "torque", 0x2102, vector("mx my mz", I16, "N·m", TORQUE_SCALE_NM), EVERY_SYNC),
)

TRACKER_FRAMES = (
    FastFrame(1, "tracked_xy", 0x2101, vector("x y", I24, "m", POSITION_SCALE_M)),
    FastFrame(
        2,
        "tracked_z",
        0x2102,
        (Signal("z", I24, "m", POSITION_SCALE_M), Signal("valid", U8, high=1), Signal("age", U16, "s", AGE_SCALE_S)),
    ),
    FastFrame(3, "tracked_rotation", 0x2103, vector("rx ry rz", I16, "rad", ROTATION_SCALE_RAD)),
)


def force_sensor(node_id: int) -> DeviceDef:
    """Wrench at the TCP, sampled at every SYNC."""
    return fast_device("force_sensor", node_id, Identity("force sensor", 5), FORCE_FRAMES, [], [])


def tracker(node_id: int) -> DeviceDef:
    """Pose of the TCP in the world, sent when there is a new one."""
    return fast_device("tracker", node_id, Identity("tracker", 6), TRACKER_FRAMES, [], [])
