"""Floor and robot into a PyBullet client, and what the URDF says of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.bullet import pybullet, quiet
from stack.messages import Vector

FLOOR, WHEELS, GRIPPER, OBSTACLES, ARM, OBJECTS = 1, 2, 4, 8, 16, 32
"""Collision groups. ARM: platform and links of the arm, which meet OBSTACLES (tables, walls, doors) and OBJECTS (what can be taken)."""


@dataclass(frozen=True)
class RobotNames:
    """Names in the URDF: child links of the wheel joints and arm joints, and the frames of the hand."""

    wheels: tuple[str, str] = ("wheel_left", "wheel_right")
    castor: str = "castor"
    arm: tuple[str, ...] = (
        "tower", "lift", "shoulder", "upper_arm", "elbow", "lower_arm", "wrist_tilt", "wrist_pan"
    )  # fmt: skip
    force_sensor: str = "force_sensor"
    gripper: str = "gripper"
    tcp: str = "tcp"


@dataclass(frozen=True)
class PhysicsParameters:
    """Settings of the physics; the defaults are those that were measured to be right and fast."""

    step_s: float = 1e-3
    solver_iterations: int = 50
    braked_iterations: int = 200
    """while a brake is closed: braked joints are constraints, and the solver takes longer to agree on them"""
    solver_residual: float = 1e-11
    """(m/s)²: the solver stops early below it; at 1e-9 a parked robot creeps ten times as fast"""
    gravity: float = 9.81
    wheel_friction: float = 0.9
    floor_friction: float = 1.0
    gripper_touches: bool = False
    """whether the gripper collides with floor and obstacles"""
    links_touch: bool = False
    """whether platform and links of the arm collide with obstacles and objects"""
    gripper_friction: float = 0.5
    grasp_force: float = 300.0
    """N, the most that a grasp holds"""


@dataclass(frozen=True)
class Loaded:
    """Body ids and link indices of what was loaded."""

    floor: int
    robot: int
    link: dict[str, int]
    """PyBullet's index of each link by name; its joint has the same"""
    wheel_joints: tuple[int, ...]
    arm_joints: tuple[int, ...]
    peak_torque: Vector
    """effort limits of the arm joints (n,), N·m or N"""
    velocity_limit: Vector
    """velocity limits of the arm joints (n,), rad/s or m/s"""


def load(client: int, urdf: Path, parameters: PhysicsParameters, names: RobotNames) -> Loaded:
    """Empty the client's world and load floor and robot: robot at the origin, everything at zero and loose.

    Raises ValueError if a link of `names` is not in the URDF.
    """
    p = pybullet
    p.resetSimulation(physicsClientId=client)
    p.setPhysicsEngineParameter(
        fixedTimeStep=parameters.step_s,
        numSolverIterations=parameters.solver_iterations,
        solverResidualThreshold=parameters.solver_residual,
        numSubSteps=0,
        deterministicOverlappingPairs=1,
        physicsClientId=client,
    )
    p.setGravity(0.0, 0.0, -parameters.gravity, physicsClientId=client)
    plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
    floor = p.createMultiBody(0.0, plane, physicsClientId=client)
    p.changeDynamics(floor, -1, lateralFriction=parameters.floor_friction, physicsClientId=client)
    p.setCollisionFilterGroupMask(floor, -1, FLOOR, WHEELS | GRIPPER | OBSTACLES | OBJECTS, physicsClientId=client)
    with quiet():
        robot = p.loadURDF(str(urdf), flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    joints = [
        p.getJointInfo(robot, i, physicsClientId=client) for i in range(p.getNumJoints(robot, physicsClientId=client))
    ]
    link = {info[12].decode(): i for i, info in enumerate(joints)}
    wanted = (*names.wheels, names.castor, *names.arm, names.force_sensor, names.gripper, names.tcp)
    missing = [name for name in wanted if name not in link]
    if missing:
        raise ValueError(f"{urdf} has no link {', '.join(missing)}; it has {', '.join(link)}")
    loaded = Loaded(
        floor,
        robot,
        link,
        tuple(link[name] for name in names.wheels),
        tuple(link[name] for name in names.arm),
        np.array([joints[link[name]][10] for name in names.arm]),
        np.array([joints[link[name]][11] for name in names.arm]),
    )
    _free_joints(client, robot, len(joints), (*loaded.wheel_joints, *loaded.arm_joints))
    _set_contacts(client, loaded, parameters, names)
    return loaded


def _free_joints(client: int, robot: int, count: int, drives: Sequence[int]) -> None:
    p = pybullet
    for index in range(-1, count):
        p.changeDynamics(robot, index, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client)
    for joint in drives:  # each starts with a motor of 1000 N·m
        p.setJointMotorControl2(robot, joint, p.VELOCITY_CONTROL, force=0.0, physicsClientId=client)


def _set_contacts(client: int, loaded: Loaded, parameters: PhysicsParameters, names: RobotNames) -> None:
    p, robot = pybullet, loaded.robot
    for index in range(-1, len(loaded.link)):
        p.changeDynamics(
            robot,
            index,
            lateralFriction=parameters.wheel_friction if index in loaded.wheel_joints else 0.0,
            rollingFriction=0.0,
            spinningFriction=0.0,
            restitution=0.0,
            physicsClientId=client,
        )
        p.setCollisionFilterGroupMask(robot, index, 0, 0, physicsClientId=client)
    for name in (*names.wheels, names.castor):
        p.setCollisionFilterGroupMask(robot, loaded.link[name], WHEELS, FLOOR, physicsClientId=client)
    if parameters.links_touch:
        for index in (-1, *(loaded.link[name] for name in (*names.arm, names.force_sensor))):
            p.setCollisionFilterGroupMask(robot, index, ARM, OBSTACLES | OBJECTS, physicsClientId=client)
    if parameters.gripper_touches:
        gripper = loaded.link[names.gripper]
        p.setCollisionFilterGroupMask(robot, gripper, GRIPPER, FLOOR | OBSTACLES, physicsClientId=client)
        p.changeDynamics(robot, gripper, lateralFriction=parameters.gripper_friction, physicsClientId=client)


def solid(client: int, robot: int, link: int) -> tuple[float, Vector, Vector]:
    """Mass (kg), centre of mass in the link frame (3,), principal moments of inertia (3,) of a link.

    Raises ValueError if the principal axes are not those of the link.
    """
    info: tuple[Any, ...] = pybullet.getDynamicsInfo(robot, link, physicsClientId=client)
    if not np.allclose(info[4], (0.0, 0.0, 0.0, 1.0)):
        raise ValueError(f"link {link}: inertia is turned against the link frame, which is not supported")
    return float(info[0]), np.array(info[3]), np.array(info[2])
