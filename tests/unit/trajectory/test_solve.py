"""What a user of the trajectories relies on: limits, continuity, ends, replanning, poses, and the way around singularities."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stack.kinematics.manipulability import singular_values
from stack.strategic.trajectory import Objective, Status, TrajectoryLimits, TrajectoryProblem, Weights, solve
from stack.strategic.trajectory.lists_compared import compare_lists
from stack.strategic.trajectory.problem import arm_model, limits_of

ROBOTS = ("comau_racer7", "iiwa14", "panda", "moma8")


def pair(robot, seed):
    limits = limits_of(robot)
    return np.random.default_rng(seed).uniform(limits.q_min, limits.q_max, (2, limits.q_min.size))


def sampled(trajectory, count=400):
    rows = [trajectory.at(t) for t in np.linspace(0.0, trajectory.duration_s, count)]
    return (np.array([row[i] for row in rows]) for i in range(3))


def assert_inside(trajectory, limits, slack=1e-7):
    q, dq, ddq = sampled(trajectory)
    assert (q >= limits.q_min - slack).all()
    assert (q <= limits.q_max + slack).all()
    assert (np.abs(dq) <= limits.dq_max + slack).all()
    assert (np.abs(ddq) <= limits.ddq_max * (1 + slack)).all()


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    robot=st.sampled_from(ROBOTS),
    objective=st.sampled_from([Objective.NONE, Objective.POTENTIALS]),
    seed=st.integers(0, 10_000),
    push=st.sampled_from([2.0, 6.0, 100.0]),
)
def test_limits_hold_between_the_nodes_too(robot, objective, seed, push):
    own = limits_of(robot)
    limits = TrajectoryLimits(own.q_min, own.q_max, own.dq_max, np.full(own.q_min.size, push))
    start, goal = pair(robot, seed)
    found = solve(TrajectoryProblem(robot, start, goal, objective=objective, limits=limits))
    assert found.status is Status.SOLVED, found.message
    assert_inside(found, limits)
    np.testing.assert_allclose(found.q[0], start, atol=1e-12)
    np.testing.assert_allclose(found.q[-1], goal, atol=1e-9)
    np.testing.assert_allclose(found.dq[[0, -1]], 0.0, atol=1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
def test_position_and_velocity_are_continuous(robot):
    found = solve(TrajectoryProblem(robot, *pair(robot, 5), objective=Objective.POTENTIALS))
    for k in range(1, len(found.q)):
        before, after = found.at(k * found.step_s - 1e-9), found.at(k * found.step_s + 1e-9)
        np.testing.assert_allclose(before[0], after[0], atol=1e-7)
        np.testing.assert_allclose(before[1], after[1], atol=1e-6)
    ended = found.at(found.duration_s + 1.0)
    np.testing.assert_array_equal(ended[2], 0.0)


@pytest.mark.parametrize("robot", ROBOTS)
def test_replans_from_a_moving_state_with_the_guess(robot):
    start, goal = pair(robot, 8)
    problem = TrajectoryProblem(robot, start, goal, objective=Objective.POTENTIALS)
    first = solve(problem)
    q, dq, _ = first.at(0.3 * first.duration_s)
    limits = limits_of(robot)
    onward = np.clip(goal + 0.05, limits.q_min, limits.q_max)
    again = solve(TrajectoryProblem(robot, q, onward, dq_start=dq, objective=Objective.POTENTIALS), guess=first)
    assert again.status is Status.SOLVED
    np.testing.assert_allclose(again.at(0.0)[0], q, atol=1e-12)
    np.testing.assert_allclose(again.at(0.0)[1], dq, atol=1e-9)
    np.testing.assert_allclose(again.q[-1], onward, atol=1e-9)
    assert_inside(again, limits)


@pytest.mark.parametrize("robot", ROBOTS)
def test_goal_exactly_on_a_limit_is_reached(robot):
    start, goal = pair(robot, 5)
    limits = limits_of(robot)
    goal[0], start[2] = limits.q_max[0], limits.q_min[2]
    found = solve(TrajectoryProblem(robot, start, goal, objective=Objective.POTENTIALS))
    assert found.status is Status.SOLVED
    assert_inside(found, limits, slack=2e-6)


def test_a_heavier_time_weight_is_faster():
    start, goal = pair("iiwa14", 2)
    times = [
        solve(TrajectoryProblem("iiwa14", start, goal, weights=Weights(time=weight))).t_f for weight in (1.0, 556.0)
    ]
    assert times[1] < times[0]


def test_pose_goal_is_reached():
    arm = arm_model("iiwa14")
    start, goal = pair("iiwa14", 3)
    pose = arm.pose(goal)
    found = solve(TrajectoryProblem("iiwa14", start, pose_goal=pose))
    assert found.status is Status.SOLVED
    np.testing.assert_allclose(arm.pose(found.q[-1]), pose, atol=1e-7)


def test_pose_out_of_reach_and_goal_outside_the_limits_say_so():
    start, goal = pair("iiwa14", 3)
    far = np.eye(4)
    far[0, 3] = 5.0
    away = solve(TrajectoryProblem("iiwa14", start, pose_goal=far))
    assert away.status is Status.POSE_OUT_OF_REACH
    outside = solve(TrajectoryProblem("iiwa14", start, goal + 10.0))
    assert outside.status is Status.GOAL_OUTSIDE_LIMITS
    assert "limits" in outside.message


def test_a_start_that_cannot_stop_in_time_says_so():
    limits = limits_of("moma8")
    start, goal = limits.q_max.copy() * 0.5 + 0.5 * limits.q_min, limits.q_min * 0.5 + limits.q_max * 0.5
    start[0] = limits.q_max[0] - 0.01
    speed = np.zeros(8)
    speed[0] = limits.dq_max[0]
    assert solve(TrajectoryProblem("moma8", start, goal, dq_start=speed)).status is Status.START_CANNOT_STOP


def test_problems_that_make_no_sense_are_refused():
    start, goal = pair("panda", 1)
    with pytest.raises(ValueError, match="q_goal and pose_goal"):
        TrajectoryProblem("panda", start)
    with pytest.raises(ValueError, match="q_start"):
        TrajectoryProblem("panda", start[:3], goal)
    with pytest.raises(ValueError, match=r"weights\.time"):
        Weights(time=0.0)


@pytest.mark.parametrize(("robot", "points"), [("iiwa14", 20), ("moma8", 30)])
def test_a_guess_of_another_shape_is_refused_with_both_shapes(robot, points):
    guess = solve(TrajectoryProblem("iiwa14", *pair("iiwa14", 1)))
    problem = TrajectoryProblem(robot, *pair(robot, 1), points=points)
    with pytest.raises(
        ValueError, match=rf"guess\.q has shape \(30, 7\), must have \({points}, {problem.q_start.size}\)"
    ):
        solve(problem, guess=guess)


@pytest.mark.parametrize(("robot", "index"), [("iiwa14", 19), ("panda", 7)])
def test_manipulability_converges_where_speed_limits_bind(robot, index):
    """Many active speed limits make h stiff; a floor under its curvature once kept the steps from the optimum."""
    pytest.importorskip("casadi", reason="the benchmark's module needs it")
    from benchmarks.trajectory import pairs

    found = solve(pairs(robot, Objective.MANIPULABILITY, index + 1)[index])
    assert found.status is Status.SOLVED
    assert found.iterations < 200


@pytest.mark.parametrize("robot", ["iiwa14", "comau_racer7"])
def test_potentials_keep_the_middle_of_the_motion_away_from_singularities(robot):
    """Over some pairs, ends left out: the least singular value on the way is larger with the potentials than without."""
    arm, least = arm_model(robot), {}
    for objective in (Objective.NONE, Objective.POTENTIALS):
        found = [solve(TrajectoryProblem(robot, *pair(robot, seed), objective=objective)) for seed in range(12)]
        inner = [min(singular_values(arm.jacobian(q))[-1] for q in one.q[5:-5]) for one in found]
        least[objective] = np.median(inner)
    assert least[Objective.POTENTIALS] > least[Objective.NONE]


def test_exact_manifolds_keep_the_arm_freer_than_the_list_of_the_thesis():
    """Pairs of moma8 that cross F1 away from A1–A6: with the list the arm passes the singularity, with the exact sets around it."""
    least = compare_lists(6)
    assert (least[:, 2] > 5.0 * least[:, 1]).all()
    assert (least[:, 1] < 2e-3).all()
