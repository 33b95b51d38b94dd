"""What every robot's model promises: DH angles, derivatives that are derivatives, dynamics that keep energy."""

import numpy as np
import pinocchio as pin
import pytest

from stack.kinematics import ArmModel
from stack.kinematics.manipulability import manipulability
from stack.kinematics.robot_file import ROBOTS
from stack.kinematics.se3 import rotation_log
from tests.unit.kinematics.conftest import derivative, dh_frames

DEG = np.pi / 180

# Standard DH rows (revolute, d, a, alpha) as the papers print them, once more and by hand: robot.toml must agree.
PRINTED = {
    "moma8": [
        (True, 0, 0, 0), (False, 0, 0, -90), (True, 0.365, 0, 90), (True, -0.27, 0, -90),
        (True, 0, 0, 90), (True, -0.322, 0, -90), (True, 0, 0, 90), (True, -0.33, 0, 0),
    ],
    "planar3": [(True, 0, 3.0, 0), (True, 0, 2.5, 0), (True, 0, 2.0, 0)],
    "kr15": [
        (True, 0.675, 0.3, 90), (True, 0, 0.65, 0), (True, 0, 0.155, 90),
        (True, 0.6, 0, -90), (True, 0, 0, 90), (True, 0.14, 0, 0),
    ],
    "comau_racer7": [
        (True, 0.43, 0.15, 90), (True, 0, 0.59, 0), (True, 0, 0.13, 90),
        (True, 0.684, 0, -90), (True, 0, 0, 90), (True, 0.1, 0, 0),
    ],
    "iiwa14": [
        (True, 0.36, 0, -90), (True, 0, 0, 90), (True, 0.42, 0, -90), (True, 0, 0, 90),
        (True, 0.4, 0, -90), (True, 0, 0, 90), (True, 0.126, 0, 0),
    ],
    "panda": [
        (True, 0.333, 0, -90), (True, 0, 0, 90), (True, 0.316, 0.0825, 90), (True, 0, -0.0825, -90),
        (True, 0.384, 0, 90), (True, 0, 0.088, 90), (True, 0.107, 0, 0),
    ],
}  # fmt: skip


def rows(name: str) -> list[tuple[bool, float, float, float]]:
    return [(revolute, d, a, alpha * DEG) for revolute, d, a, alpha in PRINTED[name]]


def configurations(arm: ArmModel, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.q_min, arm.q_max, (count, arm.n))


def test_pose_and_joint_positions_are_those_of_the_dh_table(any_arm: ArmModel) -> None:
    for q in configurations(any_arm, 30):
        frames = dh_frames(rows(any_arm.name), q)
        np.testing.assert_allclose(any_arm.pose(q), frames[-1], rtol=0, atol=1e-12)
        # A lift's own motion is in its frame already, whereas DH counts it after the frame.
        starts = [f[:3, 3] for f in frames[:-1]]
        for i, (revolute, *_) in enumerate(rows(any_arm.name)):
            if not revolute:
                starts[i] = starts[i] + frames[i][:3, 2] * q[i]
        np.testing.assert_allclose(any_arm.joint_positions(q), [*starts, frames[-1][:3, 3]], rtol=0, atol=1e-12)


def test_jacobian_is_the_derivative_of_the_pose(any_arm: ArmModel) -> None:
    for q in configurations(any_arm, 10, seed=1):
        here = any_arm.pose(q)
        linear = derivative(lambda x: any_arm.pose(x)[:3, 3], q)
        angular = derivative(lambda x, r=here[:3, :3]: rotation_log(any_arm.pose(x)[:3, :3] @ r.T), q)
        np.testing.assert_allclose(any_arm.jacobian(q), np.vstack((linear, angular)), rtol=0, atol=1e-8)
        turn = np.kron(np.eye(2), here[:3, :3].T)
        np.testing.assert_allclose(any_arm.end_point_jacobian(q), turn @ any_arm.jacobian(q), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "joint", "k"), [("moma8", 6, 5), ("kr15", 4, 3), ("comau_racer7", 4, 3), ("iiwa14", 5, 4)]
)
def test_wrist_jacobian_is_the_derivative_of_the_wrist_centre(name: str, joint: int, k: int) -> None:
    arm = ArmModel.load(name)
    for q in configurations(arm, 5, seed=2):
        moved = derivative(lambda x: arm.joint_positions(x)[joint], q)
        np.testing.assert_allclose(arm.wrist_jacobian(q), moved[:, :k], rtol=0, atol=1e-8)
        np.testing.assert_allclose(moved[:, k:], 0.0, atol=1e-8)


