"""The thesis's robot: platform, lift tower, arm with the wrist hanging beside the tower, force sensor, gripper."""

from __future__ import annotations

import math
from collections.abc import Sequence

from config.robots.chain import COLOURS, add_chain, tcp_link
from config.robots.urdf import Joint, Link, Robot, Shape, Triple
from stack.kinematics.robot_file import JointRow, PlatformParameters, RobotFile

# With these, no wheel lifts in any arm posture at full acceleration or in the tightest fast curve: 60 kg would tip.
PLATFORM_MASS, CENTRE_X, CENTRE_Z = 70.0, 0.13, 0.11
CASTOR_X, CASTOR_RADIUS = 0.43, 0.05
SENSOR_AT = 0.13  # m from the wrist centre to the force sensor, along the hand
SENSOR_LENGTH = 0.03


def box(size: Triple, xyz: Triple, colour: str) -> Shape:
    """Box with its middle at `xyz`."""
    return Shape("box", size, xyz, colour=colour)


def tube(radius: float, start: float, end: float, colour: str) -> Shape:
    """Cylinder along z between two heights."""
    return Shape("cylinder", (radius, abs(end - start)), (0.0, 0.0, (start + end) / 2), colour=colour)


# Visual shapes of the arm's links. The shoulder's z axis points sideways, away from the tower (to B); the upper arm's
# and the lower arm's point up, so that their links hang towards negative z; the elbow's and the tilt's are sideways.
LOOKS: dict[str, Sequence[Shape]] = {
    "tower": (
        tube(0.13, 0.0, 0.05, "dark"),
        box((0.035, 0.09, 1.27), (0.075, 0.0, 0.685), "light"),
        box((0.035, 0.09, 1.27), (-0.075, 0.0, 0.685), "light"),
        box((0.185, 0.09, 0.03), (0.0, 0.0, 1.335), "dark"),
    ),
    "lift": (
        box((0.115, 0.13, 0.20), (0.0, 0.0, 0.0), "orange"),
        Shape("cylinder", (0.06, 0.05), (0.0, 0.09, 0.0), (math.pi / 2, 0.0, 0.0), "dark"),
    ),
    "shoulder": (
        tube(0.052, 0.115, 0.16, "orange"),
        tube(0.038, 0.16, 0.32, "light"),
        tube(0.055, 0.31, 0.42, "dark"),
    ),
    "upper_arm": (tube(0.048, -0.03, -0.09, "orange"), tube(0.034, -0.09, -0.23, "light")),
    "elbow": (tube(0.05, -0.055, 0.055, "dark"),),
    "lower_arm": (tube(0.042, -0.04, -0.10, "orange"), tube(0.030, -0.10, -0.29, "light")),
    "wrist_tilt": (tube(0.042, -0.048, 0.048, "dark"),),
    "wrist_pan": (tube(0.036, -0.03, -0.08, "orange"), tube(0.030, -0.08, -SENSOR_AT, "light")),
}

# Homogeneous solids that give each link its centre of mass (the link's middle) and its inertia.
SOLIDS: dict[str, Shape] = {
    "tower": Shape("box", (0.18, 0.09, 1.30), (0.0, 0.0, 0.60)),
    "lift": Shape("box", (0.12, 0.20, 0.20), (0.0, 0.02, 0.0)),
    "shoulder": Shape("cylinder", (0.05, 0.30), (0.0, 0.0, 0.20)),
    "upper_arm": Shape("cylinder", (0.045, 0.27), (0.0, 0.0, -0.135)),
    "elbow": Shape("cylinder", (0.05, 0.11)),
    "lower_arm": Shape("cylinder", (0.04, 0.30), (0.0, 0.0, -0.161)),
    "wrist_tilt": Shape("cylinder", (0.042, 0.10)),
    "wrist_pan": Shape("cylinder", (0.036, 0.11), (0.0, 0.0, -0.065)),
}


def mobile_manipulator(spec: RobotFile) -> Robot:
    """URDF of the whole robot; `base_link` is the ground projection of the wheel axis' middle."""
    if spec.platform is None:
        raise ValueError(f"robot {spec.name} has no [platform]")
    robot = Robot(spec.name, COLOURS)
    _add_platform(robot, spec.platform)
    plate = tube(0.12, -0.02, 0.0, "dark")
    robot.links.append(Link(spec.base_link, 1.0, plate, visuals=(plate,)))
    robot.joints.append(Joint("arm_base_joint", "fixed", "base_link", spec.base_link, spec.platform.arm_base))
    last, xyz, rpy = add_chain(robot, spec, _arm_body)
    _add_hand(robot, last, xyz, rpy)
    return robot


