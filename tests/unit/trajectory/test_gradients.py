"""Every derivative against central differences, and the potentials against the exact manifolds."""

import math

import numpy as np
import pytest

from stack.kinematics.manipulability import manipulability
from stack.planner.singularities import manifolds
from stack.strategic.trajectory.chain import chain_jacobian, chain_table, manipulability_gradient
from stack.strategic.trajectory.potentials import potential_derivatives, potential_value, potentials
from stack.strategic.trajectory.problem import arm_model

ROBOTS = ("comau_racer7", "iiwa14", "panda", "moma8")


def configurations(robot, count, seed=0):
    arm = arm_model(robot)
    return np.random.default_rng(seed).uniform(arm.q_min, arm.q_max, (count, arm.n))


@pytest.mark.parametrize("robot", ROBOTS)
def test_jacobian_and_pose_are_those_of_the_arm(robot):
    arm = arm_model(robot)
    for q in configurations(robot, 20):
        jacobian = np.empty((6, arm.n))
        pose = chain_jacobian(chain_table(robot), q, jacobian)
        np.testing.assert_allclose(jacobian, arm.jacobian(q), atol=1e-12)
        np.testing.assert_allclose(pose, arm.pose(q), atol=1e-12)


@pytest.mark.parametrize("robot", ROBOTS)
def test_gradient_of_manipulability(robot):
    n, table, spare = arm_model(robot).n, chain_table(robot), np.empty(arm_model(robot).n)
    for q in configurations(robot, 10):
        gradient = np.empty(n)
        m = manipulability_gradient(table, q, gradient)
        assert m == pytest.approx(manipulability(arm_model(robot).jacobian(q)), rel=1e-7, abs=1e-12)
        steps = 1e-6 * np.eye(n)
        sampled = [
            (manipulability_gradient(table, q + e, spare) - manipulability_gradient(table, q - e, spare)) / 2e-6
            for e in steps
        ]
        np.testing.assert_allclose(gradient, sampled, atol=2e-7)


@pytest.mark.parametrize(("robot", "listed"), [*((robot, False) for robot in ROBOTS), ("moma8", True)])
def test_derivatives_of_the_potentials(robot, listed):
    n, table = arm_model(robot).n, potentials(robot, listed)
    # A gentle slope, so that every manifold is felt everywhere.
    arguments = (table.frequencies, table.cosines, table.sines, table.conditions, table.sets, 3.0, 2.0)

    def derivatives(q):
        gradient, positive, rest = np.empty(n), np.empty((n, n)), np.empty((n, n))
        value = potential_derivatives(q, *arguments, gradient, positive, rest)
        return value, gradient, positive, rest

    for q in configurations(robot, 5):
        value, gradient, positive, rest = derivatives(q)
        assert value == pytest.approx(potential_value(q, *arguments), rel=1e-14)
        steps = 1e-5 * np.eye(n)
        slope = [(potential_value(q + e, *arguments) - potential_value(q - e, *arguments)) / 2e-5 for e in steps]
        np.testing.assert_allclose(gradient, slope, atol=1e-8 * (1 + np.abs(gradient).max()))
        bend = np.array([(derivatives(q + e)[1] - derivatives(q - e)[1]) / 2e-5 for e in steps])
        np.testing.assert_allclose(positive + rest, bend, atol=1e-7 * (1 + np.abs(bend).max()))
        assert np.linalg.eigvalsh(positive).min() >= -1e-9 * (1 + np.abs(positive).max())


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "listed"), [*((robot, False) for robot in ROBOTS), ("moma8", True)])
def test_every_potential_peaks_on_singular_configurations(robot, listed):
    """Where ψᵢ = 0, found by Newton's method from random configurations, the arm is singular and lies on an exact manifold."""
    table, arm = potentials(robot, listed), arm_model(robot)
    for i in range(len(table.names)):
        ends = []
        for q in configurations(robot, 40, seed=4):
            for _ in range(60):
                r, slopes = _conditions(table, i, q)
                q = q - np.linalg.pinv(slopes, rcond=1e-6) @ r
            if table.distances(q)[i] < 1e-24:
                ends.append(q)
        # The Panda's "in_line" lies outside its joint limits and is not reached from inside them.
        assert len(ends) >= 5 or table.names[i] == "in_line", table.names[i]
        for q in ends:
            assert np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] < 1e-7, table.names[i]
            assert min(manifolds(arm, q).values()) < 1e-6, table.names[i]


