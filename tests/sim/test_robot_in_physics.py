"""The robot stands, tracks, drives and does not tip; PyBullet and the analytic model are one robot."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.bullet import pybullet
from sim.physics import BRAKE_SHARE, Physics, PhysicsParameters, RobotNames
from sim.slip import SlipParameters
from sim.world import World, WorldParameters
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory

URDF = robot_directory("moma8") / "robot.urdf"
NO_SLIP = SlipParameters(sigma=0.0)
ARM_BASE = np.array([0.15, 0.0, 0.35])


def heading(pose: np.ndarray) -> float:
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def test_tcp_link_is_where_the_arm_model_says(rig: Callable[..., Any]) -> None:
    one = rig()
    arm = one.arm
    random = np.random.default_rng(3)
    mount = np.eye(4)
    mount[:3, 3] = ARM_BASE
    for q in random.uniform(arm.q_min, arm.q_max, (20, 8)):
        platform = np.eye(4)
        platform[:2, 3] = random.uniform(-2, 2, 2)
        one.world.physics.place(platform, q)
        expected = platform @ mount @ arm.pose(q)
        assert one.world.physics.pose_WE() == pytest.approx(expected, abs=1e-6)  # PyBullet reads angles as floats
        assert one.world.physics.pose_WB() == pytest.approx(platform, abs=1e-6)


def test_weight_stands_on_the_wheels(rig: Callable[..., Any]) -> None:
    physics = rig().world.physics
    links = range(-1, pybullet.getNumJoints(physics.robot, physicsClientId=physics.client))
    mass = sum(pybullet.getDynamicsInfo(physics.robot, i, physicsClientId=physics.client)[0] for i in links)
    loads = physics.floor_loads()
    assert loads.sum() == pytest.approx(9.81 * mass, rel=1e-3)
    assert loads.min() > 80.0


def test_parked_on_gravity_feed_forward_it_stays_for_twenty_seconds(rig: Callable[..., Any]) -> None:
    one = rig()
    before = one.world.truth(0)
    for _ in range(2000):
        one.cycle()
    after = one.world.truth(0)
    assert np.abs(after.q - before.q).max() < 1e-6
    assert np.abs(after.dq).max() < 1e-6
    assert np.linalg.norm(after.pose_WE[:3, 3] - before.pose_WE[:3, 3]) < 1e-4
    assert abs(heading(after.pose_WB) - heading(before.pose_WB)) < 1e-4


def test_brakes_hold_the_arm_without_power(rig: Callable[..., Any]) -> None:
    one = rig()
    one.world.plant.brake([True] * 10)
    one.world.plant.write(np.zeros(10))
    before = one.world.truth(0)
    for _ in range(3000):
        one.world.step()
    after = one.world.truth(0)
    assert np.abs(after.q - before.q).max() < 1e-4
    assert np.linalg.norm(after.pose_WB[:2, 3] - before.pose_WB[:2, 3]) < 5e-4


def test_brakes_are_stronger_than_gravity_in_any_posture(rig: Callable[..., Any]) -> None:
    one = rig()
    draw = np.random.default_rng(1)
    worst = np.max([np.abs(one.arm.gravity(draw.uniform(one.arm.q_min, one.arm.q_max))) for _ in range(5000)], axis=0)
    assert (1.3 * worst < BRAKE_SHARE * one.world.physics.peak_torque).all()


def test_sine_on_all_joints_is_tracked_with_inverse_dynamics(rig: Callable[..., Any]) -> None:
    one = rig()
    amplitude, omega = np.array([0.3, 0.05, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3]), np.pi

    def wanted(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        grow = min(t / 2.0, 1.0)
        s = grow**3 * (10 - 15 * grow + 6 * grow**2)
        ds = 15 * grow**2 * (1 - grow) ** 2
        dds = 15 * grow * (1 - grow) * (1 - 2 * grow)
        sine, cosine = np.sin(omega * t), omega * np.cos(omega * t)
        velocity = ds * sine + s * cosine
        acceleration = dds * sine + 2 * ds * cosine - s * omega**2 * sine
        return one.home + amplitude * s * sine, amplitude * velocity, amplitude * acceleration

    joints: list[np.ndarray] = []
    hand: list[float] = []
    mount = np.eye(4)
    mount[:3, 3] = ARM_BASE

    def note() -> None:
        joints.append(one.position[2:] - wanted(one.ticks * 1e-3)[0])

    for k in range(600):
        q, dq, ddq = wanted((k + 1) * 0.01)
        one.cycle(q=q, effort=one.arm.inverse_dynamics(q, dq, ddq), after_tick=note)
        ideal = one.world.physics.pose_WB() @ mount @ one.arm.pose(q)
        hand.append(float(np.linalg.norm(one.world.physics.pose_WE()[:3, 3] - ideal[:3, 3])))
        assert not (one.flags & 15).any()
    rms = np.sqrt((np.array(joints[2000:]) ** 2).mean(axis=0))
    assert rms[[0, 2, 3, 4, 5, 6, 7]].max() < 0.3e-3
    assert rms[1] < 0.05e-3
    assert max(hand) < 0.6e-3


@pytest.mark.slow
def test_straight_and_turn_agree_with_odometry(rig: Callable[..., Any]) -> None:
    one = rig()
    physics = one.world.physics
    start, encoder = physics.pose_WB(), one.position[:2].copy()
    one.drive(0.4, 0.0, 5.0)
    there, way = physics.pose_WB(), (one.position[:2] - encoder) * 0.1
    assert way == pytest.approx([2.0, 2.0], rel=1e-3)
    assert np.linalg.norm(there[:3, 3] - start[:3, 3]) == pytest.approx(way.mean(), rel=2e-4)
    assert abs(heading(there)) < 2e-4
    encoder = one.position[:2].copy()
    one.drive(0.0, 1.0, 2 * np.pi)
    way = (one.position[:2] - encoder) * 0.1
    turned = (way[1] - way[0]) / 0.45
    assert turned == pytest.approx(2 * np.pi, rel=1e-3)
    assert heading(physics.pose_WB()) - heading(there) == pytest.approx(turned - 2 * np.pi, abs=2e-3)


def postures() -> list[np.ndarray]:
    """Stretched out level in eight directions, lift up and down, and the corners of the shoulder's range."""
    stretched = []
    for tower, lift in itertools.product(np.linspace(-np.pi, np.pi, 8, endpoint=False) * 0.94, (0.35, 1.15)):
        stretched.append(np.array([tower, lift, -np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0]))
        stretched.append(np.array([tower, lift, -np.pi / 2, np.pi / 2, -np.pi / 2, 0.0, 0.0, 0.0]))
    return stretched


