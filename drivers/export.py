"""The files that other tools read, made from the catalogue: one DBC for the bus, one EDS per type of device."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from drivers.catalogue import (
    DRIVE_IDS,
    FORCE_SENSOR_ID,
    GRIPPER_ID,
    PLANNER_ID,
    STRATEGIC_ID,
    TRACKER_ID,
    devices,
)
from drivers.dbc import dbc_text
from drivers.dbc_frames import bus_messages
from drivers.eds import eds_text
from drivers.objects import DeviceDef
from drivers.tables.drive import WHEEL_LIMITS, drive
from drivers.tables.gripper import gripper
from drivers.tables.planner import planner
from drivers.tables.sensors import force_sensor, tracker
from drivers.tables.strategic import strategic

DBC_NAME = "canipulator.dbc"
_DBC_COMMENT = (
    "Mobile manipulator on one CAN bus (CANopen conventions). Cycle times are the defaults: SYNC every 10 ms."
    " Torques are parts of the rated torque, which each drive has in 6076h."
)
_OTHERS = [STRATEGIC_ID, *DRIVE_IDS, FORCE_SENSOR_ID, TRACKER_ID, GRIPPER_ID]
_DEVICE_TYPES: dict[str, tuple[Callable[[int], DeviceDef], str]] = {
    "joint_drive.eds": (
        lambda node_id: drive(node_id, "joint_drive"),
        "Joint drive, CiA 402, cyclic synchronous position; rated torque and limits belong to the robot",
    ),
    "wheel_drive.eds": (
        lambda node_id: drive(node_id, "wheel_drive", 10_000, WHEEL_LIMITS, wheel=True),
        "Wheel drive, CiA 402, cyclic synchronous velocity; rated torque and limits belong to the robot",
    ),
    "planner.eds": (lambda node_id: planner(node_id, _OTHERS), "Planner: set points for ten drives, produces SYNC"),
    "strategic.eds": (lambda node_id: strategic(node_id, [PLANNER_ID]), "Strategic node: commands the TCP's twist"),
    "force_sensor.eds": (force_sensor, "Force and torque sensor at the gripper"),
    "tracker.eds": (tracker, "Tracker of the TCP's pose"),
    "gripper.eds": (gripper, "Two-finger gripper that the mission frame opens and closes"),
}


def dbc_files() -> dict[str, str]:
    """Name and text of the DBC."""
    table = devices()
    nodes = [device.name for device in table.values()]
    return {DBC_NAME: dbc_text(nodes, bus_messages(table), _DBC_COMMENT)}


def eds_files() -> dict[str, str]:
    """Name and text of every EDS."""
    return {name: eds_text(name, make, description) for name, (make, description) in _DEVICE_TYPES.items()}


def write(directory: Path, files: dict[str, str]) -> list[Path]:
    """Writes the files and gives their paths. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, text in files.items():
        path = directory / name
        path.write_bytes(text.encode("ascii"))
        paths.append(path)
    return paths
