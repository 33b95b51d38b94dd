"""What a hand can close around, and the soft pads between a hand and what it holds.

The pads are a spring and damper between two points and, more softly, between two orientations. They act on both bodies with equal and
opposite wrenches, so the robot's force sensor reads what really passes through the hand. A rigid constraint of the solver would do
neither: its reaction jumps with every step, and a position-controlled arm against a rigid door has no force that could be controlled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim.bullet import pybullet
from sim.physics import Physics
from sim.rotation import cross, pose_of, rotation_vector_of
from stack.messages import Matrix, Vector

_HAND_MASS = 1.0
"""kg and kg·m²: what of the arm a fast blow at the hand has to move, for the pads' damping."""
_HAND_INERTIA = 0.02


@dataclass(frozen=True)
class GraspPoint:
    """A place on a body that a hand can close around. Vectors are in the inertial frame of that link (-1: the base).

    `axis`: of a bar that the hand may turn about, None where what is held turns with the hand. `half_length` (m): how far from `at` along
    `along` the hand may hold it. `mass`, `inertia`: what moves when it is pushed there, for the damping of the pads.
    """

    name: str
    body: int
    link: int
    at: Vector
    along: Vector = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    half_length: float = 0.0
    axis: Vector | None = None
    mass: float = math.inf
    inertia: float = math.inf

    def state(self, client: int) -> tuple[Matrix, Vector, Vector]:
        """Pose (4, 4) of the inertial frame, velocity of its origin (3,) and angular velocity (3,), world axes."""
        p = pybullet
        if self.link < 0:
            position, quaternion = p.getBasePositionAndOrientation(self.body, physicsClientId=client)
            linear, angular = p.getBaseVelocity(self.body, physicsClientId=client)
        else:
            state: tuple[Any, ...] = p.getLinkState(
                self.body, self.link, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=client
            )
            position, quaternion, linear, angular = state[0], state[1], state[6], state[7]
        return pose_of(position, quaternion), np.array(linear), np.array(angular)

    def nearest(self, client: int, point: Vector) -> tuple[Vector, float]:
        """The place (3,), in the inertial frame, that is nearest to a `point` (3,) of the world, and how far that is (m)."""
        pose, _, _ = self.state(client)
        local = pose[:3, :3].T @ (point - pose[:3, 3])
        way = float(np.clip((local - self.at) @ self.along, -self.half_length, self.half_length))
        place = self.at + way * self.along
        return place, float(np.linalg.norm(local - place))


@dataclass(frozen=True)
class PadParameters:
    """Rubber between fingers and what they hold."""

    stiffness: float = 20_000.0
    """N/m"""
    turning_stiffness: float = 40.0
    """N·m/rad"""
    damping_ratio: float = 0.7
    strength: float = 300.0
    """N, beyond which it slips out of the hand"""

    def __post_init__(self) -> None:
        for name in ("stiffness", "turning_stiffness", "strength"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"pads: {name} = {getattr(self, name)}: must be positive")


class Hold:
    """A hand that has closed around something, at rest where it closed."""

    def __init__(self, physics: Physics, point: GraspPoint, place: Vector, parameters: PadParameters) -> None:
        self.point = point
        self.force: Vector = np.zeros(3)
        """Force on what is held over the coming step (3,), N, world axes."""
        self._physics = physics
        self._parameters = parameters
        self._place = place
        pose, _, _ = point.state(physics.client)
        hand = physics.pose_WE()
        rotation = hand[:3, :3]
        self._in_hand = rotation.T @ (pose[:3, :3] @ place + pose[:3, 3] - hand[:3, 3])
        self._turned = rotation.T @ pose[:3, :3]
        self._axis_in_hand = None if point.axis is None else self._turned @ point.axis
        mass = 1.0 / (1.0 / _HAND_MASS + 1.0 / point.mass)
        inertia = 1.0 / (1.0 / _HAND_INERTIA + 1.0 / point.inertia)
        step_s = physics.parameters.step_s
        self._stiffness = min(parameters.stiffness, mass * (_FASTEST / step_s) ** 2)
        self._turning = min(parameters.turning_stiffness, inertia * (_FASTEST / step_s) ** 2)
        self._damping = 2.0 * parameters.damping_ratio * math.sqrt(self._stiffness * mass)
        self._turning_damping = 2.0 * parameters.damping_ratio * math.sqrt(self._turning * inertia)

    def act(self) -> bool:
        """Push both bodies over the coming step. False: more than the hand can hold, nothing is pushed."""
        physics, point, p = self._physics, self.point, pybullet
        pose, velocity, spin = point.state(physics.client)
        hand = physics.hand()
        position, hand_velocity, hand_spin = np.array(hand[4]), np.array(hand[6]), np.array(hand[7])
        rotation = physics.pose_WE()[:3, :3]
        lever = pose[:3, :3] @ self._place
        held = pose[:3, 3] + lever
        in_hand = rotation @ self._in_hand
        rate = hand_velocity + cross(hand_spin, in_hand) - velocity - cross(spin, lever)
        force = self._stiffness * (position + in_hand - held) + self._damping * rate
        if float(force @ force) > self._parameters.strength**2:
            return False
        torque = self._torque(rotation, pose[:3, :3], hand_spin - spin)
        self.force = force
        at, client = held.tolist(), physics.client
        p.applyExternalForce(point.body, point.link, force.tolist(), at, p.WORLD_FRAME, physicsClientId=client)
        p.applyExternalTorque(point.body, point.link, torque.tolist(), p.WORLD_FRAME, physicsClientId=client)
        physics.push(-force, -torque - cross(held - position, force))
        return True

    def _torque(self, rotation: Matrix, held: Matrix, spin: Vector) -> Vector:
        """Torque (3,) on what is held: towards the orientation that it was grasped in, about the bar's axis none."""
        if self._axis_in_hand is None:
            turned = rotation @ self._turned @ held.T
            return self._turning * rotation_vector_of(turned) + self._turning_damping * spin
        assert self.point.axis is not None
        axis = held @ self.point.axis
        across = spin - (spin @ axis) * axis
        return self._turning * cross(axis, rotation @ self._axis_in_hand) + self._turning_damping * across


_FASTEST = 0.35
"""Angular frequency times step, beyond which an explicit spring gets inaccurate: light things are held more softly."""
