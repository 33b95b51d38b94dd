"""Doors are real bodies on real joints: moments, friction, closer, catch, rails, stops; and the hand on the bar."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.bullet import pybullet
from sim.door_parameters import DoorKind, DoorParameters, HandleGrasp
from sim.doors import Door
from sim.physics import Physics, PhysicsParameters, RobotNames
from sim.slip import SlipParameters
from sim.surroundings import SurroundingsParameters
from sim.world import World, WorldParameters
from stack.kinematics.robot_file import robot_directory
from stack.messages import Gripper, GripperPhase

URDF = robot_directory("moma8") / "robot.urdf"
HANDLE = (0.87282, 0.61275, 0.88931)
"""where the TCP is at home"""
FREE = {"friction": 0.0, "damping": 0.0}
HINGED = DoorParameters(DoorKind.HINGED, HANDLE, math.pi / 2, 1)
SLIDING = DoorParameters(DoorKind.SLIDING, HANDLE, 0.3, 1, across=0.9, travel=0.9, mass=20.0)
STEP_S = 1e-3


@pytest.fixture
def physics() -> Iterator[Physics]:
    one = Physics(URDF, PhysicsParameters(), RobotNames())
    yield one
    one.close()


def push(door: Door, physics: Physics, force: np.ndarray) -> None:
    """Over the coming step, at the middle of the bar; world axes."""
    pose, _, _ = door.handle.state(physics.client)
    at = pose[:3, :3] @ door.handle.at + pose[:3, 3]
    pybullet.applyExternalForce(
        door.body, 0, force.tolist(), at.tolist(), pybullet.WORLD_FRAME, physicsClientId=physics.client
    )


def run(door: Door, physics: Physics, steps: int, along: float = 0.0, across: float = 0.0, up: float = 0.0) -> None:
    """Steps with a force on the handle, in the door's axes."""
    for _ in range(steps):
        door.act()
        push(door, physics, door.axes() @ np.array([along, across, up]))
        physics.step()
    door.sense()


def inertia(parameters: DoorParameters) -> float:
    """Of the panel about the hinge, kg·m²."""
    (x, y, _), (cx, cy, _) = parameters.panel()
    return parameters.mass * ((x * x + y * y) / 12 + cx * cx + cy * cy)


@settings(max_examples=15, deadline=None)
@given(
    radius=st.floats(0.4, 1.1),
    mass=st.floats(5.0, 40.0),
    heading=st.floats(-3.1, 3.1),
    side=st.sampled_from([1, -1]),
    force=st.floats(2.0, 40.0),
)
def test_the_moment_about_the_hinge_is_force_times_radius(
    radius: float, mass: float, heading: float, side: int, force: float
) -> None:
    physics = Physics(URDF, PhysicsParameters(), RobotNames())
    parameters = DoorParameters(DoorKind.HINGED, HANDLE, heading, side, across=radius, mass=mass, travel=3.0, **FREE)
    door = Door(physics, parameters)
    run(door, physics, 200, along=force)
    assert door.rate == pytest.approx(force * radius / inertia(parameters) * 0.2, rel=2e-3)
    physics.close()


@pytest.mark.parametrize("force", [4.7, 6.3])
def test_coulomb_friction_holds_a_hinged_door_up_to_force_times_radius(physics: Physics, force: float) -> None:
    door = Door(physics, replace(HINGED, friction=4.4, damping=0.0))  # 4.4 N·m at 0.8 m: 5.5 N
    run(door, physics, 500, along=force)
    moves = force * 0.8 > 4.4
    assert (door.position > 1e-2) is moves
    if moves:
        assert door.rate == pytest.approx((force * 0.8 - 4.4) / inertia(HINGED) * 0.5, rel=2e-3)
    else:
        assert abs(door.position) < 1e-6


def test_force_towards_the_hinge_and_upwards_moves_nothing(physics: Physics) -> None:
    door = Door(physics, replace(HINGED, **FREE, start=0.6))
    run(door, physics, 500, across=60.0, up=60.0)
    assert door.position == pytest.approx(0.6, abs=1e-5)


def test_the_handle_runs_on_its_circle_to_the_side_that_it_opens_to(physics: Physics) -> None:
    for side in (1, -1):
        door = Door(physics, replace(HINGED, **FREE, side=side, travel=2.0))
        hinge = HINGED.frame()[:3, 3]
        assert np.linalg.norm(hinge - HANDLE) == pytest.approx(0.8)
        run(door, physics, 600, along=10.0)
        assert door.position > 0.3
        pose, _, _ = door.handle.state(physics.client)
        handle = pose[:3, :3] @ door.handle.at + pose[:3, 3]
        assert np.linalg.norm(handle - hinge) == pytest.approx(0.8, abs=1e-6)
        assert handle[2] == pytest.approx(HANDLE[2], abs=1e-6)
        # from the hinge, which is at +y, the handle points to -y; counter-clockwise from there is +x
        assert np.sign(handle[0] - HANDLE[0]) == side
        run(door, physics, 1, along=0.0)


