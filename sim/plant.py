"""What the ten drives are bolted to: wheels 11, 12 and joints 21..28, as arrays in that order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.joint_plant import JointPlant
from sim.physics import Physics
from sim.slip import Slip
from sim.wheel_plant import WheelPlant
from stack.messages import Vector

WHEELS = 2
ENCODER_STEP = 2.0 * np.pi / 2**32
"""A joint encoder's last digit (rad; m for the lift): it is never still, as that of any such encoder."""
_FLICKER_READINGS = 4096


class RobotPlant:
    """Encoders out, commands in; the drives' side of the physics (`Plant` of the drive bank).

    Units: rad and rad/s, for the lift m and m/s. Commands: wheels rad/s, joints N·m (lift N).
    """

    def __init__(self, physics: Physics, joints: JointPlant, wheels: WheelPlant, slip: Slip) -> None:
        self.physics = physics
        self.joints = joints
        self.wheels = wheels
        self.slip = slip
        self.axes = WHEELS + len(physics.q)
        self._command = np.zeros(self.axes)
        shape = _FLICKER_READINGS, len(physics.q)
        self._flicker = ENCODER_STEP * np.random.default_rng(0xE0).uniform(-1.0, 1.0, shape)
        self._reading = 0

    def read(self, position: Vector, velocity: Vector) -> None:
        """Fill in what the encoders show, each (10,)."""
        position[:WHEELS] = self.wheels.encoder
        np.add(self.physics.q, self._flicker[self._reading], out=position[WHEELS:])
        self._reading = (self._reading + 1) % _FLICKER_READINGS
        velocity[:WHEELS] = self.wheels.encoder_rate
        velocity[WHEELS:] = self.physics.dq

    def write(self, command: Vector) -> None:
        """Command (10,) that holds until the next one."""
        self._command[:] = command

    def brake(self, engaged: Sequence[bool]) -> None:
        """Close (engage) or open the holding brakes, (10,); the wheels have none.

        A drive without power keeps its brake closed: the arm would fall otherwise. All are closed after a reset.
        """
        self.physics.set_brakes(engaged[WHEELS:])

    def zero(self) -> None:
        """Forget all commands; wheel encoders read 0."""
        self._command[:] = 0.0
        self.wheels.zero(self.physics.wheel_angle)

    def actuate(self) -> None:
        """Before a step: from the held commands to motors and torques."""
        self.slip.advance()
        self.wheels.drive(self._command[:WHEELS], self.physics.wheel_rate, self.slip.ratio)
        self.joints.advance(self._command[WHEELS:], self.physics.dq)
        self.physics.set_torques(self.wheels.effort, self.joints.effort)

    def sense(self) -> None:
        """After a step: encoders."""
        self.wheels.sense(self.physics.wheel_angle, self.physics.wheel_rate, self.slip.ratio)
