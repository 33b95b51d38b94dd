"""What may break in the robot itself: encoders, motors, brakes, wheels, force sensor, camera.

Each wrapper stands where the real part would break, between the physics and whoever reads or drives it; nothing beyond it can tell an
injected fault from a real one. Without a fault they pass everything on unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim.bullet import pybullet
from sim.plant import WHEELS, RobotPlant
from sim.wheel_plant import WheelPlant
from stack.messages import TrackedPose, Vector

BLOCKED_WHEEL_TORQUE = 500.0
"""N·m: more than wheel drive and platform together can bring up."""


class FaultyPlant:
    """A robot's plant with encoders and motors that may break; axes in node order, wheels first."""

    def __init__(self, plant: RobotPlant, step_s: float) -> None:
        self._plant = plant
        self._step_s = step_s
        count = plant.axes
        self._offset = np.zeros(count)
        self._spike = np.zeros(count)
        self._frozen: dict[int, float] = {}
        self._lost: set[int] = set()
        self._share = np.ones(count)
        self._engaged = np.ones(count, dtype=np.bool_)
        self._jammed = np.zeros(count, dtype=np.bool_)
        self._shown = np.zeros(count)
        self._wheels = plant.wheels = BreakableWheels(plant.wheels)  # type: ignore[assignment]

    def read(self, position: Vector, velocity: Vector) -> None:
        """What the encoders show, (10,) each."""
        self._plant.read(position, velocity)
        position += self._offset
        velocity += self._spike / self._step_s
        self._spike[:] = 0.0
        for axis, shown in self._frozen.items():
            position[axis], velocity[axis] = shown, 0.0
        for axis in self._lost:
            position[axis] = velocity[axis] = math.nan
        self._shown[:] = position

    def write(self, command: Vector) -> None:
        """Commands (10,); what a broken motor makes of its one."""
        self._plant.write(command * self._share)

    def brake(self, engaged: Sequence[bool]) -> None:
        """Brakes as the drives want them; one that is stuck stays closed."""
        self._engaged = np.array(engaged, dtype=np.bool_)
        self._set_brakes()

    def shift_encoder(self, axis: int, distance: float) -> None:
        """The encoder shows `distance` (rad or m) more from now on: the velocity that it derives shows one spike."""
        self._offset[axis] += distance
        self._spike[axis] += distance

    def freeze_encoder(self, axis: int, frozen: bool) -> None:
        """The encoder keeps showing what it shows, velocity 0; thawed, it shows the truth again."""
        if frozen:
            self._frozen[axis] = float(self._shown[axis])
        else:
            self._frozen.pop(axis, None)

    def lose_encoder(self, axis: int, lost: bool) -> None:
        """No reading at all."""
        (self._lost.add if lost else self._lost.discard)(axis)

    def weaken(self, axis: int, share: float) -> None:
        """The motor has `share` of the torque that it is told left; 1: sound again."""
        self._share[axis] = share

    def jam(self, axis: int, jammed: bool) -> None:
        """The brake of a joint closes and stays so."""
        self._jammed[axis] = jammed
        self._set_brakes()

    def block_wheel(self, wheel: int, blocked: bool) -> None:
        """A wheel (0 left, 1 right) that something holds against its drive."""
        physics = self._plant.physics
        pybullet.setJointMotorControl2(
            physics.robot,
            physics.wheel_joints[wheel],
            pybullet.VELOCITY_CONTROL,
            targetVelocity=0.0,
            force=BLOCKED_WHEEL_TORQUE if blocked else 0.0,
            physicsClientId=physics.client,
        )

    def slip_wheel(self, wheel: int, grip: float) -> None:
        """The wheel has `grip` (0 … 1) of its drive's torque on the ground and turns as it is told; 1: sound again."""
        self._wheels.grip[wheel] = grip

    def _set_brakes(self) -> None:
        self._plant.brake((self._engaged | self._jammed).tolist())


assert WHEELS == 2  # what `block_wheel` and `slip_wheel` number


class BreakableWheels:
    """The wheels of a plant, which may lose their grip: the wheel turns at its commanded speed, the platform rolls on as it likes."""

    def __init__(self, wheels: WheelPlant) -> None:
        self._wheels = wheels
        self.parameters = wheels.parameters
        self.effort, self.speed = wheels.effort, wheels.speed
        self.encoder, self.encoder_rate = wheels.encoder, wheels.encoder_rate
        self.grip = np.ones(len(wheels.effort))

    def zero(self, angle: Vector) -> None:
        """See `WheelPlant.zero`."""
        self._wheels.zero(angle)

    def drive(self, command: Vector, rate: Vector, slip: Vector) -> None:
        """See `WheelPlant.drive`; what the ground gets of the effort is what the grip lets through."""
        self._wheels.drive(command, rate, slip)
        self.effort *= self.grip

    def sense(self, angle: Vector, rate: Vector, slip: Vector) -> None:
        """See `WheelPlant.sense`; a wheel without grip shows its own turning."""
        before = self.encoder.copy()
        self._wheels.sense(angle, rate, slip)
        loose = self.grip < 1.0
        if loose.any():
            turned = self.speed * self._wheels.dt_s
            self.encoder[loose] = before[loose] + turned[loose]
            self.encoder_rate[loose] = self.speed[loose]


class FaultyReading:
    """A wrench (6,) that is as `read` says, or stuck, saturated, or no number."""

    def __init__(self, read: Callable[[], Vector]) -> None:
        self._read = read
        self._stuck: Vector | None = None
        self._saturated: float | None = None
        self._broken = False
        self._last: Vector = np.zeros(6)

    def __call__(self) -> Vector:
        fresh = self._read()
        if self._broken:
            return np.full(6, math.nan)
        if self._stuck is not None:
            return self._stuck.copy()
        if self._saturated is not None:
            return np.array([self._saturated] * 3 + [0.1 * self._saturated] * 3)
        self._last = fresh
        return fresh

    def stick(self, stuck: bool) -> None:
        """The last reading, for ever."""
        self._stuck = self._last.copy() if stuck else None

    def saturate(self, limit: float | None) -> None:
        """Every force at `limit` (N), every torque at a tenth of it (N·m)."""
        self._saturated = limit

    def break_down(self, broken: bool) -> None:
        """NaN."""
        self._broken = broken


class FaultyCamera:
    """A tracked pose as `deliver` has it, or nothing: the feature is out of sight."""

    def __init__(self, deliver: Callable[[int], TrackedPose | None]) -> None:
        self._deliver = deliver
        self.blind = False

    def __call__(self, t_ns: int) -> TrackedPose | None:
        seen = self._deliver(t_ns)
        return None if self.blind else seen


@dataclass
class Breakable:
    """Everything in one robot that may break; `camera` is None where there is none."""

    plant: FaultyPlant
    force: FaultyReading
    camera: FaultyCamera | None
