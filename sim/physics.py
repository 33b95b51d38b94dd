"""The robot in PyBullet: loading, one step, what acts on it, and where everything is.

Settings and their reasons are measured ones: 1 kHz, deterministic pair order, no damping, no default motors, sphere
wheels that roll exactly. Only wheels and castor (and the gripper, if wanted) take part in collisions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim.bullet import pybullet, quiet
from sim.rotation import cross, inverse, pose_of, quaternion_of
from stack.messages import Matrix, Vector

FLOOR, WHEELS, GRIPPER, OBSTACLES = 1, 2, 4, 8
"""Collision groups; a door that the gripper shall be able to hit belongs to OBSTACLES with mask GRIPPER."""


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
    grasp_force: float = 300.0
    """N, the most that a grasp holds"""


class Physics:
    """One PyBullet client with a floor and the robot on it. `close()` frees the client."""

    def __init__(self, urdf: Path, parameters: PhysicsParameters, names: RobotNames) -> None:
        if not urdf.is_file():
            raise FileNotFoundError(f"no robot description at {urdf}")
        self.parameters = parameters
        self.names = names
        self.urdf = urdf
        with quiet():
            self.client: int = pybullet.connect(pybullet.DIRECT)
        self.load()

    def close(self) -> None:
        """Disconnect; the object is of no further use. May be called again."""
        if self.client >= 0:
            pybullet.disconnect(self.client)
            self.client = -1

    # --- loading -----------------------------------------------------------------------------------------------------

    def load(self) -> None:
        """Start again from an empty world: floor, robot at the origin, everything at zero and loose."""
        p, client, settings = pybullet, self.client, self.parameters
        p.resetSimulation(physicsClientId=client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=settings.step_s,
            numSolverIterations=settings.solver_iterations,
            solverResidualThreshold=settings.solver_residual,
            numSubSteps=0,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        p.setGravity(0.0, 0.0, -settings.gravity, physicsClientId=client)
        plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
        self.floor: int = p.createMultiBody(0.0, plane, physicsClientId=client)
        p.changeDynamics(self.floor, -1, lateralFriction=settings.floor_friction, physicsClientId=client)
        p.setCollisionFilterGroupMask(self.floor, -1, FLOOR, WHEELS | GRIPPER | OBSTACLES, physicsClientId=client)
        with quiet():
            self.robot: int = p.loadURDF(str(self.urdf), flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        self._index_links()
        self._free_joints()
        self._set_contacts()
        inertial = p.getDynamicsInfo(self.robot, -1, physicsClientId=client)
        self._base_from_com = inverse(pose_of(inertial[3], inertial[4]))
        self._com_to_base = -np.array(inertial[3])
        self.grasps: list[int] = []
        self.external: Vector = np.zeros(6)
        """Force and torque about the TCP (world axes) that acted on the gripper in the last step, N and N·m."""
        self.touched = False
        self._pushed: Vector = np.zeros(6)
        self._push_pending = False
        self._hand: tuple[Any, ...] | None = None
        self.sense()

    def _index_links(self) -> None:
        p, names = pybullet, self.names
        self.link: dict[str, int] = {}
        self._info: dict[str, tuple[Any, ...]] = {}
        for index in range(p.getNumJoints(self.robot, physicsClientId=self.client)):
            info = p.getJointInfo(self.robot, index, physicsClientId=self.client)
            self.link[info[12].decode()] = index
            self._info[info[12].decode()] = info
        wanted = (*names.wheels, names.castor, *names.arm, names.force_sensor, names.gripper, names.tcp)
        missing = [name for name in wanted if name not in self.link]
        if missing:
            raise ValueError(f"{self.urdf} has no link {', '.join(missing)}; it has {', '.join(self.link)}")
        self.wheel_joints = [self.link[name] for name in names.wheels]
        self.arm_joints = [self.link[name] for name in names.arm]
        self._drives = self.wheel_joints + self.arm_joints
        self.q: Vector = np.zeros(len(self.arm_joints))
        self.dq: Vector = np.zeros(len(self.arm_joints))
        self.wheel_angle: Vector = np.zeros(2)
        self.wheel_rate: Vector = np.zeros(2)
        self._loose = [True] * len(self.arm_joints)

    def _free_joints(self) -> None:
        p = pybullet
        for index in range(-1, len(self.link)):
            p.changeDynamics(
                self.robot, index, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=self.client
            )
        for joint in self._drives:  # each starts with a motor of 1000 N·m
            p.setJointMotorControl2(self.robot, joint, p.VELOCITY_CONTROL, force=0.0, physicsClientId=self.client)

    def _set_contacts(self) -> None:
        p, names, settings = pybullet, self.names, self.parameters
        for index in range(-1, len(self.link)):
            p.changeDynamics(
                self.robot,
                index,
                lateralFriction=settings.wheel_friction if index in self.wheel_joints else 0.0,
                rollingFriction=0.0,
                spinningFriction=0.0,
                restitution=0.0,
                physicsClientId=self.client,
            )
            p.setCollisionFilterGroupMask(self.robot, index, 0, 0, physicsClientId=self.client)
        for name in (*names.wheels, names.castor):
            p.setCollisionFilterGroupMask(self.robot, self.link[name], WHEELS, FLOOR, physicsClientId=self.client)
        if settings.gripper_touches:
            gripper = self.link[names.gripper]
            p.setCollisionFilterGroupMask(self.robot, gripper, GRIPPER, FLOOR | OBSTACLES, physicsClientId=self.client)
            p.changeDynamics(self.robot, gripper, lateralFriction=0.5, physicsClientId=self.client)

    # --- what the URDF says ------------------------------------------------------------------------------------------

    @property
    def peak_torque(self) -> Vector:
        """Effort limits of the arm joints (8,), N·m or N."""
        return np.array([self._info[name][10] for name in self.names.arm])

    @property
    def velocity_limit(self) -> Vector:
        """Velocity limits of the arm joints (8,), rad/s or m/s."""
        return np.array([self._info[name][11] for name in self.names.arm])

    def solid(self, link: str) -> tuple[float, Vector, Vector]:
        """Mass (kg), centre of mass in the link frame (3,), principal moments of inertia (3,) of a link.

        Raises ValueError if the principal axes are not those of the link.
        """
        info = pybullet.getDynamicsInfo(self.robot, self.link[link], physicsClientId=self.client)
        if not np.allclose(info[4], (0.0, 0.0, 0.0, 1.0)):
            raise ValueError(f"link {link}: inertia is turned against the link frame, which is not supported")
        return float(info[0]), np.array(info[3]), np.array(info[2])

    # --- placing -----------------------------------------------------------------------------------------------------

    def place(self, pose_WB: Matrix, q: Sequence[float]) -> None:
        """Put the robot's base frame at `pose_WB` (4, 4) and its arm at `q` (8,), all at rest."""
        p = pybullet
        com = pose_WB @ inverse(self._base_from_com)
        quaternion = quaternion_of(com[:3, :3])
        p.resetBasePositionAndOrientation(self.robot, com[:3, 3].tolist(), quaternion, physicsClientId=self.client)
        p.resetBaseVelocity(self.robot, [0.0] * 3, [0.0] * 3, physicsClientId=self.client)
        for joint, angle in zip(self.arm_joints, q, strict=True):
            p.resetJointState(self.robot, joint, float(angle), physicsClientId=self.client)
        for joint in self.wheel_joints:
            p.resetJointState(self.robot, joint, 0.0, physicsClientId=self.client)
        self.sense()

    # --- actuation ---------------------------------------------------------------------------------------------------

    def set_brakes(self, engaged: Sequence[bool]) -> None:
        """Hold the arm joints (8,) where they are, with their effort limit, or leave them to their torque."""
        p = pybullet
        for i, joint in enumerate(self.arm_joints):
            if self._loose[i] != bool(engaged[i]):
                continue
            self._loose[i] = not engaged[i]
            if engaged[i]:
                p.setJointMotorControl2(
                    self.robot,
                    joint,
                    p.POSITION_CONTROL,
                    targetPosition=float(self.q[i]),
                    targetVelocity=0.0,
                    force=float(self.peak_torque[i]),
                    physicsClientId=self.client,
                )
            else:
                p.setJointMotorControl2(self.robot, joint, p.VELOCITY_CONTROL, force=0.0, physicsClientId=self.client)
        braked = not all(self._loose)
        p.setPhysicsEngineParameter(
            numSolverIterations=self.parameters.braked_iterations if braked else self.parameters.solver_iterations,
            physicsClientId=self.client,
        )

    def set_torques(self, wheels: Vector, arm: Vector) -> None:
        """Torques of the wheels (2,) and the arm joints (8,) for the coming step; closed brakes stay closed."""
        joints, forces = self._drives, [*wheels.tolist(), *arm.tolist()]
        if not all(self._loose):
            free = [True, True, *self._loose]
            joints = [joint for joint, loose in zip(joints, free, strict=True) if loose]
            forces = [force for force, loose in zip(forces, free, strict=True) if loose]
        pybullet.setJointMotorControlArray(
            self.robot, joints, pybullet.TORQUE_CONTROL, forces=forces, physicsClientId=self.client
        )

    def push(self, force: Vector, torque: Vector | None = None) -> None:
        """Let `force` (3,) N act at the TCP, and `torque` (3,) N·m, in world axes, over the coming step."""
        p, tcp = pybullet, self.link[self.names.tcp]
        at = self.hand()[4]
        p.applyExternalForce(self.robot, tcp, list(force), at, p.WORLD_FRAME, physicsClientId=self.client)
        self._push_pending = True
        self._pushed[:3] += force
        if torque is not None:
            p.applyExternalTorque(self.robot, tcp, list(torque), p.WORLD_FRAME, physicsClientId=self.client)
            self._pushed[3:] += torque

    def grasp(self, body: int, link: int, pivot: Sequence[float]) -> int:
        """Tie the TCP to the point `pivot` (in the inertial frame of that link of `body`); the constraint's id."""
        p = pybullet
        constraint: int = p.createConstraint(
            self.robot,
            self.link[self.names.tcp],
            body,
            link,
            p.JOINT_POINT2POINT,
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            list(pivot),
            physicsClientId=self.client,
        )
        p.changeConstraint(constraint, maxForce=self.parameters.grasp_force, physicsClientId=self.client)
        self.grasps.append(constraint)
        return constraint

    def release(self, constraint: int) -> None:
        """Undo a grasp."""
        pybullet.removeConstraint(constraint, physicsClientId=self.client)
        self.grasps.remove(constraint)

    # --- the step ----------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """stepSimulation and nothing else; the place to put a stop watch around."""
        pybullet.stepSimulation(physicsClientId=self.client)

    def sense(self) -> None:
        """Read joint states and loads after a step into q, dq, wheel_angle, wheel_rate, external."""
        states = pybullet.getJointStates(self.robot, self._drives, physicsClientId=self.client)
        left, right = states[0], states[1]
        self.wheel_angle[0], self.wheel_angle[1] = left[0], right[0]
        self.wheel_rate[0], self.wheel_rate[1] = left[1], right[1]
        arm = states[2:]
        self.q[:] = [state[0] for state in arm]
        self.dq[:] = [state[1] for state in arm]
        self._hand = None
        if self.grasps or self.touched or self.parameters.gripper_touches or self._push_pending:
            self._sense_loads()

    def _sense_loads(self) -> None:
        p = pybullet
        self.external[:] = self._pushed
        self._pushed[:] = 0.0
        self._push_pending = False
        for constraint in self.grasps:
            on_other = p.getConstraintState(constraint, physicsClientId=self.client)  # world axes
            self.external[:3] -= on_other[:3]
        if self.parameters.gripper_touches:
            tcp = np.array(self.hand()[4])
            gripper = self.link[self.names.gripper]
            for contact in p.getContactPoints(bodyA=self.robot, linkIndexA=gripper, physicsClientId=self.client):
                force = (
                    contact[9] * np.array(contact[7])
                    + contact[10] * np.array(contact[11])
                    + contact[12] * np.array(contact[13])
                )
                self.external[:3] += force
                self.external[3:] += cross(np.array(contact[5]) - tcp, force)
        self.touched = bool(self.external.any())

    # --- where everything is -----------------------------------------------------------------------------------------

    def hand(self) -> tuple[Any, ...]:
        """PyBullet's state of the TCP link, never stale: [4] position, [5] quaternion, [6], [7] velocities (world)."""
        if self._hand is None:
            self._hand = pybullet.getLinkState(
                self.robot,
                self.link[self.names.tcp],
                computeLinkVelocity=1,
                computeForwardKinematics=1,
                physicsClientId=self.client,
            )
        return self._hand

    def pose_WE(self) -> Matrix:
        """Pose of the TCP in the world (4, 4)."""
        state = self.hand()
        return pose_of(state[4], state[5])

    def link_pose(self, link: str) -> Matrix:
        """Pose of a link's frame in the world (4, 4)."""
        state = pybullet.getLinkState(
            self.robot, self.link[link], computeForwardKinematics=1, physicsClientId=self.client
        )
        return pose_of(state[4], state[5])

    def pose_WB(self) -> Matrix:
        """Pose of the platform's reference frame (base_link) in the world (4, 4)."""
        position, quaternion = pybullet.getBasePositionAndOrientation(self.robot, physicsClientId=self.client)
        return pose_of(position, quaternion) @ self._base_from_com

    def base_twist(self, pose_WB: Matrix) -> Vector:
        """Forward speed (m/s) and yaw rate (rad/s) of the platform's reference point over ground (2,)."""
        linear, angular = pybullet.getBaseVelocity(self.robot, physicsClientId=self.client)
        velocity = np.array(linear) + cross(angular, pose_WB[:3, :3] @ self._com_to_base)
        return np.array([velocity @ pose_WB[:3, 0], np.array(angular) @ pose_WB[:3, 2]])

    def floor_loads(self) -> Vector:
        """Normal forces on left wheel, right wheel, castor (3,), N."""
        loads = np.zeros(3)
        links = [*self.wheel_joints, self.link[self.names.castor]]
        for contact in pybullet.getContactPoints(self.robot, self.floor, physicsClientId=self.client):
            if contact[3] in links:
                loads[links.index(contact[3])] += contact[9]
        return loads
