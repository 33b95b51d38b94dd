"""The loops of moma8 are stable in every posture, with the arm bolted down and with the platform free to move."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.servo import load_servo_parameters

DT = 1e-3


def mass_matrices(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the arm on a fixed base, and as seen by its joints on a floating one, (count, 8, 8) each."""
    arm = ArmModel.load("moma8")
    urdf = str(robot_directory("moma8") / "robot.urdf")
    model = pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer())
    data = model.createData()
    joints = [model.getJointId(name) for name in arm.joint_names]
    rows = [model.joints[i].idx_v for i in joints]
    fixed, floating = [], []
    for q in np.random.default_rng(1).uniform(arm.q_min, arm.q_max, (count, 8)):
        fixed.append(arm.mass_matrix(q))
        whole = pin.neutral(model)
        whole[[model.joints[i].idx_q for i in joints]] = q
        mass = pin.crba(model, data, whole)
        mass = np.triu(mass) + np.triu(mass, 1).T
        floating.append(np.linalg.inv(np.linalg.inv(mass)[np.ix_(rows, rows)]))
    return np.array(fixed), np.array(floating)


@pytest.fixture(scope="module")
def masses() -> tuple[np.ndarray, np.ndarray]:
    return mass_matrices(400)


def test_damping_is_far_from_what_an_explicit_loop_stands(masses: tuple[np.ndarray, np.ndarray]) -> None:
    damping = np.diag(load_servo_parameters("moma8").velocity_gain[2:])
    for matrices in masses:
        fastest = np.abs(np.linalg.eigvals(np.linalg.solve(matrices, damping))).max()
        assert fastest * DT < 1.0  # 2 is the limit


def test_sampled_loops_have_all_their_poles_well_inside_the_unit_circle(masses: tuple[np.ndarray, np.ndarray]) -> None:
    """Linearised about any posture: PyBullet's semi-implicit Euler step with the cascade's torque held over it."""
    servo = load_servo_parameters("moma8")
    k_v, k_i = np.diag(servo.velocity_gain[2:]), np.diag(servo.integral_gain[2:])
    k_p = np.diag(servo.position_gain[2:])
    eye, nothing = np.eye(8), np.zeros((8, 8))
    slowest = 0.0
    for matrices in masses:
        for mass in matrices[:150]:
            inverse = np.linalg.inv(mass)
            error = np.hstack([-k_p, -eye, nothing])  # v_c - v, from position, velocity, integral
            integral = np.hstack([nothing, nothing, eye]) + DT * k_i @ error
            velocity = np.hstack([nothing, eye, nothing]) + DT * inverse @ (k_v @ error + integral)
            position = np.hstack([eye, nothing, nothing]) + DT * velocity
            poles = np.linalg.eigvals(np.vstack([position, velocity, integral]))
            slowest = max(slowest, np.abs(poles).max())
            fast = poles[np.abs(np.log(np.abs(poles))) / DT > 40.0]
            assert (fast.real > 0.0).all()  # no mode rings from tick to tick
    assert slowest < np.exp(-1.5 * DT)  # every disturbance is gone within a few seconds