def test_a_robot_without_wrist_centre_says_so() -> None:
    with pytest.raises(ValueError, match="panda has no spherical wrist"):
        ArmModel.load("panda").wrist_jacobian(np.zeros(7))


def test_limits_of_the_definition(moma8: ArmModel) -> None:
    np.testing.assert_allclose(moma8.q_min / DEG, [-170, 0.35 / DEG, -200, -170, -135, -170, -120, -175], atol=1e-9)
    np.testing.assert_allclose(moma8.q_max / DEG, [170, 1.15 / DEG, 20, 170, 135, 170, 120, 175], atol=1e-9)
    np.testing.assert_allclose(moma8.dq_max, [1.5, 0.25, 1.5, 1.5, 1.5, 2.5, 2.5, 2.5])
    np.testing.assert_allclose(moma8.ddq_max, [6, 1, 6, 6, 6, 12, 12, 12])


def test_limits_of_the_others() -> None:
    panda, kr15, racer = (ArmModel.load(name) for name in ("panda", "kr15", "comau_racer7"))
    assert panda.q_max[5] == pytest.approx(3.7525)
    assert panda.dq_max == pytest.approx([2.175] * 4 + [2.61] * 3)
    assert kr15.dq_max / DEG == pytest.approx([152, 152, 152, 284, 293, 604])
    assert kr15.ddq_max == pytest.approx(4 * kr15.dq_max)
    assert racer.q_min / DEG == pytest.approx([-165, -65, -78, -210, -135, -180])
    assert racer.q_max[1] / DEG == pytest.approx(175)


def test_home_and_preferred_lie_inside_the_limits_and_away_from_singularities(any_arm: ArmModel) -> None:
    for q in (any_arm.home, any_arm.preferred):
        assert np.all(q > any_arm.q_min + any_arm.padding)
        assert np.all(q < any_arm.q_max - any_arm.padding)
    task = any_arm.jacobian(any_arm.home)[:2] if any_arm.name == "planar3" else any_arm.jacobian(any_arm.home)
    assert manipulability(task) > 0.03


def test_efforts_hold_the_arm_everywhere(any_arm: ArmModel) -> None:
    """Standing still never asks for more than the rated torque; peak torque is two to three times as much or close."""
    held = np.max([np.abs(any_arm.gravity(q)) for q in configurations(any_arm, 500, seed=4)], axis=0)
    if any_arm.name in ("moma8", "iiwa14"):
        assert np.all(held <= any_arm.effort_rated)
    assert np.all(held <= any_arm.effort_max)
    assert np.all(any_arm.effort_rated < any_arm.effort_max)


def test_wrong_shapes_name_both(moma8: ArmModel) -> None:
    with pytest.raises(ValueError, match=r"q has shape \(7,\), expected \(8,\)"):
        moma8.pose(np.zeros(7))
    with pytest.raises(ValueError, match=r"q has shape \(8, 1\), expected \(8,\)"):
        moma8.state(np.zeros((8, 1)))
    with pytest.raises(ValueError, match=r"ddq has shape \(3,\), expected \(8,\)"):
        moma8.inverse_dynamics(np.zeros(8), np.zeros(8), np.zeros(3))
    with pytest.raises(ValueError, match=r"wrench has shape \(3,\), expected \(6,\)"):
        moma8.inverse_dynamics(np.zeros(8), np.zeros(8), np.zeros(8), wrench=np.zeros(3))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("call", ["pose", "jacobian", "state", "wrist_jacobian", "points", "mass_matrix", "gravity"])
def test_numbers_that_are_not_finite_are_refused_by_index(moma8: ArmModel, call: str, bad: float) -> None:
    q = moma8.home.copy()
    q[3] = bad
    with pytest.raises(ValueError, match="q is not finite at index 3"):
        getattr(moma8, call)(q)


def test_unknown_robot_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"robot 'moma9' is unknown; known are .*moma8"):
        ArmModel.load("moma9")


def test_inputs_stay_and_results_are_the_callers_own(moma8: ArmModel) -> None:
    q = moma8.home.copy()
    first = moma8.state(q)
    pose, jacobian, mass = first.pose.copy(), first.jacobian.copy(), moma8.mass_matrix(q)
    q += 0.3
    moma8.state(q)
    moma8.inverse_dynamics(q, q, q, base_acceleration=(1, 0, 0))
    assert np.array_equal(first.q, moma8.home)
    assert np.array_equal(first.pose, pose)
    assert np.array_equal(first.jacobian, jacobian)
    assert np.array_equal(moma8.mass_matrix(moma8.home), mass)
    with pytest.raises(ValueError, match="read-only"):
        moma8.q_min[0] = 0.0


