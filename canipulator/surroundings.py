"""What a scenario says of the robot's surroundings, as the simulation and the recording want it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from config.door import door_parameters
from config.scenario import Scenario
from config.surroundings import (
    FurnitureTable,
    GripperTable,
    ObjectTable,
    PersonTable,
    WallTable,
)
from logs import palette
from logs.around import Around, Body, Part
from sim.door_parameters import DoorParameters
from sim.grasping import PadParameters
from sim.gripper import GripperParameters
from sim.obstacles import ObjectParameters, ObjectShape, Obstacle
from sim.person import HandPath, PersonParameters, Wandering, Waypoints
from sim.surroundings import SurroundingsParameters
from stack.messages import Truth


def surroundings(scenario: Scenario) -> SurroundingsParameters:
    """Everything around the robot of `scenario`."""
    return SurroundingsParameters(
        gripper=_gripper(scenario.gripper),
        door=None if scenario.door is None else door_parameters(scenario.door),
        person=None if scenario.person is None else _person(scenario.person, scenario.seed),
        obstacles=(*map(_table, scenario.table), *map(_wall, scenario.wall)),
        objects=tuple(map(_object, scenario.object)),
    )


def around(scenario: Scenario) -> Around:
    """What the recording of `scenario` shows around the robot: what moves in the order of the truth's body poses."""
    parameters = surroundings(scenario)
    bodies = [
        Body(
            obstacle.name,
            tuple(Part(block.size, block.at, palette.NEUTRAL) for block in obstacle.blocks),
            obstacle.pose(),
        )
        for obstacle in parameters.obstacles
    ]
    moving = [] if parameters.door is None else [_door_body(parameters.door)]
    for thing in parameters.objects:
        shape: Literal["box", "cylinder"] = "box" if thing.shape == ObjectShape.BOX else "cylinder"
        part = Part(thing.size, (0.0, 0.0, 0.0), palette.COMMANDED, shape)
        moving.append(Body(thing.name, (part,), thing.pose(), len(moving)))
    kind = None if scenario.door is None else scenario.door.kind
    return Around((*bodies, *moving), kind, scenario.person is not None)


def _door_body(door: DoorParameters) -> Body:
    size, middle = door.panel()
    bar_at, y = door.bar(), -0.5 * door.side * door.standoff
    stubs = (bar_at[2] - 0.4 * door.bar_length, bar_at[2] + 0.4 * door.bar_length)
    bar = Part((2 * door.bar_radius, 2 * door.bar_radius, door.bar_length), bar_at, palette.COMMANDED, "cylinder")
    arms = (Part((0.015, door.standoff, 0.015), (bar_at[0], y, z), palette.COMMANDED) for z in stubs)
    return Body("door", (Part(size, middle, (120, 134, 158)), bar, *arms), door.frame(), 0)


def _person(table: PersonTable, seed: int) -> PersonParameters:
    path: HandPath
    if table.waypoints is not None and table.path != "random":
        path = Waypoints([row[0] for row in table.waypoints], [row[1:] for row in table.waypoints])
    else:
        assert table.wander is not None
        path = Wandering(seed, table.wander.box_m, table.wander.speed_m_s, table.wander.duration_s)
    return PersonParameters(
        path, table.stiffness_n_m, table.damping_n_s_m, table.strength_n, table.grips_s, table.lets_go_s
    )


def _table(table: FurnitureTable) -> Obstacle:
    return Obstacle.table(table.name, table.size_m, table.position_m, table.heading_rad, table.top_m)


def _wall(table: WallTable) -> Obstacle:
    return Obstacle.wall(table.name, table.size_m, table.position_m, table.heading_rad)


def _object(table: ObjectTable) -> ObjectParameters:
    return ObjectParameters(
        table.name, table.shape, table.size_m, table.position_m, table.heading_rad, table.mass_kg, table.friction
    )


def _gripper(table: GripperTable) -> GripperParameters:
    pads = PadParameters(table.stiffness_n_m, table.turning_stiffness_nm_rad, strength=table.strength_n)
    return GripperParameters(table.closing_s, table.reach_m, pads)


def objects_off_goal(scenario: Scenario, last: Truth) -> float | None:
    """The largest distance (m) of an object's underside from its goal at the end of a run; None where no object has one."""
    goals = [(i, thing) for i, thing in enumerate(scenario.object) if thing.goal_m is not None]
    if not goals or last.body_poses is None:
        return None
    first = 0 if scenario.door is None else 1  # the door comes before the objects
    worst = 0.0
    for i, thing in goals:
        pose = last.body_poses[first + i]
        underside = pose[:3, 3] - 0.5 * thing.size_m[2] * pose[:3, 2]
        worst = max(worst, float(np.linalg.norm(underside - np.array(thing.goal_m))))
    return worst
