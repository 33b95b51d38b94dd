"""Everything around the robot that can be touched, as one thing that acts before every step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.door_parameters import DoorParameters
from sim.doors import Door
from sim.gripper import GripperHand, GripperParameters
from sim.obstacles import Object, ObjectParameters, Obstacle, add_obstacle
from sim.person import Person, PersonParameters
from sim.physics import Physics
from stack.messages import Matrix, Vector


@dataclass(frozen=True)
class SurroundingsParameters:
    """What there is beside floor and robot; by default nothing."""

    gripper: GripperParameters = field(default_factory=GripperParameters)
    door: DoorParameters | None = None
    person: PersonParameters | None = None
    obstacles: tuple[Obstacle, ...] = ()
    objects: tuple[ObjectParameters, ...] = ()

    @property
    def solid(self) -> bool:
        """Whether there is anything that the robot could run into."""
        return bool(self.door or self.obstacles or self.objects)


class Surroundings:
    """Bodies of one world, and the gripper that takes hold of them. Made anew with every reset of the physics."""

    def __init__(self, physics: Physics, parameters: SurroundingsParameters) -> None:
        self._physics = physics
        self.obstacles = [(obstacle.name, add_obstacle(physics, obstacle)) for obstacle in parameters.obstacles]
        self.objects = [Object(physics, thing) for thing in parameters.objects]
        self.door = None if parameters.door is None else Door(physics, parameters.door)
        self.gripper = GripperHand(physics, parameters.gripper)
        self.gripper.graspable += [thing.grasp_point for thing in self.objects]
        if self.door is not None:
            self.gripper.graspable.append(self.door.handle)
        self._parameters = parameters
        self.person: Person | None = None

    def start(self) -> None:
        """The robot has come to rest: the clock starts here."""
        if self._parameters.person is not None:
            self.person = Person(self._physics, self._parameters.person)

    def act(self) -> None:
        """Before every step."""
        if self.door is not None:
            self.door.act()
        self.gripper.act()
        if self.person is not None:
            self.person.act()

    def truth(self) -> dict[str, Vector | Matrix | None]:
        """The optional fields of `Truth`."""
        door, person = self.door, self.person
        found: dict[str, Vector | Matrix | None] = {}
        poses = [thing.pose() for thing in self.objects]
        if door is not None:
            door.sense()
            found["door"] = np.array([door.position, door.rate])
            found["handle_force"] = door.axes().T @ self.gripper.force_on(door.handle)
            poses = [door.pose(), *poses]
        if person is not None:
            found["hand"] = np.concatenate([person.position, person.force])
        if poses:
            found["body_poses"] = np.array(poses)
        return found
