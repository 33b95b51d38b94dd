"""Passing by and crossing the wrist singularity of a six-axis robot inside all its limits, and what gives way in which order."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stack.kinematics import ArmModel
from stack.planner.limits import velocity_bounds
from stack.planner.resolvers.constraint_optimisation import GaveWay, Weights, optimise_step

CYCLE = 0.012
SPEED = np.radians([152.0, 152.0, 152.0, 284.0, 293.0, 604.0])
STRENGTH = 4.0 * SPEED
FREE = np.full(6, 1e3)
AT_THE_SINGULARITY = np.array([0.2, 1.9, -0.4, 0.5, 0.0, -0.3])


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("kr15")


def smooth(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


class Follower:
    """Tracks an orientation path at a fixed TCP position, two linearisations per cycle."""

    def __init__(self, arm: ArmModel, q: np.ndarray, path: Callable[[float], Rotation], duration: float) -> None:
        self.arm, self.q, self.path, self.duration = arm, q, path, duration
        self.position, self.s, self.dq = arm.pose(q)[:3, 3], 0.0, np.zeros(6)
        self.orientation_error: list[float] = []
        self.position_error: list[float] = []
        self.theta: list[float] = []

    def cycle(self) -> GaveWay:
        here = self.path(self.s / self.duration)
        goal = self.path((self.s + CYCLE) / self.duration)
        low, high = velocity_bounds(self.q, self.dq, -FREE, FREE, SPEED, STRENGTH, 2.0, CYCLE)
        q = self.q
        for _ in range(2):
            pose, jacobian = self.arm.pose(q), self.arm.jacobian(q)
            moved = self.q - q
            turn = (goal * Rotation.from_matrix(pose[:3, :3]).inv()).as_rotvec() - jacobian[3:] @ moved
            shift = self.position - pose[:3, 3] - jacobian[:3] @ moved
            found = optimise_step(
                (jacobian[:3], shift, np.zeros(3)),
                (jacobian[3:], turn, (goal * here.inv()).as_rotvec()),
                low * CYCLE,
                high * CYCLE,
            )
            q = self.q + found.delta_q
        self.dq, self.q = found.delta_q / CYCLE, q
        self.s = min(self.s + CYCLE * (1.0 - found.time_scaling), self.duration)
        pose = self.arm.pose(q)
        error = self.path(self.s / self.duration) * Rotation.from_matrix(pose[:3, :3]).inv()
        self.orientation_error.append(float(error.magnitude()))
        self.position_error.append(float(np.abs(pose[:3, 3] - self.position).max()))
        self.theta.append(found.time_scaling)
        return found.gave_way

    def run(self, cycles: int) -> np.ndarray:
        """All joint velocities (cycles, 6); asserts that every limit holds in each of them."""
        speeds = [np.zeros(6)]
        for _ in range(cycles):
            self.cycle()
            speeds.append(self.dq)
        dq = np.array(speeds)
        assert (np.abs(dq) <= SPEED * (1 + 1e-9)).all()
        assert (np.abs(np.diff(dq, axis=0)) <= STRENGTH * CYCLE * (1 + 1e-6)).all()
        return dq


def wrist_axes(arm: ArmModel) -> tuple[np.ndarray, np.ndarray, Rotation]:
    """Direction of axis 5, the direction that is lost (across axes 4 and 5), and the orientation, at the singular configuration."""
    jacobian = arm.jacobian(AT_THE_SINGULARITY)
    fifth, fourth = jacobian[3:, 4], jacobian[3:, 3]
    return fifth, np.cross(fourth, fifth), Rotation.from_matrix(arm.pose(AT_THE_SINGULARITY)[:3, :3])


def start_at(arm: ArmModel, goal: Rotation) -> np.ndarray:
    """A configuration at the goal orientation and the singular configuration's TCP position, from a little beside the singularity."""
    position, q = arm.pose(AT_THE_SINGULARITY)[:3, 3], AT_THE_SINGULARITY + np.array([0, 0, 0, 0, 0.3, 0])
    for _ in range(200):
        pose = arm.pose(q)
        error = np.append(position - pose[:3, 3], (goal * Rotation.from_matrix(pose[:3, :3]).inv()).as_rotvec())
        q = q + np.linalg.lstsq(arm.jacobian(q), error, rcond=1e-6)[0]
    assert np.abs(error).max() < 1e-9
    return q


def test_passing_close_by_the_singularity_and_back(arm: ArmModel) -> None:
    fifth, lost, middle = wrist_axes(arm)
    near = Rotation.from_rotvec(np.radians(2.0) * fifth) * middle

    def path(x: float) -> Rotation:
        swing = np.radians(25.0) * (1.0 - 2.0 * (smooth(2 * x) if x < 0.5 else smooth(2 - 2 * x)))
        return Rotation.from_rotvec(swing * lost) * near

    follower = Follower(arm, start_at(arm, path(0.0)), path, 8.0)
    follower.run(int(9.0 / CYCLE))
    assert max(follower.position_error) < 1e-5
    assert np.degrees(max(follower.orientation_error)) < 4.0
    assert np.degrees(follower.orientation_error[-1]) < 0.01
    assert max(follower.theta) < 1e-12