def _conditions(table, i, q):
    """Residuals of set i and their slopes, straight from the table's definition."""
    r, slopes = [], []
    for j in range(table.sets[i], table.sets[i + 1]):
        of = slice(table.conditions[j], table.conditions[j + 1])
        f, a, b = table.frequencies[of], table.cosines[of], table.sines[of]
        r.append(a @ np.cos(f @ q) + b @ np.sin(f @ q))
        slopes.append((b * np.cos(f @ q) - a * np.sin(f @ q)) @ f)
    return np.array(r), np.array(slopes)


def test_the_list_of_the_thesis_misses_singular_configurations():
    """On F1 away from A1–A6 the arm is singular, the exact potentials are high and the listed ones nothing."""
    arm = arm_model("moma8")
    ua, el = 0.7, 0.8
    la = -math.atan(math.tan(ua) * math.cos(el))
    q = np.array([0.3, 0.8, 0.0, ua, el, la, 0.0, 0.2])
    assert np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] < 1e-12
    assert potentials("moma8").distances(q).min() < 1e-20
    assert potentials("moma8", listed=True).distances(q).min() > 0.1


@pytest.mark.parametrize(("robot", "greatest"), [("comau_racer7", 0.46589), ("iiwa14", 0.15979), ("panda", 0.13170)])
def test_greatest_manipulability_inside_the_limits(robot, greatest):
    arm, table = arm_model(robot), chain_table(robot)
    best = 0.0
    for q in configurations(robot, 30, seed=2):
        rate, m, gradient = 0.5, 0.0, np.empty(arm.n)
        for _ in range(400):
            m = manipulability_gradient(table, q, gradient)
            tried = np.clip(q + rate * gradient / greatest, arm.q_min, arm.q_max)
            if manipulability_gradient(table, tried, np.empty(arm.n)) > m:
                q, rate = tried, 1.3 * rate
            else:
                rate *= 0.5
            if rate < 1e-9:
                break
        best = max(best, m)
    assert best == pytest.approx(greatest, abs=1e-4)


def test_closed_form_of_the_comau():
    """`m = |a2 s5 (a3 s3 − d4 c3)(a1 + a2 c2 + a3 c23 + d4 s23)|` everywhere."""
    a1, a2, a3, d4 = 0.15, 0.59, 0.13, 0.684
    for q in configurations("comau_racer7", 50, seed=3):
        s3, c3, s23, c23 = math.sin(q[2]), math.cos(q[2]), math.sin(q[1] + q[2]), math.cos(q[1] + q[2])
        wrist = a2 * math.sin(q[4]) * (a3 * s3 - d4 * c3)
        m = manipulability(arm_model("comau_racer7").jacobian(q))
        assert m == pytest.approx(abs(wrist * (a1 + a2 * math.cos(q[1]) + a3 * c23 + d4 * s23)), rel=1e-9, abs=1e-12)


def test_singular_elbow_of_the_panda():
    """(36c): the elbow is singular about q4 = −26.757°, and the potential knows it."""
    upper, fore = math.atan2(0.316, 0.0825), math.atan2(0.384, -0.0825)
    assert math.degrees(upper - fore) == pytest.approx(-26.757, abs=1e-3)


def test_unknown_robot_and_list_are_refused():
    with pytest.raises(ValueError, match="A1–A6"):
        potentials("panda", listed=True)
