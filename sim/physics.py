"""The robot in PyBullet: one step, what acts on it, and where everything is.

Settings and their reasons are measured ones: 1 kHz, deterministic pair order, no damping, no default motors, sphere
wheels that roll exactly. Only wheels and castor (and the gripper, if wanted) take part in collisions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim.bullet import pybullet, quiet
from sim.loading import (
    ARM,
    FLOOR,
    GRIPPER,
    OBJECTS,
    OBSTACLES,
    WHEELS,
    PhysicsParameters,
    RobotNames,
    load,
    solid,
)
from sim.rotation import cross, inverse, pose_of, quaternion_of
from stack.messages import Matrix, Vector

__all__ = ["ARM", "FLOOR", "GRIPPER", "OBJECTS", "OBSTACLES", "WHEELS", "Physics", "PhysicsParameters", "RobotNames"]

BRAKE_SHARE = 0.7
"""What a holding brake holds, of its motor's peak torque: 1.75 times the rated torque. One as strong as the motor stops a joint at
200 rad/s², and the next one gets what it had; one of half as much lets an arm whose motor is dead fall for half a second more."""


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
        try:
            self.load()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Disconnect; the object is of no further use. May be called again."""
        if self.client >= 0:
            pybullet.disconnect(self.client)
            self.client = -1

    def load(self) -> None:
        """Start again from an empty world: floor, robot at the origin, everything at zero and loose."""
        loaded = load(self.client, self.urdf, self.parameters, self.names)
        self.floor, self.robot, self.link = loaded.floor, loaded.robot, loaded.link
        self.wheel_joints, self.arm_joints = loaded.wheel_joints, loaded.arm_joints
        self.peak_torque, self.velocity_limit = loaded.peak_torque, loaded.velocity_limit
        self._drives = [*self.wheel_joints, *self.arm_joints]
        self.base_name: str = pybullet.getBodyInfo(self.robot, physicsClientId=self.client)[0].decode()
        inertial = pybullet.getDynamicsInfo(self.robot, -1, physicsClientId=self.client)
        self._base_from_com = inverse(pose_of(inertial[3], inertial[4]))
        self.com_from_base: Matrix = self._base_from_com
        """(4, 4): from the platform's reference frame to that of its centre of mass"""
        self._com_to_base = -np.array(inertial[3])
        self.q: Vector = np.zeros(len(self.arm_joints))
        self.dq: Vector = np.zeros(len(self.arm_joints))
        self.wheel_angle: Vector = np.zeros(2)
        self.wheel_rate: Vector = np.zeros(2)
        self._loose = [True] * len(self.arm_joints)
        self.grasps: list[int] = []
        self.external: Vector = np.zeros(6)
        """Force and torque about the TCP (world axes) that acted on the gripper in the last step, N and N·m."""
        self.touched = False
        self._pushed: Vector = np.zeros(6)
        self._push_pending = False
        self._hand: tuple[Any, ...] | None = None
        self.sense()

    def solid(self, link: str) -> tuple[float, Vector, Vector]:
        """Mass (kg), centre of mass in the link frame (3,), principal moments of inertia (3,) of a link."""
        return solid(self.client, self.robot, self.link[link])

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
        """Hold the arm joints (8,) where they are, with what a brake can hold, or leave them to their torque."""
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
                    force=BRAKE_SHARE * float(self.peak_torque[i]),
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
