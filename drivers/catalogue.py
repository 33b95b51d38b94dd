"""The one table of the bus: who is on it, with which objects and PDOs. EDS, DBC, codec and devices come from it.

Node ids and names are fixed; what belongs to a robot (rated torques, limits) is given to `devices`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.objects import DeviceDef, PdoKind
from drivers.tables.drive import JOINT_LIMITS, LIFT_LIMITS, WHEEL_LIMITS, DriveLimits, drive
from drivers.tables.gripper import gripper
from drivers.tables.planner import planner
from drivers.tables.sensors import force_sensor, tracker
from drivers.tables.strategic import strategic

STRATEGIC_ID = 1
PLANNER_ID = 2
WHEEL_IDS = (11, 12)
JOINT_IDS = (21, 22, 23, 24, 25, 26, 27, 28)
DRIVE_IDS = WHEEL_IDS + JOINT_IDS
FORCE_SENSOR_ID = 31
TRACKER_ID = 32
GRIPPER_ID = 33


@dataclass(frozen=True, slots=True)
class DriveParameters:
    """What of a drive belongs to the robot. `rated_torque_mNm` in mN·m, or mN for a `linear` axis (µm, not µrad)."""

    name: str
    rated_torque_mNm: int = 100_000
    limits: DriveLimits = JOINT_LIMITS
    linear: bool = False


DEFAULT_DRIVES: Mapping[int, DriveParameters] = {
    11: DriveParameters("wheel_left", 10_000, WHEEL_LIMITS),
    12: DriveParameters("wheel_right", 10_000, WHEEL_LIMITS),
    21: DriveParameters("tower_rotate"),
    22: DriveParameters("tower_lift", 500_000, LIFT_LIMITS, linear=True),
    23: DriveParameters("shoulder"),
    24: DriveParameters("upper_arm"),
    25: DriveParameters("elbow"),
    26: DriveParameters("lower_arm"),
    27: DriveParameters("wrist_tilt", 30_000),
    28: DriveParameters("wrist_pan", 30_000),
}


def devices(drives: Mapping[int, DriveParameters] = DEFAULT_DRIVES) -> dict[int, DeviceDef]:
    """All devices by node id. Raises ValueError when `drives` does not name each of the ten drives and only those."""
    if set(drives) != set(DRIVE_IDS):
        raise ValueError(f"drives {sorted(drives)}: must be the node ids {sorted(DRIVE_IDS)}")
    others = [
        strategic(STRATEGIC_ID, watched=[PLANNER_ID]),
        planner(PLANNER_ID, watched=[STRATEGIC_ID, *DRIVE_IDS, FORCE_SENSOR_ID, TRACKER_ID, GRIPPER_ID]),
        force_sensor(FORCE_SENSOR_ID),
        tracker(TRACKER_ID),
        gripper(GRIPPER_ID),
    ]
    axes = [
        drive(
            node_id,
            drives[node_id].name,
            drives[node_id].rated_torque_mNm,
            drives[node_id].limits,
            linear=drives[node_id].linear,
            wheel=node_id in WHEEL_IDS,
        )
        for node_id in DRIVE_IDS
    ]
    return {device.node_id: device for device in sorted(others + axes, key=lambda device: device.node_id)}


def receivers(device: DeviceDef, kind: PdoKind) -> tuple[int, ...]:
    """Node ids that use the PDOs of `device` that go out (TPDO) or come in (RPDO: the device itself)."""
    if kind is PdoKind.RPDO:
        return (device.node_id,)
    return (STRATEGIC_ID,) if device.node_id in (PLANNER_ID, GRIPPER_ID) else (PLANNER_ID,)