def test_a_pushed_door_keeps_its_momentum_until_its_stop(physics: Physics) -> None:
    door = Door(physics, replace(HINGED, **FREE, travel=1.0))
    run(door, physics, 300, along=20.0)
    rate, position = door.rate, door.position
    run(door, physics, 200)
    assert door.rate == pytest.approx(rate, rel=1e-6)
    assert door.position == pytest.approx(position + 0.2 * rate, rel=1e-3)
    run(door, physics, 3000)
    assert -1e-3 < door.position <= 1.0 + 5e-3


@pytest.mark.slow
def test_a_closer_shuts_the_door_and_damping_makes_it_slow(physics: Physics) -> None:
    ways = []
    for damping in (2.0, 30.0):
        closer = {"closer_preload": 4.0, "closer_stiffness": 6.0, "damping": damping, "friction": 0.1}
        door = Door(physics, replace(HINGED, **closer, start=1.2))
        run(door, physics, 1500)
        ways.append(door.position)
        run(door, physics, 18_000)
        assert abs(door.position) < 2e-3, f"damping {damping} leaves it open by {door.position}"
        assert abs(door.rate) < 1e-3
    assert ways[1] > ways[0] + 0.3


@pytest.mark.slow
def test_a_spring_that_holds_against_a_force_shows_its_moment(physics: Physics) -> None:
    door = Door(physics, replace(HINGED, friction=0.0, damping=25.0, closer_stiffness=10.0, closer_preload=2.0))
    run(door, physics, 25_000, along=10.0)  # 8 N·m = 2 + 10 · 0.6
    assert door.position == pytest.approx(0.6, rel=1e-3)


def test_a_catch_holds_until_it_is_overcome(physics: Physics) -> None:
    for force, opens in ((15.0, False), (30.0, True)):
        door = Door(physics, replace(HINGED, **FREE, catch=16.0, catch_width=0.03))  # 20 N at the handle
        door.parameters = replace(door.parameters, damping=20.0)
        run(door, physics, 3000, along=force)
        assert (door.position > 0.1) is opens


def test_a_sliding_door_stays_on_its_rails_and_obeys_newton(physics: Physics) -> None:
    door = Door(physics, replace(SLIDING, friction=5.0, damping=0.0))
    before = door.pose()
    run(door, physics, 500, along=4.5, across=60.0, up=80.0)
    assert abs(door.position) < 1e-6
    run(door, physics, 500, along=15.0, across=60.0, up=-80.0)
    assert door.rate == pytest.approx((15.0 - 5.0) / 20.0 * 0.5, rel=2e-3)
    after = door.pose()
    assert after[:3, :3] == pytest.approx(before[:3, :3], abs=1e-6)
    way = np.array([math.cos(0.3), math.sin(0.3), 0.0])
    assert after[:3, 3] - before[:3, 3] == pytest.approx(door.position * way, abs=1e-6)
    run(door, physics, 4000, along=15.0)
    assert door.position == pytest.approx(0.9, abs=5e-3)


def test_bad_doors_are_refused() -> None:
    with pytest.raises(ValueError, match=r"start = 2\.0"):
        replace(HINGED, start=2.0)
    with pytest.raises(ValueError, match=r"mass = 0\.0"):
        replace(HINGED, mass=0.0)
    with pytest.raises(ValueError, match="side = 0"):
        replace(HINGED, side=0)


# --- the hand on the bar ---------------------------------------------------------------------------------------------


def world_of(door: DoorParameters) -> WorldParameters:
    return WorldParameters(slip=SlipParameters(sigma=0.0), surroundings=SurroundingsParameters(door=door))


def grasp(one: Any) -> None:
    one.world.surroundings.gripper.command(Gripper.CLOSE)
    for _ in range(40):
        one.cycle()
    assert one.world.surroundings.gripper.phase is GripperPhase.HOLDING


def test_the_gripper_takes_the_bar_without_a_jerk_and_leaves_it(rig: Callable[..., Any]) -> None:
    one = rig(world_of(HINGED))
    grasp(one)
    assert np.linalg.norm(one.world.truth(0).contact_wrench[:3]) < 0.5
    one.world.surroundings.gripper.command(Gripper.OPEN)
    one.cycle()
    assert one.world.surroundings.gripper.phase is GripperPhase.OPEN
    assert not one.world.truth(0).contact_wrench.any()


