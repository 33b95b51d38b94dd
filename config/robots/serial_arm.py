"""The other robots: a serial arm of rods and joint discs on a pedestal at the origin."""

from __future__ import annotations

from config.robots.chain import COLOURS, add_chain, rod, tcp_link
from config.robots.urdf import Joint, Link, Robot, Shape
from stack.kinematics.robot_file import JointRow, RobotFile


def serial_arm(spec: RobotFile) -> Robot:
    """URDF of a stationary arm; rods are as thick as the reach asks for."""
    reach = sum(abs(row.a) + abs(row.d) for row in spec.joints)
    radius = 0.035 * reach**0.5

    def body(row: JointRow) -> Link:
        solid = rod(row, radius, "orange")
        disc = Shape("cylinder", (1.25 * radius, 2.2 * radius), colour="dark")
        return Link(row.link, row.mass, solid, row.rotor_inertia, (disc, solid), (solid,))

    robot = Robot(spec.name, COLOURS)
    plate = Shape("cylinder", (2.5 * radius, radius), (0.0, 0.0, radius / 2), colour="dark")
    robot.links.append(Link(spec.base_link, 20.0, plate, visuals=(plate,), collisions=(plate,)))
    last, xyz, rpy = add_chain(robot, spec, body)
    robot.links.append(tcp_link())
    robot.joints.append(Joint("tcp_joint", "fixed", last, spec.tcp_link, xyz, rpy))
    return robot
