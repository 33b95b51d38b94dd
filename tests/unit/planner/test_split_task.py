"""One cycle after the other through singularities: equal to the closed form where that will do, and what gives way where nothing will."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.kinematics.se3 import pose_difference, rotation_exp
from stack.kinematics.spherical_wrist import SphericalWrist
from stack.planner.problem import Status
from stack.planner.resolvers.constraint_optimisation import GaveWay, Weights
from stack.planner.split_task import SplitStep, SplitTask, chord, follow

CYCLE = 0.012
REGULAR = np.array([0.3, 1.4, -0.4, 0.4, 0.8, -0.5])
WRIST_SINGULAR = np.array([0.2, 1.9, -0.4, 0.5, 0.0, -0.3])
PASS_START = np.array([-0.462046, 1.798709, -0.299684, 1.558333, -0.460872, -1.591606])

Path = Callable[[float], np.ndarray]


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("kr15")


def smooth(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def path_from(pose: np.ndarray, shift: object, turn: object, duration: float) -> Path:
    def at(t: float) -> np.ndarray:
        share, moved = smooth(t / duration), pose.copy()
        moved[:3, 3] += share * np.asarray(shift, float)
        moved[:3, :3] = rotation_exp(share * np.asarray(turn, float)) @ moved[:3, :3]
        return moved

    return at


def run(arm: ArmModel, task: SplitTask, q: np.ndarray, path: Path, seconds: float) -> list[SplitStep]:
    """Follows `path`, time scaling included."""
    steps, dq, moved = list[SplitStep](), np.zeros(arm.n), 0.0
    for _ in range(round(seconds / CYCLE)):
        step = follow(arm, task, q, dq, lambda share, t=moved: path(t + share * CYCLE))  # type: ignore[misc]
        moved += CYCLE * (1.0 - step.time_scaling)
        q, dq = step.q, step.dq
        steps.append(step)
    return steps


def angles(steps: list[SplitStep]) -> np.ndarray:
    return np.degrees([np.linalg.norm(step.error[3:]) for step in steps])


@pytest.mark.parametrize(("beta", "degrees"), [(0.0, 1e-8), (1.0, 5e-4)])
def test_away_from_the_singularity_it_is_the_closed_form(arm: ArmModel, beta: float, degrees: float) -> None:
    task = SplitTask(CYCLE, Weights(beta=beta), switching=False)
    path = path_from(arm.pose(REGULAR), [0.05, 0.1, -0.05], [0.15, -0.1, 0.2], 2.0)
    steps = run(arm, task, REGULAR, path, 2.0)
    assert all(step.optimised for step in steps)
    assert angles(steps).max() < degrees
    wrist, q = SphericalWrist(arm), REGULAR
    for k, step in enumerate(steps):
        q = wrist.solve(path((k + 1) * CYCLE), q)
        np.testing.assert_allclose(np.degrees(step.q), np.degrees(q), atol=max(5.0 * degrees, 1e-7))


def test_switching_changes_nothing_but_the_work(arm: ArmModel) -> None:
    path = path_from(arm.pose(PASS_START), [0.0, 0.68, 0.0], [0, 0, 0], 4.0)
    switched = run(arm, SplitTask(CYCLE), PASS_START, path, 4.5)
    always = run(arm, SplitTask(CYCLE, switching=False), PASS_START, path, 4.5)
    q, q_always = (np.array([step.q for step in steps]) for steps in (switched, always))
    np.testing.assert_allclose(q, q_always, atol=1e-9)
    taken = [step.optimised for step in switched]
    assert 20 < sum(taken) < 120
    assert {(a, b) for a, b in pairwise(taken)} >= {(False, True), (True, False)}


def test_the_answer_of_two_linearisations_is_exact_in_translation(arm: ArmModel) -> None:
    path = path_from(arm.pose(PASS_START), [0.0, 0.68, 0.0], [0, 0, 0], 4.0)
    for iterations, metres in ((2, 1e-6), (3, 1e-9)):
        steps = run(arm, SplitTask(CYCLE, iterations=iterations), PASS_START, path, 4.5)
        assert max(np.linalg.norm(step.error[:3]) for step in steps) < metres


@pytest.mark.parametrize("direction", np.linspace(0.0, np.pi, 7))
def test_a_singularity_can_always_be_left(arm: ArmModel, direction: float) -> None:
    jacobian = arm.jacobian(WRIST_SINGULAR)
    lean, lost = jacobian[3:, 4], np.cross(jacobian[3:, 3], jacobian[3:, 4])
    turn = 0.3 * (np.cos(direction) * lean + np.sin(direction) * lost)
    steps = run(arm, SplitTask(CYCLE), WRIST_SINGULAR, path_from(arm.pose(WRIST_SINGULAR), [0, 0, 0], turn, 1.0), 3.0)
    assert angles(steps)[-1] < 1e-3
    assert abs(steps[-1].q[4]) > 0.25
    assert max(np.linalg.norm(step.error[:3]) for step in steps) < 1e-5


def test_the_way_out_does_not_wait_for_rounding_errors(arm: ArmModel) -> None:
    """At the singularity itself the linearised problem sees no gain in any motion; axes 4 and 6 start at once all the same."""
    q = np.array([0.0, 1.9, -0.4, 0.0, 0.0, 0.0])
    jacobian, here = arm.jacobian(q), arm.pose(q)
    lost = np.cross(jacobian[3:, 3], jacobian[3:, 4])
    there = here.copy()
    there[:3, :3] = rotation_exp(1e-3 * lost) @ here[:3, :3]
    step = follow(arm, SplitTask(CYCLE), q, np.zeros(6), chord(here, there))
    assert step.status == Status.SINGULAR
    assert abs(step.dq[3]) == pytest.approx(arm.ddq_max[3] * CYCLE)
    assert step.dq[5] == pytest.approx(-step.dq[3], rel=0.1)


def test_without_an_error_nothing_turns_at_the_singularity(arm: ArmModel) -> None:
    here = arm.pose(WRIST_SINGULAR)
    step = follow(arm, SplitTask(CYCLE), WRIST_SINGULAR, np.zeros(6), chord(here, here))
    np.testing.assert_allclose(step.dq, 0.0, atol=1e-9)


def test_a_stretched_arm_comes_back(arm: ArmModel) -> None:
    q = np.array([0.0, np.radians(45.0), 1.31796095, 0.0, np.radians(40.0), 0.0])
    pose = arm.pose(q)
    inwards = np.array([0.3, 0.0, 0.675]) - pose[:3, 3]
    path = path_from(pose, 0.2 * inwards / np.linalg.norm(inwards), [0, 0, 0], 1.0)
    steps = run(arm, SplitTask(CYCLE), q, path, 3.0)
    assert np.linalg.norm(pose_difference(path(2.0), arm.pose(steps[-1].q))) < 1e-6


def test_time_gives_way_before_translation_and_the_hand_stays_on_its_path(arm: ArmModel) -> None:
    """A quarter of a turn about the first axis, commanded at one and a half times the speed of that axis."""
    start = arm.pose(REGULAR)

    def path(t: float) -> np.ndarray:
        pose = start.copy()
        pose[:3] = rotation_exp([0.0, 0.0, -2.2 * smooth(t / 1.1)]) @ start[:3]
        return pose

    steps = run(arm, SplitTask(CYCLE), REGULAR, path, 4.0)
    slowed = [step for step in steps if GaveWay.TIME in step.gave_way]
    assert len(slowed) > 10
    assert all("path slowed down by" in step.message for step in slowed)
    assert max(abs(step.dq[0]) for step in steps) == pytest.approx(arm.dq_max[0])
    for step in steps:
        assert GaveWay.TRANSLATION not in step.gave_way
        position = arm.pose(step.q)[:3, 3]
        assert np.hypot(*position[:2]) == pytest.approx(np.hypot(*start[:2, 3]), abs=1e-5), "it left the path"
        assert position[2] == pytest.approx(start[2, 3], abs=1e-5)
    assert np.linalg.norm(pose_difference(path(2.0), arm.pose(steps[-1].q))) < 1e-6, "it did not arrive"


def test_a_task_that_holds_exactly_in_all_rows_is_only_slowed_down(arm: ArmModel) -> None:
    path = path_from(arm.pose(REGULAR), [0.0, 0.0, 0.0], [0.0, 0.0, -1.8], 0.7)
    steps = run(arm, SplitTask(CYCLE, exact=(True,) * 6), REGULAR, path, 2.5)
    assert {step.gave_way for step in steps} == {GaveWay.NOTHING, GaveWay.TIME}
    assert max(np.linalg.norm(step.error) for step in steps) < 1e-4
    assert np.linalg.norm(pose_difference(path(1.0), arm.pose(steps[-1].q))) < 1e-6


def test_after_an_impossible_stretch_it_comes_back_to_the_path(arm: ArmModel) -> None:
    """Commanded with twice the acceleration that axis 1 has: it leaves the path, says so, waits for itself, and arrives."""
    start = arm.pose(REGULAR)

    def path(t: float) -> np.ndarray:
        pose = start.copy()
        pose[:3] = rotation_exp([0.0, 0.0, -1.0 * smooth(t / 0.5)]) @ start[:3]
        return pose

    steps = run(arm, SplitTask(CYCLE), REGULAR, path, 5.0)
    lost = [step for step in steps if GaveWay.TRANSLATION in step.gave_way]
    assert lost
    assert all(step.status == Status.INFEASIBLE and step.time_scaling == 1.0 for step in lost)
    assert np.linalg.norm(pose_difference(path(1.0), arm.pose(steps[-1].q))) < 1e-3


def test_the_orientation_bound_gives_way_before_time_and_is_named(arm: ArmModel) -> None:
    path = path_from(arm.pose(PASS_START), [0.0, 0.68, 0.0], [0, 0, 0], 4.0)
    steps = run(arm, SplitTask(CYCLE, error_bound=np.radians(0.5)), PASS_START, path, 4.5)
    missed = [step for step in steps if step.gave_way]
    assert {step.gave_way for step in missed} == {GaveWay.ORIENTATION_BOUND}
    assert all("exceeds its bound 0.00873" in step.message and step.status == Status.DEGRADED for step in missed)
    assert max(step.time_scaling for step in steps) == 0.0


def test_an_orientation_bound_that_can_be_kept_is_kept(arm: ArmModel) -> None:
    path = path_from(arm.pose(PASS_START), [0.0, 0.60, 0.0], [0, 0, 0], 4.0)
    free = run(arm, SplitTask(CYCLE), PASS_START, path, 4.5)
    peak = max(np.abs(step.error[3:]).max() for step in free)
    bounded = run(arm, SplitTask(CYCLE, error_bound=0.97 * peak), PASS_START, path, 4.5)
    assert not any(step.gave_way for step in bounded)
    assert max(np.abs(step.error[3:]).max() for step in bounded) < 0.971 * peak


def test_an_impossible_command_is_named_and_keeps_the_limits(arm: ArmModel) -> None:
    here = arm.pose(REGULAR)
    there = here.copy()
    there[:3, 3] += [3.0, -2.0, 1.0]
    step = follow(arm, SplitTask(CYCLE), REGULAR, np.zeros(6), chord(there, there))
    assert step.status == Status.INFEASIBLE
    assert GaveWay.TRANSLATION in step.gave_way
    assert "exact part missed by" in step.message
    assert step.time_scaling == 1.0
    assert (np.abs(step.dq) <= arm.ddq_max * CYCLE * (1 + 1e-9)).all()


def test_start_outside_a_limit_moves_back_inside(arm: ArmModel) -> None:
    q = REGULAR.copy()
    q[4] = arm.q_max[4] + 0.05
    pose = arm.pose(q)
    steps = run(arm, SplitTask(CYCLE), q, lambda t: pose, 3.0)
    ways = np.array([step.q[4] for step in steps])
    assert (np.diff(ways) <= 1e-12).all(), "it moved outwards"
    assert ways[-1] <= arm.q_max[4] + 1e-3
    assert max(np.linalg.norm(step.error[:3]) for step in steps) < 1e-5, (
        "the hand has nothing to do with that joint's limit"
    )


def test_at_a_joint_limit_it_brakes_in_time_and_comes_back(arm: ArmModel) -> None:
    q = REGULAR.copy()
    q[0] = arm.q_max[0] - 0.3
    start = arm.pose(q)

    def around(t: float) -> np.ndarray:
        """About the first axis, 0.6 rad out and back: twice as far as the limit allows."""
        turn = rotation_exp([0.0, 0.0, 0.6 * (smooth(t / 1.0) - smooth((t - 1.5) / 1.0))])
        pose = start.copy()
        pose[:3] = turn @ start[:3]
        return pose

    steps = run(arm, SplitTask(CYCLE), q, around, 4.0)
    assert max(step.q[0] for step in steps) <= arm.q_max[0] + 1e-9
    speeds = np.array([step.dq for step in steps])
    assert (np.abs(np.diff(speeds, axis=0)) <= arm.ddq_max * CYCLE * (1 + 1e-9)).all()


def test_a_chord_between_two_poses(arm: ArmModel) -> None:
    here, there = arm.pose(REGULAR), arm.pose(REGULAR + 0.1)
    way = pose_difference(there, here)
    np.testing.assert_allclose(pose_difference(chord(here, there)(0.25), here), 0.25 * way, atol=1e-12)
    np.testing.assert_allclose(chord(here, there)(1.0), there, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"cycle_s": 0.0}, "cycle_s"),
        ({"cycle_s": 0.01, "exact": (True,)}, "exact"),
        ({"cycle_s": 0.01, "iterations": 0}, "iterations"),
        ({"cycle_s": 0.01, "error_bound": float("nan")}, "error_bound"),
    ],
)
def test_what_is_wrong_is_named(arguments: dict[str, object], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        SplitTask(**arguments)  # type: ignore[arg-type]
