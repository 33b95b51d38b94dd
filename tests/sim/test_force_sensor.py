"""Newton's law for a gripper of known mass: the sensor is right at rest and in motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim.bullet import pybullet
from sim.force_sensor import Compensation, ForceSensorParameters
from sim.physics import GRIPPER, OBSTACLES, PhysicsParameters
from sim.rotation import quaternion_of
from sim.slip import SlipParameters
from sim.world import WorldParameters
from stack.messages import Matrix, Vector

pytestmark = pytest.mark.slow

GRIPPER_KG = 1.0  # robot.urdf
CENTRE_E = np.array([0.0, 0.0, 0.10])  # of the gripper's mass, from the TCP
WEIGHT_W = np.array([0.0, 0.0, -9.81 * GRIPPER_KG])


def silent(compensation: Compensation) -> WorldParameters:
    return WorldParameters(slip=SlipParameters(sigma=0.0), force_sensor=ForceSensorParameters(0.0, 0.0, compensation))


def settled(one: Any, cycles: int = 150) -> None:
    for _ in range(cycles):
        one.cycle()
    one.world.force_sensor.read()
    one.cycle()


def test_at_rest_it_shows_the_weight_of_the_gripper(rig: Callable[..., Any]) -> None:
    one = rig(silent(Compensation.NONE))
    settled(one)
    rotation = one.world.physics.pose_WE()[:3, :3]
    reading = one.world.force_sensor.read()
    assert reading[:3] == pytest.approx(rotation.T @ WEIGHT_W, abs=1e-3)
    assert reading[3:] == pytest.approx(np.cross(CENTRE_E, rotation.T @ WEIGHT_W), abs=1e-3)


def test_weight_compensated_it_shows_nothing_at_rest(rig: Callable[..., Any]) -> None:
    one = rig(silent(Compensation.WEIGHT))
    settled(one)
    assert one.world.force_sensor.read() == pytest.approx(np.zeros(6), abs=1e-3)


@pytest.mark.parametrize("compensation", [Compensation.WEIGHT, Compensation.MOTION])
def test_it_shows_who_pulls_at_the_gripper(rig: Callable[..., Any], compensation: Compensation) -> None:
    one = rig(silent(compensation))
    force, torque = np.array([12.0, -5.0, 20.0]), np.array([0.5, -1.0, 0.3])
    one.world.before_step.append(lambda: one.world.physics.push(force, torque))
    settled(one, 250)
    rotation = one.world.physics.pose_WE()[:3, :3]
    expected = np.concatenate([rotation.T @ force, rotation.T @ torque])
    assert one.world.force_sensor.read() == pytest.approx(expected, abs=5e-3)
    assert one.world.truth(0).contact_wrench == pytest.approx(expected, abs=1e-6)


def test_the_drives_feel_the_same_pull(rig: Callable[..., Any]) -> None:
    one = rig()
    settled(one)
    before = one.output.copy()
    force, torque = np.array([12.0, -5.0, 20.0]), np.array([0.5, -1.0, 0.3])
    one.world.before_step.append(lambda: one.world.physics.push(force, torque))
    for _ in range(250):
        one.cycle()
    rotation = one.world.physics.pose_WE()[:3, :3]
    wrench = np.concatenate([rotation.T @ force, rotation.T @ torque])
    jacobian = one.arm.end_point_jacobian(one.world.physics.q)
    assert (one.output - before)[2:] == pytest.approx(-jacobian.T @ wrench, abs=0.02)


def swing(one: Any, cycles: int) -> tuple[list[Vector], list[Vector]]:
    """Swing the wrist fast; sensor readings (end-point frame) and Newton's mean gripper accelerations (world)."""
    centres: list[Vector] = []
    poses: list[Matrix] = []

    def note() -> None:
        poses.append(one.world.physics.pose_WE())
        centres.append(poses[-1][:3, :3] @ CENTRE_E + poses[-1][:3, 3])

    readings: list[Vector] = []
    accelerations: list[Vector] = []
    for k in range(cycles):
        t = (k + 1) * 0.01
        q = one.home + 0.15 * min(1.0, t) * np.sin(9.0 * t) * np.array([0, 0, 0, 0, 1, 0, 1, 1])
        one.cycle(q=q, after_tick=note)
        reading = one.world.force_sensor.read()
        if k > 0:
            # Positions are integrated with the velocity after the step: a difference is the velocity of its end.
            end, start = (centres[-1] - centres[-2]) / 1e-3, (centres[-11] - centres[-12]) / 1e-3
            accelerations.append((end - start) / 0.01)
            rotation = poses[-1][:3, :3]
            readings.append(rotation @ reading[:3])
    return readings, accelerations


def test_in_motion_it_shows_weight_and_inertia(rig: Callable[..., Any]) -> None:
    one = rig(silent(Compensation.NONE))
    readings, accelerations = swing(one, 150)
    expected = WEIGHT_W - GRIPPER_KG * np.array(accelerations)
    assert np.abs(np.array(accelerations)).max() > 4.0  # a test in earnest
    assert np.abs(np.array(readings) - expected).max() < 0.05


