"""Force/torque sensor between wrist and gripper, read at the TCP.

PyBullet's own joint sensor is right at rest only. This one is Newton's law for the tool (gripper and what is fixed to
it), averaged since the last reading as a sensor's filter would:

    reading = external + weight - rate of change of the tool's momentum        (force, and moment about the TCP)

and what the sensor's electronics know of the tool is taken off again: nothing, its weight (usual), or its motion too.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim.physics import Physics
from sim.rotation import cross
from stack.messages import Vector

_STREAM = 0xF0


class Compensation(StrEnum):
    """What is taken off the reading: nothing, the tool's weight, weight and inertia."""

    NONE = "none"
    WEIGHT = "weight"
    MOTION = "motion"


@dataclass(frozen=True)
class ForceSensorParameters:
    """Noise is white from reading to reading; 0 switches it off exactly."""

    force_noise_n: float = 0.05
    torque_noise_nm: float = 0.002
    compensation: Compensation = Compensation.WEIGHT


class ForceSensor:
    """Reads the wrench that acts on the robot from outside, (6,) `[f; m]` at the TCP in the end-point frame."""

    def __init__(self, parameters: ForceSensorParameters, physics: Physics, seed: int) -> None:
        self.parameters = parameters
        self._physics = physics
        self._random = np.random.default_rng([seed, _STREAM])
        names = physics.names
        self.mass, centre, self._inertia = physics.solid(names.gripper)
        pose_E = np.linalg.inv(physics.link_pose(names.tcp)) @ physics.link_pose(names.gripper)
        self._centre = pose_E[:3, :3] @ centre + pose_E[:3, 3]
        if not np.allclose(pose_E[:3, :3], np.eye(3)):
            raise ValueError(f"{physics.urdf}: {names.gripper} and {names.tcp} must have parallel frames")
        self._weight = np.array([0.0, 0.0, -physics.parameters.gravity]) * self.mass
        self._spread = np.repeat([parameters.force_noise_n, parameters.torque_noise_nm], 3)
        self._sum: Vector = np.zeros(6)
        self._before, _ = self._momentum()
        self._steps = 1
        self._last: Vector = np.zeros(6)
        self.read()

    def advance(self) -> None:
        """Take note of the step just made."""
        self._steps += 1
        if self._physics.touched:
            self._sum += self._physics.external

    def read(self) -> Vector:
        """Mean wrench since the last reading (6,), N and N·m; the last reading again if no step was made since."""
        if self._steps == 0:
            return self._last.copy()
        momentum, rotation = self._momentum()
        duration = self._steps * self._physics.parameters.step_s
        wrench = self._sum / self._steps
        lever = rotation @ self._centre
        if self.parameters.compensation is Compensation.NONE:
            wrench[:3] += self._weight
            wrench[3:] += cross(lever, self._weight)
        if self.parameters.compensation is not Compensation.MOTION:
            rate = (momentum - self._before) / duration
            wrench[:3] -= rate[:3]
            wrench[3:] -= rate[3:] + cross(lever, rate[:3])
        self._before = momentum
        self._sum[:] = 0.0
        self._steps = 0
        noise = self._spread * self._random.standard_normal(6)
        self._last = np.concatenate([rotation.T @ wrench[:3], rotation.T @ wrench[3:]]) + noise
        return self._last.copy()

    def _momentum(self) -> tuple[Vector, Vector]:
        """Linear momentum of the tool and its angular momentum about its centre (6,), world axes; rotation of the TCP."""
        state = self._physics.hand()
        rotation = self._physics.pose_WE()[:3, :3]
        spin = np.array(state[7])
        velocity = np.array(state[6]) + cross(spin, rotation @ self._centre)
        angular = rotation @ (self._inertia * (rotation.T @ spin))
        return np.concatenate([self.mass * velocity, angular]), rotation
