"""A scenario's door: as the physics takes it, and as the planner hears of it by SDO."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from config.scenario import Scenario, StepTable
from config.surroundings import DOOR_DEFAULTS, DoorTable
from drivers.tables import planner as table
from sim.door_parameters import DoorKind, DoorParameters, HandleGrasp
from stack.planner.leaf import LeafMotion
from stack.strategic.door import LeafObjects
from stack.strategic.motion import ParameterWrite

LEAF_OBJECTS = LeafObjects(
    hinge_x=(table.DOOR_LEAF, table.DOOR_NAMES.index("hinge x") + 1),
    hinge_y=(table.DOOR_LEAF, table.DOOR_NAMES.index("hinge y") + 1),
    motion=(table.DOOR_MOTION, 0),
    turns=LeafMotion.TURNS,
)


def leaf_writes(scenario: Scenario) -> tuple[ParameterWrite, ...]:
    """The leaf of the scenario's door, shut, for a planner that keeps clear of it: it is seen like tables and walls. Where its hinge is
    nobody sees: that is guessed, as far away as a step that pulls the door takes it to be."""
    if scenario.door is None:
        return ()
    door = door_parameters(scenario.door)
    size, middle = door.panel()
    frame = door.frame()
    box = (*(frame @ np.array([*middle, 1.0]))[:3], *size, math.atan2(frame[1, 0], frame[0, 0]))
    hinge = np.array(door.handle[:2])
    if door.hinged:
        pulls = (step.pull.radius_m for step in scenario.step if step.pull is not None)
        hinge = hinge - next(pulls, door.across) * frame[:2, 0]
    values = (*box, *door.handle[:2], *hinge)
    numbers = (ParameterWrite(table.DOOR_LEAF, i, float(value)) for i, value in enumerate(values, start=1))
    return (*numbers, ParameterWrite(table.DOOR_MOTION, 0, LeafMotion.STANDS))


def grip_writes(scenario: Scenario, step: StepTable) -> Iterator[ParameterWrite]:
    """Before a step that closes the gripper the leaf goes along with the hand, before one that opens it the leaf stays where it is."""
    if scenario.door is None or step.gripper is None:
        return
    held = LeafMotion.TURNS if scenario.door.kind == "hinged" else LeafMotion.SLIDES
    yield ParameterWrite(table.DOOR_MOTION, 0, held if step.gripper == "close" else LeafMotion.STANDS)


def door_parameters(table: DoorTable) -> DoorParameters:
    """The door of a table, with what it leaves unsaid."""
    default = DOOR_DEFAULTS[table.kind]

    def value(name: str) -> float:
        given: float | None = getattr(table, name)
        return default[name] if given is None else given

    hinged = table.kind == "hinged"
    return DoorParameters(
        DoorKind(table.kind),
        handle=table.handle_m,
        heading=table.heading_rad,
        side=1 if hinged == (table.side == "right") else -1,
        across=value("radius_m") if hinged else value("width_m"),
        height=table.height_m,
        thickness=table.thickness_m,
        mass=value("mass_kg"),
        travel=value("travel"),
        start=table.start,
        friction=value("friction"),
        damping=value("damping"),
        closer_stiffness=table.closer_stiffness,
        closer_preload=table.closer_preload,
        catch=table.catch,
        catch_width=table.catch_width,
        standoff=table.standoff_m,
        bar_length=table.bar_length_m,
        grasp=HandleGrasp(table.grasp),
    )
