"""The option that keeps the links off each other: its cover, its derivatives, what it changes."""

import numpy as np
import pytest

from stack.kinematics.proximity import BodyDistances
from stack.strategic.trajectory import Status, TrajectoryProblem, solve
from stack.strategic.trajectory.chain import chain_table
from stack.strategic.trajectory.problem import arm_model
from stack.strategic.trajectory.self_collision import add_nearness_derivatives, cover, nearness, sphere_gaps


def pair(robot, seed):
    arm = arm_model(robot)
    return np.random.default_rng(seed).uniform(arm.q_min, arm.q_max, (2, arm.n))


def least_distance(robot, found):
    distances = BodyDistances(arm_model(robot))
    ways = [found.at(t)[0] for t in np.linspace(0.0, found.duration_s, 60)]
    return min((near.distance for q in ways for near in distances.near(q, 0.5)), default=np.inf)


@pytest.mark.parametrize("robot", ["iiwa14", "moma8"])
def test_spheres_are_never_farther_apart_than_the_links(robot):
    links, distances = cover(robot), BodyDistances(arm_model(robot))
    for seed in range(30):
        q = pair(robot, seed)[0]
        own = min((near.distance for near in distances.near(q, 1.0)), default=np.inf)
        # Inside each other only the sign counts: depths of different shapes do not compare.
        assert sphere_gaps(chain_table(robot), q, links.spheres, links.pairs).min() <= max(own, 0.0) + 1e-6


def test_derivatives_of_the_nearness():
    """A wide clearance, so that every pair is felt; moma8 has a joint that slides."""
    links, table, n = cover("moma8"), chain_table("moma8"), 8
    chosen = np.ascontiguousarray(links.pairs[:: len(links.pairs) // 40])

    def slope(q):
        gradient, hessian = np.zeros(n), np.zeros((n, n))
        add_nearness_derivatives(table, q, links.spheres, chosen, 2.0, 1.5, gradient, hessian)
        return gradient, hessian

    for seed in range(3):
        q = pair("moma8", seed)[0]
        gradient, hessian = slope(q)
        steps = 1e-5 * np.eye(n)
        values = [[1.5 * nearness(table, q + sign * e, links.spheres, chosen, 2.0) for sign in (1, -1)] for e in steps]
        np.testing.assert_allclose(gradient, [(a - b) / 2e-5 for a, b in values], atol=1e-6 * np.abs(gradient).max())
        bend = [(slope(q + e)[0] - slope(q - e)[0]) / 2e-5 for e in steps]
        np.testing.assert_allclose(hessian, bend, atol=1e-6 * np.abs(hessian).max())


@pytest.mark.slow
def test_with_a_clearance_the_arm_goes_around_itself():
    start, goal = pair("moma8", 14)
    through = solve(TrajectoryProblem("moma8", start, goal))
    around = solve(TrajectoryProblem("moma8", start, goal, clearance=0.03))
    assert least_distance("moma8", through) < -0.05
    assert around.status is Status.SOLVED
    assert least_distance("moma8", around) > 0.0


def test_a_goal_at_which_the_links_meet_is_not_usable():
    links, table = cover("moma8"), chain_table("moma8")
    ends = [pair("moma8", seed)[0] for seed in range(100)]
    goal = next(q for q in ends if sphere_gaps(table, q, links.spheres, links.pairs).min() < -0.01)
    found = solve(TrajectoryProblem("moma8", ends[0], goal, clearance=0.03, points=12))
    assert not found.status.usable


def test_clearance_has_to_be_positive():
    with pytest.raises(ValueError, match="clearance is 0"):
        TrajectoryProblem("iiwa14", *pair("iiwa14", 1), clearance=0.0)
