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

pytestmark = pytest.mark.slow

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


def test_what_stands_on_a_table_stays_there(rig: Callable[..., Any]) -> None:
    box = ObjectParameters("box", ObjectShape.BOX, (0.04, 0.06, 0.08), (0.8, -0.2, TOP), heading=0.4, mass=0.5)
    one = rig(world_of(CUP, box))
    for _ in range(200):
        one.cycle()
    for thing in one.world.surroundings.objects:
        moved = thing.pose()[:3, 3] - thing.parameters.pose()[:3, 3]
        assert np.abs(moved[:2]).max() < 2e-4
        assert abs(moved[2]) < 1e-3
    poses = one.world.truth(0).body_poses
    assert poses.shape == (2, 4, 4)
    assert poses[1, :3, :3] == pytest.approx(box.pose()[:3, :3], abs=1e-3)


def test_a_thing_is_taken_carried_and_set_down(rig: Callable[..., Any]) -> None:
    """Closes around a cup, lifts it by the lift and carries it sideways with the tower, sets it down, and it stays."""
    arm_home = posture(rig().arm, CUP.position[0], CUP.position[1], TOP + 0.06)
    one = rig(world_of(CUP, home=arm_home))
    world, cup = one.world, one.world.surroundings.objects[0]
    gripper = world.surroundings.gripper
    rest = cup.pose()

    def move(step: np.ndarray, cycles: int) -> None:
        start = one.q.copy()
        for k in range(cycles):
            s = (k + 1) / cycles
            one.q = start + step * s**3 * (10 - 15 * s + 6 * s * s)
            one.cycle(q=one.q, effort=one.arm.gravity(one.q))

    one.q = one.home.copy()
    gripper.command(Gripper.CLOSE)
    move(np.zeros(8), 50)
    assert gripper.phase is GripperPhase.HOLDING
    up = np.zeros(8)
    up[1] = 0.12
    move(up, 150)
    assert cup.pose()[2, 3] == pytest.approx(rest[2, 3] + 0.12, abs=4e-3)
    weight = world.truth(0).contact_wrench[:3]
    assert np.linalg.norm(weight) == pytest.approx(0.3 * 9.81, rel=0.02)
    assert world.truth(0).pose_WE[:3, :3] @ weight == pytest.approx([0.0, 0.0, -0.3 * 9.81], abs=0.1)
    aside = np.zeros(8)
    aside[0] = 0.25
    move(aside, 200)
    move(-up, 150)
    gripper.command(Gripper.OPEN)
    move(up, 150)
    for _ in range(50):
        one.cycle(q=one.q, effort=one.arm.gravity(one.q))
    down = cup.pose()
    assert np.linalg.norm(down[:2, 3] - rest[:2, 3]) > 0.1
    assert down[2, 3] == pytest.approx(rest[2, 3], abs=2e-3)
    assert down[2, 2] > 0.999  # upright
    before = down[:3, 3].copy()
    for _ in range(100):
        one.cycle(q=one.q, effort=one.arm.gravity(one.q))
    assert cup.pose()[:3, 3] == pytest.approx(before, abs=5e-4)
    assert world.collisions.ticks == 0


def test_a_table_is_where_it_is_said_to_be() -> None:
    turned = Obstacle.table("desk", (1.0, 0.5, 0.7), (2.0, 1.0), np.pi / 2)
    pose = turned.pose()
    top = turned.blocks[0]
    corner = pose @ np.array([0.5, 0.25, top.at[2] + 0.5 * top.size[2], 1.0])
    assert corner[:3] == pytest.approx([1.75, 1.5, 0.7])
    assert len(turned.blocks) == 5


def test_bad_objects_are_refused() -> None:
    with pytest.raises(ValueError, match="cup: size"):
        replace(CUP, mass=0.0)
    with pytest.raises(ValueError, match="'sphere'"):
        replace(CUP, shape="sphere")
