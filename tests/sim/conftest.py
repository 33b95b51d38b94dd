"""A robot with servo loops and no bus: what the physics tests drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from sim.slip import SlipParameters
from sim.world import World, WorldParameters
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.messages import Vector
from stack.servo import AxisMode, Servo, load_servo_parameters

PERIOD_S = 0.01
URDF = robot_directory("moma8") / "robot.urdf"


class Rig:
    """World and servo loops of moma8, fed with ideal set points every 10 ms."""

    def __init__(self, parameters: WorldParameters, seed: int = 1) -> None:
        self.world = World(URDF, parameters, seed)
        self.arm = ArmModel.load("moma8")
        self.servo = Servo(load_servo_parameters("moma8"), 1e-3)
        self.mode = np.array([AxisMode.VELOCITY] * 2 + [AxisMode.POSITION] * 8, dtype=np.int64)
        self.position, self.velocity, self.output = np.zeros(10), np.zeros(10), np.zeros(10)
        self.flags = np.zeros(10, dtype=np.int64)
        self.world.plant.read(self.position, self.velocity)
        off = np.zeros(10, dtype=np.int64)
        self.servo.tick(off, self.position, self.velocity, self.output, self.flags)
        self.home = self.position[2:].copy()
        self.hold = self.arm.gravity(self.home)
        self.ticks = 0
        self.world.plant.brake([False] * 10)

    def cycle(
        self,
        wheels: tuple[float, float] = (0.0, 0.0),
        q: Vector | None = None,
        effort: Vector | None = None,
        after_tick: Callable[[], None] | None = None,
    ) -> None:
        """10 ms towards wheel speeds (rad/s) and joint positions, with torques as offset; home by default."""
        target = np.concatenate([wheels, self.home if q is None else q])
        offset = np.concatenate([[0.0, 0.0], self.hold if effort is None else effort])
        self.servo.accept(self.mode, np.ones(10, dtype=np.bool_), target, offset, PERIOD_S)
        for _ in range(10):
            self.servo.tick(self.mode, self.position, self.velocity, self.output, self.flags)
            self.world.plant.write(self.output)
            self.world.step()
            self.world.plant.read(self.position, self.velocity)
            self.ticks += 1
            if after_tick is not None:
                after_tick()

    def drive(self, v: float, omega: float, seconds: float) -> None:
        """Platform at v (m/s), omega (rad/s), reached and left with the platform's accelerations, then 0.5 s of rest."""
        ramp = max(abs(v) / 0.5, abs(omega) / 1.0)
        t, end = 0.0, seconds + ramp
        while t < end + 0.5:
            t += PERIOD_S
            share = max(0.0, min(t / ramp, (end - t) / ramp, 1.0))
            self.cycle((share * (v - omega * 0.225) / 0.1, share * (v + omega * 0.225) / 0.1))


@pytest.fixture
def rig() -> Iterator[Callable[..., Rig]]:
    """Makes rigs; without slip unless parameters are given."""
    made: list[Rig] = []

    def make(parameters: WorldParameters | None = None, seed: int = 1) -> Rig:
        made.append(Rig(parameters or WorldParameters(slip=SlipParameters(sigma=0.0)), seed))
        return made[-1]

    yield make
    for one in made:
        one.world.close()
