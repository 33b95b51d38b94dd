"""Tables hold what stands on them; a gripper takes a thing, carries it and sets it down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim.obstacles import ObjectParameters, ObjectShape, Obstacle
from sim.physics import PhysicsParameters
from sim.slip import SlipParameters
from sim.surroundings import SurroundingsParameters
from sim.world import WorldParameters
from stack.kinematics.position import solve_position
from stack.messages import Gripper, GripperPhase

SOLID = PhysicsParameters(gripper_touches=True, links_touch=True)
TOP = 0.72
TABLE = Obstacle.table("table", (0.6, 0.8, TOP), (0.95, 0.0))
CUP = ObjectParameters("cup", ObjectShape.CYLINDER, (0.04, 0.04, 0.10), (0.85, 0.1, TOP), mass=0.3)
DOWN = np.diag([-1.0, 1.0, -1.0])
"""Orientation of a hand whose fingers point down: the hand's z axis points back along the fingers."""


def world_of(*objects: ObjectParameters, home: np.ndarray | None = None) -> WorldParameters:
    around = SurroundingsParameters(obstacles=(TABLE,), objects=objects)
    parameters = WorldParameters(slip=SlipParameters(sigma=0.0), physics=SOLID, surroundings=around)
    return parameters if home is None else replace(parameters, home=tuple(home))


def posture(arm: Any, x: float, y: float, z: float) -> np.ndarray:
    """The arm over a point of the world, hand downwards; nearest to the middle of the joints' ranges."""
    pose = np.eye(4)
    pose[:3, 3] = x - 0.15, y, z - 0.35
    best, middle = None, 0.5 * (arm.q_min + arm.q_max)
    for lift in np.linspace(0.4, 1.1, 15):
        for phi in np.linspace(-2.0, 2.0, 9):
            for q in solve_position(arm, pose, float(lift), float(phi)):
                if (q >= arm.q_min).all() and (q <= arm.q_max).all():
                    cost = float(np.sum(((q - middle) / (arm.q_max - arm.q_min)) ** 2))
                    if best is None or cost < best[0]:
                        best = cost, q
    assert best is not None
    return best[1]
