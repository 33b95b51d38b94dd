"""What a robot's TOML file says: one row per joint, named links and points, the platform. The URDF is generated from it."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROBOTS = Path(__file__).resolve().parents[2] / "config" / "robots"


@dataclass(frozen=True, slots=True)
class JointRow:
    """One joint and the link that it moves, in SI units (rad or m; N·m or N).

    `d`, `a`, `alpha` are the standard DH row that follows the joint's own motion, `T = Rz(q) Tz(d) Tx(a) Rx(alpha)`
    (a prismatic joint: `Tz(q)`). `rotor_inertia` (kg·m²) is the drive's, reflected to the link, in every axis.
    """

    name: str
    link: str
    revolute: bool
    d: float
    a: float
    alpha: float
    lower: float
    upper: float
    velocity: float
    acceleration: float
    mass: float
    rotor_inertia: float
    rated_effort: float
    peak_effort: float


@dataclass(frozen=True, slots=True)
class PlatformParameters:
    """The unicycle platform in SI units; its reference point is the middle of the wheel axis on the ground.

    `arm_base` (x, y, z) is the arm's base frame in the platform's frame, axes parallel. Efforts are those of one wheel;
    a wheel follows its command after `wheel_dead_time` (s) with `wheel_bandwidth` (Hz).
    """

    wheel_joints: tuple[str, str]
    wheel_radius: float
    track: float
    arm_base: tuple[float, float, float]
    velocity: float
    yaw_rate: float
    acceleration: float
    yaw_acceleration: float
    wheel_bandwidth: float
    wheel_dead_time: float
    wheel_rated_effort: float
    wheel_peak_effort: float


@dataclass(frozen=True, slots=True)
class RobotFile:
    """A whole robot.toml. `first_wrist_joint` counts from 0; the joints before it move the wrist centre."""

    name: str
    handedness: str | None
    base_link: str
    tcp_link: str
    wrist_link: str | None
    first_wrist_joint: int
    home: tuple[float, ...]
    preferred: tuple[float, ...]
    padding: float
    points: Mapping[str, str]
    joints: tuple[JointRow, ...]
    platform: PlatformParameters | None


def robot_directory(name: str) -> Path:
    """Folder of the robot `name`; ValueError names the robots that exist."""
    known = sorted(path.parent.name for path in ROBOTS.glob("*/robot.toml"))
    if name not in known:
        raise ValueError(f"robot {name!r} is unknown; known are {', '.join(known)}")
    return ROBOTS / name


def read_robot_file(path: Path) -> RobotFile:
    """Read one robot.toml. ValueError names the file and the key that is missing, superfluous or of the wrong kind."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    try:
        return _robot(table)
    except KeyError as missing:
        raise ValueError(f"{path}: key {missing} is missing") from None
    except (TypeError, ValueError) as wrong:
        raise ValueError(f"{path}: {wrong}") from None


def _robot(table: dict[str, Any]) -> RobotFile:
    arm = table["arm"]
    joints = tuple(_joint(row) for row in table["joint"])
    n = len(joints)
    home, preferred = _configuration(arm, "home", n), _configuration(arm, "preferred", n)
    platform = table.get("platform")
    return RobotFile(
        name=str(table["name"]),
        handedness=table.get("handedness"),
        base_link=str(arm["base_link"]),
        tcp_link=str(arm["tcp_link"]),
        wrist_link=arm.get("wrist_link"),
        first_wrist_joint=int(arm.get("first_wrist_joint", n)),
        home=home,
        preferred=preferred,
        padding=float(arm["padding"]),
        points=dict(arm.get("points", {})),
        joints=joints,
        platform=None if platform is None else _platform(platform),
    )


def _configuration(arm: dict[str, Any], key: str, n: int) -> tuple[float, ...]:
    values = tuple(float(value) for value in arm[key])
    if len(values) != n:
        raise ValueError(f"arm.{key} has {len(values)} values, the robot has {n} joints")
    return values


def _si(row: dict[str, Any], key: str) -> float:
    """Value of `key`, or of `key_deg` turned into radians."""
    return math.radians(row[f"{key}_deg"]) if f"{key}_deg" in row else float(row[key])


def _joint(row: dict[str, Any]) -> JointRow:
    if row["type"] not in ("revolute", "prismatic"):
        raise ValueError(f"joint {row['name']}: type {row['type']!r} is neither revolute nor prismatic")
    joint = JointRow(
        name=str(row["name"]),
        link=str(row["link"]),
        revolute=row["type"] == "revolute",
        d=float(row["d"]),
        a=float(row["a"]),
        alpha=_si(row, "alpha"),
        lower=_si(row, "lower"),
        upper=_si(row, "upper"),
        velocity=_si(row, "velocity"),
        acceleration=_si(row, "acceleration"),
        mass=float(row["mass"]),
        rotor_inertia=float(row["rotor_inertia"]),
        rated_effort=float(row["rated_effort"]),
        peak_effort=float(row["peak_effort"]),
    )
    if joint.lower >= joint.upper:
        raise ValueError(f"joint {joint.name}: lower limit {joint.lower} is not below the upper limit {joint.upper}")
    return joint


def _platform(table: dict[str, Any]) -> PlatformParameters:
    left, right = table["wheel_joints"]
    x, y, z = (float(value) for value in table["arm_base"])
    rest = {key: float(value) for key, value in table.items() if key not in ("wheel_joints", "arm_base")}
    return PlatformParameters(wheel_joints=(left, right), arm_base=(x, y, z), **rest)