def test_in_motion_a_pull_is_told_from_inertia(rig: Callable[..., Any]) -> None:
    one = rig(silent(Compensation.MOTION))
    force = np.array([3.0, 6.0, -4.0])
    one.world.before_step.append(lambda: one.world.physics.push(force))
    readings, accelerations = swing(one, 150)
    assert np.abs(np.array(accelerations)).max() > 4.0
    assert np.array(readings) == pytest.approx(np.tile(force, (len(readings), 1)), abs=1e-6)


def test_a_grasped_weight_hangs_on_the_sensor(rig: Callable[..., Any]) -> None:
    one = rig(silent(Compensation.WEIGHT))
    physics = one.world.physics
    ball = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.03, physicsClientId=physics.client)
    at = physics.pose_WE()[:3, 3].tolist()
    body = pybullet.createMultiBody(2.0, ball, -1, at, physicsClientId=physics.client)
    pybullet.setCollisionFilterGroupMask(body, -1, 0, 0, physicsClientId=physics.client)
    grasp = physics.grasp(body, -1, [0.0, 0.0, 0.0])
    settled(one, 300)
    rotation = physics.pose_WE()[:3, :3]
    assert one.world.force_sensor.read()[:3] == pytest.approx(rotation.T @ [0.0, 0.0, -19.62], abs=0.02)
    held = np.array(pybullet.getBasePositionAndOrientation(body, physicsClientId=physics.client)[0])
    assert held == pytest.approx(physics.pose_WE()[:3, 3], abs=5e-5)
    physics.release(grasp)
    settled(one, 300)
    assert one.world.force_sensor.read()[:3] == pytest.approx(np.zeros(3), abs=0.02)


def test_noise_is_seeded_white_and_of_the_size_asked_for(rig: Callable[..., Any]) -> None:
    def record(seed: int) -> Matrix:
        parameters = WorldParameters(
            slip=SlipParameters(sigma=0.0), force_sensor=ForceSensorParameters(0.2, 0.01, Compensation.MOTION)
        )
        one = rig(parameters, seed=seed)
        readings = []
        for _ in range(600):
            one.world.force_sensor.advance()
            readings.append(one.world.force_sensor.read())
        return np.array(readings)

    first = record(1)
    assert np.array_equal(first, record(1))
    assert not np.array_equal(first, record(2))
    assert first[:, :3].std() == pytest.approx(0.2, rel=0.1)
    assert first[:, 3:].std() == pytest.approx(0.01, rel=0.1)
    assert abs(np.corrcoef(first[1:, 0], first[:-1, 0])[0, 1]) < 0.15


def test_read_twice_in_one_tick_it_repeats_itself(rig: Callable[..., Any]) -> None:
    one = rig()
    assert one.world.force_sensor.read() == pytest.approx(np.zeros(6), abs=0.5)  # before the first step
    one.world.step()
    first = one.world.force_sensor.read()
    assert np.array_equal(first, one.world.force_sensor.read())
    one.world.step()
    assert not np.array_equal(first, one.world.force_sensor.read())


def test_leaning_against_a_wall_is_felt_by_sensor_and_drives(rig: Callable[..., Any]) -> None:
    one = rig(WorldParameters(slip=SlipParameters(sigma=0.0), physics=PhysicsParameters(gripper_touches=True)))
    settled(one)
    before, physics = one.output.copy(), one.world.physics
    normal = physics.pose_WE()[:3, 0]  # across the gripper, which is 9 cm wide
    wall = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.1, 0.2, 0.2], physicsClientId=physics.client)
    pose = physics.pose_WE()
    middle = pose[:3, 3] + 0.05 * pose[:3, 2] + (0.045 + 0.1) * normal
    body = pybullet.createMultiBody(
        0.0, wall, -1, middle.tolist(), quaternion_of(pose[:3, :3]), physicsClientId=physics.client
    )
    pybullet.setCollisionFilterGroupMask(body, -1, OBSTACLES, GRIPPER, physicsClientId=physics.client)
    push = np.linalg.lstsq(one.arm.jacobian(one.home), np.concatenate([0.003 * normal, np.zeros(3)]), rcond=None)[0]
    for k in range(300):
        one.world.force_sensor.read()
        one.cycle(q=one.home + min(1.0, k / 100) * push)
    truth = one.world.truth(0)
    assert truth.contact_wrench[0] < -2.0
    assert one.world.force_sensor.read() == pytest.approx(truth.contact_wrench, abs=0.5)
    moved = one.arm.gravity(truth.q) - one.hold
    expected = -one.arm.end_point_jacobian(truth.q).T @ truth.contact_wrench + moved
    assert (one.output - before)[2:] == pytest.approx(expected, abs=0.3)