def test_mass_matrix_and_inverse_dynamics_are_one_law(any_arm: ArmModel) -> None:
    rng = np.random.default_rng(5)
    for q in configurations(any_arm, 5, seed=5):
        ddq = rng.normal(size=any_arm.n)
        mass = any_arm.mass_matrix(q)
        np.testing.assert_allclose(mass, mass.T, rtol=0, atol=0)
        assert np.linalg.eigvalsh(mass)[0] > 0
        still = np.zeros(any_arm.n)
        difference = any_arm.inverse_dynamics(q, still, ddq) - any_arm.gravity(q)
        np.testing.assert_allclose(difference, mass @ ddq, rtol=1e-9, atol=1e-9)


def test_power_of_the_joints_becomes_energy(moma8: ArmModel) -> None:
    """d/dt (kinetic + potential energy) = q̇·τ, the potential found by integrating gravity torques along a path."""
    rng = np.random.default_rng(6)
    q, dq, ddq = rng.uniform(moma8.q_min, moma8.q_max), rng.normal(size=8), rng.normal(size=8)
    step = 1e-5

    def kinetic(t: float) -> float:
        velocity = dq + ddq * t
        return 0.5 * velocity @ moma8.mass_matrix(q + dq * t + 0.5 * ddq * t * t) @ velocity

    gained = (kinetic(step) - kinetic(-step)) / (2 * step) + dq @ moma8.gravity(q)
    assert dq @ moma8.inverse_dynamics(q, dq, ddq) == pytest.approx(gained, rel=1e-6)


def test_gripper_weighs_on_the_lift(moma8: ArmModel) -> None:
    """Standing still the lift carries what hangs on it: lift, six links, force sensor, gripper (and the TCP's gram)."""
    carried = 5.0 + 3.5 + 5 * 3.0 + 0.3 + 1.0 + 0.001
    assert moma8.gravity(moma8.home)[1] == pytest.approx(carried * 9.81, rel=1e-12)


def test_wrench_from_outside_is_felt_through_the_transposed_jacobian(moma8: ArmModel) -> None:
    """A weight of 10 N hung on the TCP acts in world axes; the same in end-point axes must cost the same torque."""
    q, still = moma8.home, np.zeros(8)
    pose = moma8.pose(q)
    pull = np.array([0.0, 0.0, -10.0])
    felt = moma8.inverse_dynamics(q, still, still, wrench=np.concatenate((pose[:3, :3].T @ pull, np.zeros(3))))
    np.testing.assert_allclose(felt - moma8.gravity(q), -moma8.jacobian(q)[:3].T @ pull, rtol=0, atol=1e-10)
    assert felt[1] - moma8.gravity(q)[1] == pytest.approx(10.0)


def test_driving_base_equals_the_whole_robot_on_a_planar_joint(moma8: ArmModel) -> None:
    """Linear base acceleration as gravity, yaw as a faster first joint: against the full model with x, y, θ of its own."""
    full = pin.buildModelFromUrdf(str(ROBOTS / "moma8" / "robot.urdf"), pin.JointModelPlanar())
    data = full.createData()
    rng = np.random.default_rng(7)
    q, dq, ddq = rng.uniform(moma8.q_min, moma8.q_max), rng.normal(size=8), rng.normal(size=8)
    velocity, rate = np.array([0.3, 0.1, 0.7]), np.array([0.5, -0.4, 0.9])  # vx, vy, ω in the base's axes; their rates
    position = pin.neutral(full)
    start = full.joints[full.getJointId("tower_rotate")]
    position[start.idx_q : start.idx_q + 8] = q
    spin, push = np.zeros(full.nv), np.zeros(full.nv)
    spin[:3], push[:3] = velocity, rate
    spin[start.idx_v : start.idx_v + 8], push[start.idx_v : start.idx_v + 8] = dq, ddq
    whole = pin.rnea(full, data, position, spin, push)[start.idx_v : start.idx_v + 8]

    omega, alpha = velocity[2], rate[2]
    x = 0.15  # of the arm's base: Euler and centripetal acceleration there, then that of the reference point
    a = np.array([rate[0] - omega * velocity[1] - omega**2 * x, rate[1] + omega * velocity[0] + alpha * x, 0.0])
    yaw = np.eye(8)[0]
    arm_only = moma8.inverse_dynamics(q, dq + omega * yaw, ddq + alpha * yaw, base_acceleration=a)
    np.testing.assert_allclose(arm_only, whole, rtol=1e-9, atol=1e-9)
