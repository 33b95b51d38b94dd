"""The simulated world: physics, the robot's plants and sensors, stepped together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sim.collisions import Collisions
from sim.force_sensor import ForceSensor, ForceSensorParameters
from sim.joint_plant import JointPlant, JointPlantParameters
from sim.physics import Physics, PhysicsParameters, RobotNames
from sim.plant import RobotPlant
from sim.rotation import rotation_of
from sim.slip import Slip, SlipParameters
from sim.surroundings import Surroundings, SurroundingsParameters
from sim.wheel_plant import WheelPlant, WheelPlantParameters
from stack.messages import Truth

MOMA8_HOME = (0.0, 0.75, -np.pi / 4, 0.6, -1.3, 0.0, 0.9, 0.0)


@dataclass(frozen=True)
class WorldParameters:
    """Everything that shapes the world; the defaults are moma8's."""

    physics: PhysicsParameters = field(default_factory=PhysicsParameters)
    names: RobotNames = field(default_factory=RobotNames)
    joints: JointPlantParameters | None = None
    """None: motors of the effort and velocity limits of the URDF, without friction"""
    wheels: WheelPlantParameters = field(default_factory=WheelPlantParameters)
    slip: SlipParameters = field(default_factory=SlipParameters)
    force_sensor: ForceSensorParameters = field(default_factory=ForceSensorParameters)
    surroundings: SurroundingsParameters = field(default_factory=SurroundingsParameters)
    home: tuple[float, ...] = MOMA8_HOME
    """arm configuration after a reset (8,), rad and m"""
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y (m) and heading (rad) of the platform after a reset"""
    settle_s: float = 0.3
    """how long the robot stands with closed brakes before the clock starts"""


class World:
    """One robot on its floor.

    One `step()` is one tick: loads and motors, physics, encoders. Everything that is read afterwards belongs to the end
    of that tick. Same URDF, parameters and seed: the same bits.
    """

    def __init__(self, urdf: Path, parameters: WorldParameters | None = None, seed: int = 1) -> None:
        self.parameters = parameters or WorldParameters()
        self.seed = seed
        self.physics = Physics(urdf, self.parameters.physics, self.parameters.names)
        self.before_step: list[Callable[[], None]] = []
        """Called at the start of every step, in order, after the surroundings have acted: through `physics.push` and the like."""
        self.physics_step: Callable[[], None] = self.physics.step
        """The bare physics step; wrap it to measure it."""
        self.reset()

    def close(self) -> None:
        """Free the physics client."""
        self.physics.close()

    def reset(self) -> None:
        """Back to the start: the same bits as after construction.

        `plant`, `force_sensor` and `surroundings` are new ones; what somebody else put into the physics is gone.
        """
        parameters, physics = self.parameters, self.physics
        physics.load()
        step_s = parameters.physics.step_s
        joints = parameters.joints or JointPlantParameters.from_limits(physics.peak_torque, physics.velocity_limit)
        self.plant = RobotPlant(
            physics,
            JointPlant(joints),
            WheelPlant(parameters.wheels, step_s),
            Slip(parameters.slip, self.seed, step_s),
        )
        x, y, heading = parameters.start
        pose = np.eye(4)
        pose[:3, :3] = rotation_of((0.0, 0.0, heading))
        pose[:2, 3] = x, y
        physics.place(pose, parameters.home)
        self.surroundings = Surroundings(physics, parameters.surroundings)
        self.plant.brake([True] * self.plant.axes)
        for _ in range(round(parameters.settle_s / step_s)):
            self.plant.actuate()
            physics.step()
            physics.sense()
        self.plant.zero()
        self.force_sensor = ForceSensor(parameters.force_sensor, physics, self.seed)
        self.surroundings.start()
        self.collisions = Collisions(physics, self.surroundings)

    def step(self) -> None:
        """One tick of `physics.step_s`, with the commands that the plant holds."""
        self.surroundings.act()
        for act in self.before_step:
            act()
        self.plant.actuate()
        self.physics_step()
        self.physics.sense()
        self.plant.sense()
        self.force_sensor.advance()
        self.collisions.check()

    def truth(self, t_ns: int) -> Truth:
        """The state after the last step, stamped `t_ns`; all arrays are the caller's own."""
        physics, plant = self.physics, self.plant
        pose_WB, pose_WE = physics.pose_WB(), physics.pose_WE()
        external = physics.external
        turned = pose_WE[:3, :3].T
        return Truth(
            t_ns=t_ns,
            pose_WB=pose_WB,
            pose_WE=pose_WE,
            q=physics.q.copy(),
            dq=physics.dq.copy(),
            effort=plant.joints.effort.copy(),
            wheel_velocity=plant.wheels.encoder_rate.copy(),
            wheel_slip=plant.slip.ratio.copy(),
            base_twist=physics.base_twist(pose_WB),
            contact_wrench=np.concatenate([turned @ external[:3], turned @ external[3:]]),
            **self.surroundings.truth(),
        )
