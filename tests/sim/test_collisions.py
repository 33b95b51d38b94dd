"""Unwanted contacts are found when there are any, and only then; looking for them changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.bullet import pybullet
from sim.collisions import Collisions
from sim.door_parameters import DoorKind, DoorParameters
from sim.obstacles import Obstacle
from sim.physics import PhysicsParameters
from sim.slip import SlipParameters
from sim.surroundings import SurroundingsParameters
from sim.world import World, WorldParameters
from stack.kinematics.robot_file import robot_directory
from stack.messages import Gripper

URDF = robot_directory("moma8") / "robot.urdf"
SOLID = PhysicsParameters(gripper_touches=True, links_touch=True)
FOLDED = np.array([0.0, 0.75, 0.0, 1.6, 2.3, 0.0, 0.0, 0.0])
"""the hand comes up at the shoulder"""


def world_of(**around: Any) -> WorldParameters:
    return WorldParameters(slip=SlipParameters(sigma=0.0), physics=SOLID, surroundings=SurroundingsParameters(**around))


def sweep(one: Any, goal: np.ndarray, cycles: int) -> None:
    """All joints together, slowly, from where they are."""
    start = one.q.copy() if hasattr(one, "q") else one.home.copy()
    for k in range(cycles):
        one.q = start + (goal - start) * (k + 1) / cycles
        one.cycle(q=one.q, effort=one.arm.gravity(one.q))


def all_shape_distances(one: Any, collisions: Collisions) -> dict[tuple[int, int], float]:
    """Of every pair that counts, from PyBullet's shapes; what is further than a metre is left out."""
    physics, found = one.world.physics, {}
    for i, j in collisions._pairs.tolist():
        first, second = collisions._links[i], collisions._links[j]
        points = pybullet.getClosestPoints(
            physics.robot, physics.robot, 1.0, linkIndexA=first, linkIndexB=second, physicsClientId=physics.client
        )
        if points:
            found[i, j] = min(point[8] for point in points)
    return found


def test_capsules_never_say_more_than_the_shapes_and_touching_is_found_in_any_posture(rig: Callable[..., Any]) -> None:
    """Against PyBullet's distances of all pairs, 300 random postures, a good part of them with links in each other."""
    one = rig()
    collisions, random = one.world.collisions, np.random.default_rng(7)
    touching = 0
    for q in random.uniform(one.arm.q_min, one.arm.q_max, (300, 8)):
        one.world.physics.place(np.eye(4), q)
        names, _ = collisions._own_links()
        distances = all_shape_distances(one, collisions)
        rows = {tuple(pair): row for row, pair in enumerate(collisions._pairs.tolist())}
        for pair, distance in distances.items():
            assert collisions._distance[rows[pair]] <= distance + 2e-3  # PyBullet's cylinders are prisms
        truly = {pair for pair, distance in distances.items() if distance <= 0.0}
        own = [name for name in names if "floor" not in name]
        assert len(own) == len(truly)
        touching += bool(truly)
    assert 20 < touching < 280


def test_home_is_free_and_a_sweep_through_free_space_counts_nothing(rig: Callable[..., Any]) -> None:
    one = rig()
    sweep(one, one.home + np.array([0.8, 0.1, 0.3, -0.4, 0.5, 0.6, -0.4, 1.0]), 200)
    assert one.world.collisions.ticks == 0
    assert one.world.collisions.pairs == {}
    assert one.world.collisions.news() == []


def test_links_that_run_into_each_other_are_counted_and_named_once(rig: Callable[..., Any]) -> None:
    one = rig()
    sweep(one, FOLDED, 250)
    collisions = one.world.collisions
    assert collisions.ticks > 0
    assert collisions.news() == list(collisions.pairs)
    assert collisions.news() == []
    names = {"platform", *one.world.physics.names.arm, "force_sensor", "gripper"}
    for pair in collisions.pairs:
        assert set(pair.split(" - ")) <= names
    before = collisions.ticks
    for _ in range(20):
        one.cycle(q=one.q, effort=one.arm.gravity(one.q))
    assert collisions.ticks == before + 200  # every tick that they stay in each other


