"""What is between a joint drive and its link: the most torque and speed that the motor has, and friction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector


def _per_joint(*values: float) -> Vector:
    return np.array(values, dtype=np.float64)


@dataclass(frozen=True)
class JointPlantParameters:
    """Motors and gears of the arm, each an (n,) array; for the lift "N·m" reads as N and "rad" as m.

    The torque that a motor has left falls from `peak_torque` at `rated_speed` to nothing at `no_load_speed`; braking is
    never limited by speed.
    """

    peak_torque: Vector
    """N·m"""
    rated_speed: Vector
    """rad/s"""
    no_load_speed: Vector
    """rad/s"""
    coulomb_friction: Vector
    """N·m"""
    viscous_friction: Vector
    """N·m·s/rad"""
    friction_speed: float = field(default=0.05)
    """rad/s: Coulomb friction sets in as tanh(speed / friction_speed). It acts as an explicit torque; a true Coulomb
    friction row in the solver costs as much as the rest of the step."""

    def __post_init__(self) -> None:
        shape = np.shape(self.peak_torque)
        for name in ("rated_speed", "no_load_speed", "coulomb_friction", "viscous_friction"):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"joint plant {name} has shape {np.shape(getattr(self, name))}, must be {shape}")
        if np.any(self.peak_torque <= 0.0):
            raise ValueError(f"joint plant peak_torque = {self.peak_torque}: must be positive")
        if np.any(self.no_load_speed <= self.rated_speed):
            raise ValueError(f"joint plant no_load_speed = {self.no_load_speed} must exceed {self.rated_speed}")

    @classmethod
    def from_limits(cls, peak_torque: Vector, velocity: Vector) -> JointPlantParameters:
        """Motors that have their full torque a fifth beyond the joints' velocity limit, none at twice; no friction."""
        nothing = np.zeros(len(peak_torque))
        return cls(peak_torque, 1.2 * velocity, 2.0 * velocity, nothing, nothing)


@compiled
def _effort(parameters: Matrix, friction_speed: float, command: Vector, velocity: Vector, effort: Vector) -> None:
    for i in range(command.shape[0]):
        peak = parameters[0, i]
        available = peak
        speed = abs(velocity[i])
        if speed > parameters[1, i] and command[i] * velocity[i] > 0.0:
            share = (parameters[2, i] - speed) / (parameters[2, i] - parameters[1, i])
            available = peak * max(share, 0.0)
        torque = min(max(command[i], -available), available)
        if parameters[3, i] != 0.0:
            torque -= parameters[3, i] * np.tanh(velocity[i] / friction_speed)
        effort[i] = torque - parameters[4, i] * velocity[i]


class JointPlant:
    """Commanded torque in, torque on the link out."""

    def __init__(self, parameters: JointPlantParameters) -> None:
        self.parameters = parameters
        fields = ("peak_torque", "rated_speed", "no_load_speed", "coulomb_friction", "viscous_friction")
        self._table = np.ascontiguousarray([getattr(parameters, name) for name in fields], dtype=np.float64)
        self.effort: Vector = np.zeros(self._table.shape[1])
        """Torque on each link over the coming step (n,), N·m."""
        self.advance(self.effort.copy(), self.effort.copy())

    def advance(self, command: Vector, velocity: Vector) -> None:
        """Fill `effort` from the commanded torque (n,) and the joint velocity (n,)."""
        _effort(self._table, self.parameters.friction_speed, command, velocity, self.effort)
