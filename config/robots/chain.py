"""DH rows as URDF joints: the frame of joint i is the one that the standard DH rows before it give."""

from __future__ import annotations

import math
from collections.abc import Callable

from config.robots.urdf import ZERO, Joint, Link, Robot, Shape, Triple
from stack.kinematics.robot_file import JointRow, RobotFile

COLOURS = {
    "grey": (0.55, 0.57, 0.60, 1.0),
    "dark": (0.16, 0.17, 0.19, 1.0),
    "light": (0.86, 0.87, 0.88, 1.0),
    "orange": (0.95, 0.45, 0.08, 1.0),
    "blue": (0.13, 0.38, 0.66, 1.0),
    "red": (0.75, 0.12, 0.12, 1.0),
    "rubber": (0.06, 0.06, 0.06, 1.0),
}


def add_chain(robot: Robot, spec: RobotFile, body: Callable[[JointRow], Link]) -> tuple[str, Triple, Triple]:
    """Append the arm's joints and links, each link's body from `body`.

    Returns the last link and the placement of the TCP in it.
    """
    parent, xyz, rpy = spec.base_link, ZERO, ZERO
    for row in spec.joints:
        kind = "revolute" if row.revolute else "prismatic"
        limit = (row.lower, row.upper, row.peak_effort, row.velocity)
        robot.links.append(body(row))
        robot.joints.append(Joint(row.name, kind, parent, row.link, xyz, rpy, limit=limit))
        # The row's own turn and lift are the joint's motion; what is left of it places the next frame.
        parent, xyz, rpy = row.link, (row.a, 0.0, row.d), (row.alpha, 0.0, 0.0)
    return parent, xyz, rpy


def rod(row: JointRow, radius: float, colour: str = "grey") -> Shape:
    """Cylinder from the link's frame to the next joint's; a ball-like disc where the two coincide."""
    length = math.hypot(row.a, row.d)
    if length < 1e-9:
        return Shape("cylinder", (1.2 * radius, 2.4 * radius), colour=colour)
    pitch = math.atan2(row.a, row.d)
    return Shape("cylinder", (radius, length), (row.a / 2, 0.0, row.d / 2), (0.0, pitch, 0.0), colour)


def tcp_link() -> Link:
    """The TCP carries no mass worth mentioning; PyBullet would give a link without inertia a whole kilogram."""
    return Link("tcp", 1e-3, Shape("sphere", (0.05,)), visuals=(Shape("sphere", (0.008,), colour="red"),))
