"""What stands around: tables and walls, which nothing moves, and objects that a gripper can take."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim.bullet import pybullet
from sim.grasping import GraspPoint
from sim.physics import ARM, FLOOR, GRIPPER, OBJECTS, OBSTACLES, Physics
from sim.rotation import pose_of
from stack.messages import Matrix

Triple = tuple[float, float, float]
_LEG = 0.05
"""m, thickness of a table's legs"""


@dataclass(frozen=True)
class Block:
    """A box: full lengths `size` and its middle `at`, in the frame of what it belongs to (m)."""

    size: Triple
    at: Triple


@dataclass(frozen=True)
class Obstacle:
    """Boxes that stand still; `position` x, y (m) on the floor and `heading` (rad) place their common frame."""

    name: str
    blocks: tuple[Block, ...]
    position: tuple[float, float]
    heading: float = 0.0
    friction: float = 0.6

    @classmethod
    def table(
        cls, name: str, size: Triple, position: tuple[float, float], heading: float = 0.0, top: float = 0.03
    ) -> Obstacle:
        """A table with a top of thickness `top` and four legs; `size`: length, width, height (m)."""
        x, y, z = size
        legs = tuple(
            Block((_LEG, _LEG, z - top), (sx * (x - _LEG) / 2, sy * (y - _LEG) / 2, (z - top) / 2))
            for sx in (-1, 1)
            for sy in (-1, 1)
        )
        return cls(name, (Block((x, y, top), (0.0, 0.0, z - top / 2)), *legs), position, heading)

    @classmethod
    def wall(cls, name: str, size: Triple, position: tuple[float, float], heading: float = 0.0) -> Obstacle:
        """A box of `size` (m) that stands on the floor."""
        return cls(name, (Block(size, (0.0, 0.0, size[2] / 2)),), position, heading)

    def pose(self) -> Matrix:
        """Pose (4, 4) of the common frame in the world."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        pose = np.eye(4)
        pose[:2, :2] = (c, -s), (s, c)
        pose[:2, 3] = self.position
        return pose


class ObjectShape:
    """Names of the shapes of objects."""

    BOX = "box"
    CYLINDER = "cylinder"


@dataclass(frozen=True)
class ObjectParameters:
    """Something to take: a box (x, y, z) or an upright cylinder (diameter, diameter, height), in m."""

    name: str
    shape: str
    size: Triple
    position: Triple
    """middle of its underside in the world, m"""
    heading: float = 0.0
    mass: float = 0.3
    friction: float = 0.6

    def __post_init__(self) -> None:
        if min(self.size) <= 0.0 or self.mass <= 0.0 or self.friction < 0.0:
            raise ValueError(
                f"object {self.name}: size {self.size}, mass {self.mass} must be positive, friction too or 0"
            )
        if self.shape not in (ObjectShape.BOX, ObjectShape.CYLINDER):
            raise ValueError(f"object {self.name}: shape = {self.shape!r}: must be 'box' or 'cylinder'")

    def pose(self) -> Matrix:
        """Pose (4, 4) of its middle in the world at the start."""
        x, y, z = self.position
        c, s = math.cos(self.heading), math.sin(self.heading)
        pose = np.eye(4)
        pose[:2, :2] = (c, -s), (s, c)
        pose[:3, 3] = x, y, z + self.size[2] / 2
        return pose

    @property
    def moments(self) -> tuple[float, float, float]:
        """Principal moments of inertia, kg·m²."""
        x, y, z = self.size
        if self.shape == ObjectShape.BOX:
            return (
                self.mass * (y * y + z * z) / 12,
                self.mass * (x * x + z * z) / 12,
                self.mass * (x * x + y * y) / 12,
            )
        across = self.mass * (3 * (x / 2) ** 2 + z * z) / 12
        return across, across, self.mass * (x / 2) ** 2 / 2


def add_obstacle(physics: Physics, obstacle: Obstacle) -> int:
    """The obstacle's body id."""
    p, client = pybullet, physics.client
    shapes = p.createCollisionShapeArray(
        [p.GEOM_BOX] * len(obstacle.blocks),
        halfExtents=[[0.5 * side for side in block.size] for block in obstacle.blocks],
        collisionFramePositions=[list(block.at) for block in obstacle.blocks],
        physicsClientId=client,
    )
    body: int = p.createMultiBody(
        0.0,
        shapes,
        basePosition=[*obstacle.position, 0.0],
        baseOrientation=[0.0, 0.0, math.sin(obstacle.heading / 2), math.cos(obstacle.heading / 2)],
        physicsClientId=client,
    )
    p.changeDynamics(body, -1, lateralFriction=obstacle.friction, restitution=0.0, physicsClientId=client)
    p.setCollisionFilterGroupMask(body, -1, OBSTACLES, GRIPPER | ARM | OBJECTS, physicsClientId=client)
    return body


class Object:
    """One thing to take, in the physics."""

    def __init__(self, physics: Physics, parameters: ObjectParameters) -> None:
        self.parameters = parameters
        self._physics = physics
        p, client = pybullet, physics.client
        x, y, z = parameters.size
        if parameters.shape == ObjectShape.BOX:
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[x / 2, y / 2, z / 2], physicsClientId=client)
        else:
            shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=x / 2, height=z, physicsClientId=client)
        px, py, pz = parameters.position
        heading = parameters.heading
        self.body: int = p.createMultiBody(
            parameters.mass,
            shape,
            basePosition=[px, py, pz + z / 2],
            baseOrientation=[0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)],
            physicsClientId=client,
        )
        p.changeDynamics(
            self.body,
            -1,
            localInertiaDiagonal=parameters.moments,
            lateralFriction=parameters.friction,
            spinningFriction=0.0,
            rollingFriction=0.0,
            restitution=0.0,
            linearDamping=0.0,
            angularDamping=0.0,
            physicsClientId=client,
        )
        p.setCollisionFilterGroupMask(self.body, -1, OBJECTS, OBSTACLES | ARM | FLOOR | OBJECTS, physicsClientId=client)
        self.grasp_point = GraspPoint(
            parameters.name,
            self.body,
            -1,
            np.zeros(3),
            half_length=max(0.5 * z - 0.01, 0.0),
            mass=parameters.mass,
            inertia=min(parameters.moments),
        )

    def pose(self) -> Matrix:
        """Pose (4, 4) of its middle in the world."""
        position, quaternion = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self._physics.client)
        return pose_of(position, quaternion)