def test_no_touching_is_missed_between_two_looks(rig: Callable[..., Any]) -> None:
    """A fast sweep into the arm itself: what was counted in each tick, against a look in each tick."""
    one = rig()
    collisions = one.world.collisions
    counted, seen = [0], []

    def look() -> None:
        counted.append(collisions.ticks)
        seen.append(bool(collisions._own_links()[0]))

    start = one.home.copy()
    for k in range(100):
        q = start + (FOLDED - start) * min(1.0, (k + 1) / 80)
        one.cycle(q=q, effort=one.arm.gravity(q), after_tick=look)
    assert 0 < sum(seen) < len(seen)
    assert np.diff(counted).tolist() == seen


def test_a_link_driven_into_a_table_is_found_and_stopped(rig: Callable[..., Any]) -> None:
    table = Obstacle.table("table", (0.5, 0.5, 0.75), (0.87, 0.61))
    one = rig(world_of(obstacles=(table,)))
    for _ in range(20):
        one.cycle()
    assert one.world.collisions.ticks == 0
    goal = one.home.copy()
    goal[1] -= 0.25
    sweep(one, goal, 250)
    assert one.world.collisions.ticks > 0
    assert set(one.world.collisions.pairs) <= {f"{link} - table" for link in ("gripper", "force_sensor", "wrist_pan")}
    assert one.world.truth(0).contact_wrench[:3] @ one.world.truth(0).contact_wrench[:3] > 25.0


def test_a_platform_that_drives_into_a_wall_is_found(rig: Callable[..., Any]) -> None:
    one = rig(world_of(obstacles=(Obstacle.wall("wall", (0.1, 2.0, 0.3), (0.8, 0.0)),)))
    one.drive(0.3, 0.0, 0.4)
    assert one.world.collisions.ticks == 0
    one.drive(0.3, 0.0, 1.0)
    assert set(one.world.collisions.pairs) == {"platform - wall"}
    assert one.world.truth(0).pose_WB[0, 3] < 0.8 - 0.05 - 0.47 + 0.01


def test_a_hand_on_the_floor_is_found(rig: Callable[..., Any]) -> None:
    """The arm hangs straight down beside the platform: 0.922 m below the lift, and a centimetre of fingers beyond the TCP."""
    one = rig()
    for lift, touches in ((0.60, False), (0.57, True)):
        one.world.physics.place(np.eye(4), np.array([1.5, lift, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        assert one.world.physics.pose_WE()[2, 3] == pytest.approx(0.35 + lift - 0.922, abs=1e-5)
        touching, _ = one.world.collisions._own_links()
        assert ("gripper - floor" in touching) is touches


def test_the_handle_in_the_hand_is_no_collision_but_the_panel_at_the_arm_is(rig: Callable[..., Any]) -> None:
    handle = (0.87282, 0.61275, 0.88931)
    door = DoorParameters(DoorKind.HINGED, handle, np.pi / 2, -1)
    one = rig(world_of(door=door))
    one.world.surroundings.gripper.command(Gripper.CLOSE)
    for _ in range(60):
        one.cycle()
    assert one.world.surroundings.gripper.hold is not None
    assert one.world.collisions.ticks == 0


def test_looking_changes_no_bit(rig: Callable[..., Any]) -> None:
    def end(look: bool) -> bytes:
        one = rig()
        if not look:
            one.world.collisions.check = lambda: None
        sweep(one, FOLDED, 60)
        truth = one.world.truth(0)
        return bytes(truth.q.tobytes() + truth.pose_WE.tobytes())

    assert end(True) == end(False)


def test_a_link_without_a_shape_is_named(tmp_path: Path) -> None:
    text = URDF.read_text(encoding="utf-8")
    start = text.index("<collision>", text.index('<link name="elbow">'))
    end = text.index("</collision>", start) + len("</collision>")
    bare = tmp_path / "robot.urdf"
    bare.write_text(text[:start] + text[end:], encoding="utf-8")
    with pytest.raises(ValueError, match="elbow must have one box"):
        World(bare)