def _arm_body(row: JointRow) -> Link:
    solid = SOLIDS[row.link]
    return Link(row.link, row.mass, solid, row.rotor_inertia, LOOKS[row.link], (solid,))


def _add_platform(robot: Robot, platform: PlatformParameters) -> None:
    radius, half, deck = platform.wheel_radius, platform.track / 2, platform.arm_base[2]
    body = Shape("box", (0.62, 0.38, 0.16), (CENTRE_X, 0.0, CENTRE_Z))
    looks = (
        box((0.60, 0.38, 0.19), (0.16, 0.0, 0.185), "dark"),
        box((0.605, 0.385, 0.03), (0.16, 0.0, 0.235), "orange"),
        box((0.64, 0.42, 0.05), (0.16, 0.0, deck - 0.045), "light"),
        box((0.03, 0.30, 0.06), (0.465, 0.0, 0.15), "rubber"),
        Shape("cylinder", (0.035, 0.05), (0.42, 0.0, deck + 0.005), colour="blue"),
    )
    hull = box((0.62, 0.38, 0.23), (0.16, 0.0, 0.215), "dark")
    robot.links.append(Link("base_link", PLATFORM_MASS, body, visuals=looks, collisions=(hull,)))
    for name, y, joint in zip(("wheel_left", "wheel_right"), (half, -half), platform.wheel_joints, strict=True):
        tyre = Shape("cylinder", (radius, 0.04), rpy=(math.pi / 2, 0.0, 0.0), colour="rubber")
        hub = Shape("cylinder", (0.6 * radius, 0.045), rpy=(math.pi / 2, 0.0, 0.0), colour="grey")
        spoke = box((1.1 * radius, 0.048, 0.02), (0.0, 0.0, 0.0), "orange")  # so that one sees it turn
        # A sphere rolls exactly; cylinders are tessellated by PyBullet and roll too far.
        ball = Shape("sphere", (radius,))
        robot.links.append(Link(name, 2.5, tyre, 0.1, (tyre, hub, spoke), (ball,)))
        speed = (platform.velocity + platform.yaw_rate * half) / radius
        limit = (0.0, 0.0, platform.wheel_peak_effort, speed)
        robot.joints.append(
            Joint(joint, "continuous", "base_link", name, (0.0, y, radius), axis=(0.0, 1.0, 0.0), limit=limit)
        )
    roller = Shape("sphere", (CASTOR_RADIUS,), colour="rubber")
    fork = tube(0.03, CASTOR_RADIUS, 0.05 + CASTOR_RADIUS, "grey")
    robot.links.append(Link("castor", 1.5, roller, visuals=(roller, fork), collisions=(roller,)))
    robot.joints.append(Joint("castor_joint", "fixed", "base_link", "castor", (CASTOR_X, 0.0, CASTOR_RADIUS)))


def _add_hand(robot: Robot, last: str, tcp: Triple, tcp_rpy: Triple) -> None:
    sensor = tube(0.038, 0.0, -SENSOR_LENGTH, "red")
    robot.links.append(Link("force_sensor", 0.3, sensor, visuals=(sensor,), collisions=(sensor,)))
    robot.joints.append(Joint("force_sensor_joint", "fixed", last, "force_sensor", (0.0, 0.0, -SENSOR_AT)))
    palm = Shape("box", (0.10, 0.05, 0.06), (0.0, 0.0, -0.03), colour="dark")
    fingers = [box((0.012, 0.028, 0.12), (x, 0.0, -0.12), "grey") for x in (0.041, -0.041)]
    pads = [box((0.006, 0.024, 0.035), (x, 0.0, -0.16), "orange") for x in (0.033, -0.033)]
    solid = Shape("box", (0.10, 0.05, 0.14), (0.0, 0.0, -0.07))
    hull = Shape("box", (0.09, 0.04, 0.18), (0.0, 0.0, -0.09))
    robot.links.append(Link("gripper", 1.0, solid, visuals=(palm, *fingers, *pads), collisions=(hull,)))
    robot.joints.append(Joint("gripper_joint", "fixed", "force_sensor", "gripper", (0.0, 0.0, -SENSOR_LENGTH)))
    robot.links.append(tcp_link())
    reach = tcp[2] + SENSOR_AT + SENSOR_LENGTH
    robot.joints.append(Joint("tcp_joint", "fixed", "gripper", "tcp", (tcp[0], tcp[1], reach), tcp_rpy))
