"""Writes every robot.urdf from its robot.toml: `python -m config.robots.generate`."""

from __future__ import annotations

from config.robots.mobile_manipulator import mobile_manipulator
from config.robots.serial_arm import serial_arm
from stack.kinematics.robot_file import ROBOTS, RobotFile, read_robot_file


def urdf_text(spec: RobotFile) -> str:
    """The URDF that belongs to a robot file."""
    robot = serial_arm(spec) if spec.platform is None else mobile_manipulator(spec)
    return robot.text()


def main() -> None:
    for path in sorted(ROBOTS.glob("*/robot.toml")):
        path.with_name("robot.urdf").write_text(urdf_text(read_robot_file(path)), encoding="utf-8")


if __name__ == "__main__":
    main()
