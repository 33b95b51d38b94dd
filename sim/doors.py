"""Doors: a panel on a hinge, or on rails, as bodies and joints of the physics, with a bar to pull at.

A hand pulls on the side to which a hinged door opens. Friction is Coulomb's, a row of the solver; closer, catch and damping are torques.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np

from sim.bullet import pybullet, quiet
from sim.door_parameters import DoorParameters, HandleGrasp
from sim.grasping import GraspPoint
from sim.physics import ARM, GRIPPER, OBSTACLES, Physics
from sim.rotation import inverse, pose_of
from stack.messages import Matrix

LIMIT_FORCE = 5000.0


class Door:
    """One door in the physics. `position`, `rate`: how far it is open, and how fast it opens (rad or m, per s)."""

    def __init__(self, physics: Physics, parameters: DoorParameters) -> None:
        self.parameters = parameters
        self.position = parameters.start
        self.rate = 0.0
        self._physics = physics
        self.body = _load(physics, parameters)
        client, p = physics.client, pybullet
        for link in (-1, 0):
            p.changeDynamics(
                self.body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, physicsClientId=client
            )
            p.changeDynamics(
                self.body,
                link,
                lateralFriction=0.3,
                rollingFriction=0.0,
                spinningFriction=0.0,
                restitution=0.0,
                physicsClientId=client,
            )
        p.setCollisionFilterGroupMask(self.body, -1, 0, 0, physicsClientId=client)
        p.setCollisionFilterGroupMask(self.body, 0, OBSTACLES, GRIPPER | ARM, physicsClientId=client)
        p.resetJointState(self.body, 0, parameters.start, physicsClientId=client)
        p.setJointMotorControl2(
            self.body,
            0,
            p.VELOCITY_CONTROL,
            targetVelocity=0.0,
            force=parameters.friction,
            physicsClientId=client,
        )
        inertial = p.getDynamicsInfo(self.body, 0, physicsClientId=client)
        self._panel_from_inertial = inverse(pose_of(inertial[3], inertial[4]))
        bar = np.array([*parameters.bar(), 1.0])
        local = self._panel_from_inertial @ bar
        turn = self._panel_from_inertial[:3, :3]
        bar_axis = turn @ np.array([0.0, 0.0, 1.0])
        self.handle = GraspPoint(
            "door handle",
            self.body,
            0,
            local[:3],
            along=bar_axis,
            half_length=parameters.bar_length / 2,
            axis=bar_axis if parameters.grasp is HandleGrasp.PIVOT else None,
            mass=parameters.mass / 3.0 if parameters.hinged else parameters.mass,
        )

    def act(self) -> None:
        """Before a step: closer, catch and damping."""
        here, client, p = self.parameters, self._physics.client, pybullet
        self.position, self.rate = p.getJointState(self.body, 0, physicsClientId=client)[:2]
        torque = -here.damping * self.rate - here.closer_stiffness * self.position - here.closer_preload
        if here.catch and 0.0 < self.position < here.catch_width:
            torque -= here.catch * math.sin(math.pi * self.position / here.catch_width)
        if torque:
            p.setJointMotorControl2(self.body, 0, p.TORQUE_CONTROL, force=torque, physicsClientId=client)

    def sense(self) -> None:
        """Read how far it is open."""
        state = pybullet.getJointState(self.body, 0, physicsClientId=self._physics.client)
        self.position, self.rate = state[0], state[1]

    def pose(self) -> Matrix:
        """Pose (4, 4) in the world of the frame that goes with the panel."""
        state = pybullet.getLinkState(self.body, 0, computeForwardKinematics=1, physicsClientId=self._physics.client)
        return pose_of(state[4], state[5])

    def axes(self) -> Matrix:
        """Directions (3, 3) as columns, world: along the way of the handle (to open), across it (from the hinge, to the hand), up."""
        turn = self.pose()[:3, :3]
        if self.parameters.hinged:
            return np.column_stack([self.parameters.side * turn[:, 1], turn[:, 0], turn[:, 2]])
        return np.column_stack([turn[:, 0], self.parameters.side * turn[:, 1], turn[:, 2]])


def _load(physics: Physics, parameters: DoorParameters) -> int:
    pose = parameters.frame()
    heading = math.atan2(pose[1, 0], pose[0, 0])
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "door.urdf"
        path.write_text(_urdf(parameters), encoding="ascii")
        with quiet():
            body: int = pybullet.loadURDF(
                str(path),
                basePosition=pose[:3, 3].tolist(),
                baseOrientation=[0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)],
                useFixedBase=True,
                flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=physics.client,
            )
    return body


def _urdf(parameters: DoorParameters) -> str:
    (x, y, z), centre = parameters.panel()
    mass = parameters.mass
    moments = (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)
    kind, axis = ("revolute", f"0 0 {parameters.side}") if parameters.hinged else ("prismatic", "1 0 0")
    inertia = " ".join(f'i{pair}="{value!r}"' for pair, value in zip(("xx", "yy", "zz"), moments, strict=True))
    placed = f'<origin xyz="{centre[0]!r} {centre[1]!r} {centre[2]!r}"/>'
    return f"""<robot name="door"><link name="frame"/>
<link name="panel">
<inertial>{placed}<mass value="{mass!r}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial>
<collision>{placed}<geometry><box size="{x!r} {y!r} {z!r}"/></geometry></collision>
</link>
<joint name="way" type="{kind}"><parent link="frame"/><child link="panel"/><axis xyz="{axis}"/>
<limit lower="0" upper="{parameters.travel!r}" effort="{LIMIT_FORCE}" velocity="100"/></joint></robot>
"""