@pytest.mark.slow
def test_it_does_not_tip_at_full_acceleration_in_any_stretched_posture(rig: Callable[..., Any]) -> None:
    lowest = np.inf
    for q in postures():
        one = rig(WorldParameters(slip=NO_SLIP, home=tuple(q), settle_s=0.2))
        loads = []
        for k in range(80):  # full acceleration, full curve, full braking
            t = k * 0.01
            v = 0.5 * min(t, 0.4) - 0.5 * max(0.0, t - 0.4)
            omega = min(t, 0.6)
            one.cycle(((v - omega * 0.225) / 0.1, (v + omega * 0.225) / 0.1))
            loads.append(one.world.physics.floor_loads())
        pose = one.world.physics.pose_WB()
        assert pose[2, 2] > 0.9999, f"tilted in {q}"
        lowest = min(lowest, np.array(loads).min())
        one.world.close()
    assert lowest > 10.0


def mechanical_energy(physics: Physics) -> float:
    """Kinetic and potential energy of all links (J), from PyBullet's own link states."""
    client, robot = physics.client, physics.robot
    total = 0.0
    for i in range(-1, pybullet.getNumJoints(robot, physicsClientId=client)):
        mass, inertia = (pybullet.getDynamicsInfo(robot, i, physicsClientId=client)[k] for k in (0, 2))
        if i < 0:
            position, quaternion = pybullet.getBasePositionAndOrientation(robot, physicsClientId=client)
            linear, angular = pybullet.getBaseVelocity(robot, physicsClientId=client)
        else:
            state = pybullet.getLinkState(robot, i, 1, 1, physicsClientId=client)
            position, quaternion, linear, angular = state[0], state[1], state[6], state[7]
        rotation = np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        spin = rotation.T @ np.array(angular)
        total += 0.5 * mass * np.dot(linear, linear) + 0.5 * spin @ (np.array(inertia) * spin)
        total += mass * 9.81 * position[2]
    return total


def test_a_limp_arm_falls_without_gaining_or_losing_energy(rig: Callable[..., Any]) -> None:
    physics = rig().world.physics
    before = mechanical_energy(physics)
    for _ in range(200):  # the lift falls 20 cm
        physics.set_torques(np.zeros(2), np.zeros(8))
        physics.step()
    physics.sense()
    fallen = 0.75 - physics.q[1]
    assert fallen > 0.15
    assert mechanical_energy(physics) == pytest.approx(before, abs=0.01 * 24.8 * 9.81 * fallen)


def test_motors_have_no_more_torque_than_the_urdf_says_and_none_beyond_their_speed(rig: Callable[..., Any]) -> None:
    one = rig()
    plant = one.world.plant
    plant.write(np.full(10, 1e4))
    plant.actuate()
    assert plant.joints.effort == pytest.approx(one.arm.effort_max)
    fast = 2.0 * one.arm.dq_max
    plant.joints.advance(np.full(8, 1e4), fast)
    assert plant.joints.effort == pytest.approx(np.zeros(8), abs=1e-9)
    plant.joints.advance(np.full(8, -1e4), fast)
    assert plant.joints.effort == pytest.approx(-one.arm.effort_max)


def test_reset_gives_the_same_bits_as_construction() -> None:
    world = World(URDF, WorldParameters(), seed=3)

    def run() -> bytes:
        command = np.zeros(10)
        command[:2] = 3.0, 2.0
        world.plant.write(command)
        for _ in range(300):
            world.step()
        truth = world.truth(0)
        return truth.pose_WE.tobytes() + truth.wheel_slip.tobytes() + world.force_sensor.read().tobytes()

    first = run()
    world.reset()
    assert run() == first
    world.close()


def test_start_pose_and_home_are_those_asked_for() -> None:
    home = (0.5, 0.6, -1.0, 0.3, -1.0, 0.2, 0.5, 0.1)
    world = World(URDF, WorldParameters(start=(1.0, -2.0, 0.7), home=home), seed=1)
    truth = world.truth(42)
    assert truth.t_ns == 42
    assert truth.pose_WB[:3, 3] == pytest.approx([1.0, -2.0, 0.0], abs=2e-4)
    assert heading(truth.pose_WB) == pytest.approx(0.7, abs=2e-4)
    assert truth.q == pytest.approx(home, abs=1e-4)
    world.close()


def test_robot_of_defaults_stands_at_the_home_of_its_file() -> None:
    assert WorldParameters().home == pytest.approx(ArmModel.load("moma8").home)


def test_a_missing_urdf_and_a_missing_link_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.urdf"):
        World(tmp_path / "nowhere.urdf")
    with pytest.raises(ValueError, match="no link claw"):
        Physics(URDF, PhysicsParameters(), RobotNames(gripper="claw"))