def test_crossing_the_singularity_where_the_closed_form_would_step(arm: ArmModel) -> None:
    fifth, lost, middle = wrist_axes(arm)

    def path(x: float) -> Rotation:
        along = np.radians(20.0) * (1.0 - smooth(2 * x)) * fifth
        across = np.radians(20.0) * smooth(2 * x - 1.0) * lost
        return Rotation.from_rotvec(along + across) * middle

    follower = Follower(arm, start_at(arm, path(0.0)), path, 2.0)
    dq = follower.run(int(3.0 / CYCLE))
    assert np.abs(np.cumsum(dq, axis=0) * CYCLE)[:, [3, 5]].max() > np.radians(60.0)
    assert max(follower.position_error) < 1e-5
    assert np.degrees(max(follower.orientation_error)) < 5.0
    assert np.degrees(follower.orientation_error[-1]) < 0.1


def test_equals_the_closed_form_away_from_the_singularity(arm: ArmModel) -> None:
    jacobian = arm.jacobian(np.array([0.2, 1.9, -0.4, 0.5, 0.9, -0.3]))
    change = 1e-3 * np.array([1.0, -0.5, 0.3, 0.8, 0.2, -0.6])
    found = optimise_step(
        (jacobian[:3], change[:3], change[:3]), (jacobian[3:], change[3:], change[3:]), -np.ones(6), np.ones(6)
    )
    np.testing.assert_allclose(found.delta_q, np.linalg.solve(jacobian, change), atol=1e-9)
    assert found.gave_way == GaveWay.NOTHING
    assert found.message == ""


JACOBIAN = np.eye(3)[:, :3]


def planar(lower: float, wanted: float, turn: float, bound: float = np.inf) -> tuple[np.ndarray, float, GaveWay, str]:
    """One exact row (joint 0) and one approximate (joint 1), both steps limited to ±lower."""
    found = optimise_step(
        (JACOBIAN[:1], np.array([wanted]), np.array([wanted])),
        (JACOBIAN[1:2], np.array([turn]), np.array([turn])),
        -lower * np.ones(3),
        lower * np.ones(3),
        Weights(),
        bound,
    )
    return found.delta_q, found.time_scaling, found.gave_way, found.message


def test_order_of_giving_way() -> None:
    dq, theta, gave_way, _ = planar(0.1, 0.05, 0.12, bound=0.05)
    np.testing.assert_allclose(dq, [0.05, 0.1, 0.0], atol=1e-9)
    assert (theta, gave_way) == (0.0, GaveWay.NOTHING)
    dq, theta, gave_way, message = planar(0.1, 0.05, 0.3, bound=0.05)
    assert (theta, gave_way) == (0.0, GaveWay.ORIENTATION_BOUND)
    assert "exceeds its bound 0.05" in message
    dq, theta, gave_way, message = planar(0.1, 0.2, 0.0)
    assert theta == pytest.approx(0.5, abs=1e-6)
    assert gave_way == GaveWay.TIME
    assert dq[0] == pytest.approx(0.1)
    assert "path slowed down by 0.5" in message


def test_translation_gives_way_last_and_is_named() -> None:
    found = optimise_step(
        (JACOBIAN[:1], np.array([0.5]), np.array([0.1])),
        (np.zeros((0, 3)), np.zeros(0), np.zeros(0)),
        -0.1 * np.ones(3),
        0.1 * np.ones(3),
    )
    assert found.gave_way == GaveWay.TIME | GaveWay.TRANSLATION
    assert found.delta_q[0] == pytest.approx(0.1)
    assert "exact part missed by 0.3" in found.message


def test_a_task_without_approximate_part_is_an_untimed_path() -> None:
    nothing = (np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    found = optimise_step(
        (JACOBIAN[:2], np.array([0.4, 0.1]), np.array([0.4, 0.1])), nothing, -0.1 * np.ones(3), 0.1 * np.ones(3)
    )
    np.testing.assert_allclose(found.delta_q, [0.1, 0.025, 0.0], atol=1e-8)
    assert found.time_scaling == pytest.approx(0.75, abs=1e-7)


def test_crossed_bounds_do_not_crash_a_cycle() -> None:
    found = optimise_step(
        (JACOBIAN[:1], np.array([0.1]), np.array([0.1])),
        (JACOBIAN[1:2], np.array([0.1]), np.array([0.1])),
        np.array([0.3, -1.0, -1.0]),
        np.array([0.1, 1.0, 1.0]),
    )
    assert found.delta_q[0] == pytest.approx(0.2)
    assert GaveWay.TRANSLATION in found.gave_way