def test_a_hand_out_of_reach_closes_on_nothing(rig: Callable[..., Any]) -> None:
    one = rig(world_of(replace(HINGED, handle=(HANDLE[0], HANDLE[1] + 0.05, HANDLE[2]))))
    gripper = one.world.surroundings.gripper
    gripper.command(Gripper.CLOSE)
    phases = []
    for _ in range(40):
        one.cycle()
        phases.append(gripper.phase)
    assert phases[0] is GripperPhase.CLOSING
    assert phases[-1] is GripperPhase.EMPTY
    gripper.command(Gripper.CLOSE)
    one.cycle()
    assert gripper.phase is GripperPhase.EMPTY  # it has to open first


def test_sensor_and_handle_feel_the_same_force(rig: Callable[..., Any]) -> None:
    """A hand holds a door open against its closer: the closer's moment over the radius is the force along, on both sides."""
    start, heading = 0.5, math.pi / 2 - 0.5  # so that the handle is at the hand when the door is open by `start`
    handle = (HANDLE[0] - 0.8 * math.cos(heading), HANDLE[1] + 0.8 - 0.8 * math.sin(heading), HANDLE[2])
    one = rig(world_of(replace(HINGED, handle=handle, heading=heading, friction=9.0, start=start)))
    grasp(one)
    door = one.world.surroundings.door
    door.parameters = replace(door.parameters, closer_preload=8.0)
    pybullet.setJointMotorControl2(
        door.body, 0, pybullet.VELOCITY_CONTROL, force=0.0, physicsClientId=one.world.physics.client
    )
    for _ in range(300):
        one.cycle()
    one.world.force_sensor.read()
    one.cycle()
    truth = one.world.truth(0)
    assert truth.handle_force is not None
    assert truth.handle_force[0] == pytest.approx(10.0, abs=0.05)
    reading = truth.pose_WE[:3, :3] @ one.world.force_sensor.read()[:3]
    assert reading == pytest.approx(-door.axes() @ truth.handle_force, abs=0.3)


@pytest.mark.parametrize("how", [HandleGrasp.PIVOT, HandleGrasp.RIGID])
def test_a_hand_turns_about_the_bar_only_where_it_may(rig: Callable[..., Any], how: HandleGrasp) -> None:
    """The wrist tries to turn the hand about the vertical bar; a rigid hold pays for it with a torque."""
    door = replace(HINGED, grasp=how, travel=0.001, friction=50.0)
    one = rig(world_of(door))
    grasp(one)
    q = one.home.copy()
    for _ in range(100):
        q[7] += 0.002
        one.cycle(q=q)
    truth = one.world.truth(0)
    torque = truth.pose_WE[:3, :3] @ truth.contact_wrench[3:]
    axis = np.array([0.0, 0.0, 1.0])
    if how is HandleGrasp.PIVOT:
        assert abs(torque @ axis) < 0.05
    else:
        assert abs(torque @ axis) > 0.5


def test_too_strong_a_pull_tears_the_bar_out_of_the_hand(rig: Callable[..., Any]) -> None:
    one = rig(world_of(replace(HINGED, friction=400.0)))
    strength = one.world.surroundings.gripper.parameters.pads.strength
    grasp(one)
    largest = 0.0
    for _ in range(400):
        one.world.physics.push(np.array([-1.0, 0.0, 0.0]) * 2.0 * strength)
        one.cycle(after_tick=lambda: one.world.physics.push(np.array([-2.0 * strength, 0.0, 0.0])))
        largest = max(
            largest, float(np.linalg.norm(one.world.surroundings.gripper.force_on(one.world.surroundings.door.handle)))
        )
        if one.world.surroundings.gripper.phase is GripperPhase.EMPTY:
            break
    assert one.world.surroundings.gripper.phase is GripperPhase.EMPTY
    assert largest <= strength


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_with_a_door_in_the_hand() -> None:
    def end() -> bytes:
        world = World(URDF, WorldParameters(surroundings=SurroundingsParameters(door=HINGED)), seed=5)
        world.surroundings.gripper.command(Gripper.CLOSE)
        for _ in range(800):
            world.step()
        truth = world.truth(0)
        first = b"".join(x.tobytes() for x in (truth.pose_WE, truth.door, truth.handle_force) if x is not None)
        world.reset()
        world.surroundings.gripper.command(Gripper.CLOSE)
        for _ in range(800):
            world.step()
        truth = world.truth(0)
        again = b"".join(x.tobytes() for x in (truth.pose_WE, truth.door, truth.handle_force) if x is not None)
        assert again == first
        world.close()
        return first

    assert end() == end()


def test_nothing_is_left_behind_in_the_directory_for_temporary_files(
    physics: Physics, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    Door(physics, HINGED)
    assert list(tmp_path.iterdir()) == []
