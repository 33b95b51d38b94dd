"""The compiled control steps against plain NumPy, and the whole-robot step against the extended matrix itself."""

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.planner.limits import acceleration_scale, limit_acceleration, limit_velocity
from stack.planner.preferences import preferred_velocity, window
from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.extended import extended_base, extended_step
from stack.planner.resolvers.pns import reference
from stack.planner.resolvers.rule_base import resolve_within_limits
from stack.planner.resolvers.step import arm_step, limit_table

FAR = np.full(8, np.inf)
NO_ROWS, NO_VALUES = np.zeros((0, 8)), np.zeros(0)


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("moma8")


def configurations(arm: ArmModel, count: int, smallest: float = 0.03) -> list[np.ndarray]:
    rng = np.random.default_rng(11)
    found: list[np.ndarray] = []
    while len(found) < count:
        q = rng.uniform(-2.5, 2.5, 8)
        if np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] > smallest:
            found.append(q)
    return found


def columns_at(arm: ArmModel, q: np.ndarray) -> np.ndarray:
    x, y, _ = arm.pose(q)[:3, 3]
    return np.array([[1.0, 0, 0, 0, 0, 0], [-y, x + 0.15, 0, 0, 0, 1.0]]).T


def test_arm_step_is_preferences_then_null_space_then_rows(arm: ArmModel) -> None:
    rng = np.random.default_rng(12)
    table = limit_table(-FAR, FAR, np.ones(8), np.full(8, 1e3))
    for q in configurations(arm, 100):
        wishes = np.array([rng.normal(size=8), rng.uniform(0, 0.5, 8), rng.uniform(0.1, 1.0, 8)])
        weight, twist = np.diag(rng.uniform(0.2, 5.0, 8)), 0.1 * rng.normal(size=6)
        row, value = np.eye(8)[rng.integers(8)][None], 0.1 * rng.normal(size=1)
        z = 0.7 * wishes[1] * np.tanh((wishes[0] - q) / wishes[2])
        jacobian = arm.jacobian(q)
        wanted, unconstrained, sigma = reference(jacobian, twist, weight, z, row, value, 0.01)
        got = arm_step(jacobian, twist, q, wishes, 0.7, weight, table, row, value, epsilon_restriction=1e-12)
        np.testing.assert_allclose(got.dq, wanted, atol=1e-9 * (1.0 + np.abs(wanted).max()))
        np.testing.assert_allclose(got.dq_unconstrained, unconstrained, atol=1e-10)
        np.testing.assert_allclose(got.sigma, sigma, atol=1e-13)
        assert (got.scale, got.status) == (1.0, Status.CONSTRAINED)


def test_arm_step_holds_limits_as_the_rule_base_around_any_resolver_does(arm: ArmModel) -> None:
    """Joints in their zones, fast recovery from outside, and a bound on the speed that slows everything else down."""
    rng = np.random.default_rng(13)
    limits = np.full(8, 2.2)
    no_wish = np.array([np.zeros(8), np.zeros(8), np.ones(8)])
    for bound in (1e3, 0.5):
        table = limit_table(-limits, limits, rng.uniform(0.2, 0.6, 8), np.full(8, bound))
        restricted = slowed = 0
        for q in configurations(arm, 60):
            twist, weight = 0.1 * rng.normal(size=6), np.diag(rng.uniform(0.2, 5.0, 8))
            got = arm_step(arm.jacobian(q), twist, q, no_wish, 1.0, weight, table, NO_ROWS, NO_VALUES)
            problem = Problem(arm.jacobian(q), twist, B=weight, lower=table[5], upper=table[6])
            wanted, limited = resolve_within_limits(RESOLVERS["pns"], problem, q, table)
            if got.scale < 1.0 or got.status == Status.DEGRADED:
                slowed += 1
                assert np.abs(got.dq).max() <= bound
                if got.status != Status.DEGRADED:
                    np.testing.assert_allclose(arm.jacobian(q) @ got.dq, got.scale * twist, atol=1e-9)
                continue
            np.testing.assert_allclose(got.dq, wanted.dq, atol=1e-8)
            np.testing.assert_array_equal(got.limited, limited)
            restricted += limited.any()
        assert restricted > 10
        assert (slowed > 5) == (bound < 1.0)


def test_arm_step_slows_down_on_the_path(arm: ArmModel) -> None:
    table = limit_table(-FAR, FAR, np.ones(8), np.full(8, 0.4))
    wishes = np.array([np.zeros(8), np.full(8, 0.3), np.full(8, 0.3)])
    slowed = 0
    for q in configurations(arm, 100):
        twist = np.array([0.3, -0.2, 0.2, 0.3, 0.2, -0.4])
        got = arm_step(arm.jacobian(q), twist, q, wishes, 1.0, np.eye(8), table, NO_ROWS, NO_VALUES)
        assert np.abs(got.dq).max() <= 0.4
        np.testing.assert_allclose(arm.jacobian(q) @ got.dq, got.scale * twist, atol=1e-9)
        z = preferred_velocity(q, *wishes)
        solution = RESOLVERS["pns"](Problem(arm.jacobian(q), twist, z=z, lower=-table[6], upper=table[6]))
        assert got.scale == pytest.approx(solution.scale, abs=1e-9)
        slowed += got.scale < 1.0
    assert slowed > 50


def test_a_sudden_stop_under_acceleration_bounds_changes_all_joints_in_step(arm: ArmModel) -> None:
    q = configurations(arm, 1)[0]
    moving = RESOLVERS["pns"](Problem(arm.jacobian(q), np.array([0.2, 0, 0, 0, 0, 0]))).dq
    table = limit_table(-FAR, FAR, np.ones(8), np.ones(8))
    table[5], table[6] = moving - 0.02, moving + 0.02
    wishes = np.array([np.zeros(8), np.zeros(8), np.ones(8)])
    got = arm_step(arm.jacobian(q), np.zeros(6), q, wishes, 1.0, np.eye(8), table, NO_ROWS, NO_VALUES)
    assert np.abs(got.dq - moving).max() <= 0.02 + 1e-15
    np.testing.assert_allclose(got.dq / np.linalg.norm(got.dq), moving / np.linalg.norm(moving), atol=1e-12)
    assert got.status == Status.DEGRADED


def test_base_of_the_extended_null_space(arm: ArmModel) -> None:
    for q in configurations(arm, 50):
        jacobian, columns = arm.jacobian(q), columns_at(arm, q)
        base = extended_base(*decompose(jacobian), columns, 0.01)
        extended = np.hstack([jacobian, columns])
        np.testing.assert_allclose(base @ base.T, np.eye(4), atol=1e-12)
        np.testing.assert_allclose(extended @ base.T, 0.0, atol=1e-12)
        null = np.linalg.svd(extended)[2][6:]
        np.testing.assert_allclose(base.T @ base, null.T @ null, atol=1e-11)


def test_base_stays_orthonormal_where_the_arm_is_singular(arm: ArmModel) -> None:
    q = np.array([0.3, 0.7, -1.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    base = extended_base(*decompose(arm.jacobian(q)), columns_at(arm, q), 0.05)
    np.testing.assert_allclose(base @ base.T, np.eye(4), atol=1e-12)


def test_extended_step_is_the_optimum_for_the_extended_matrix(arm: ArmModel) -> None:
    rng = np.random.default_rng(13)
    table = limit_table(np.full(10, -np.inf), np.full(10, np.inf), np.ones(10), np.full(10, 1e3))
    singular = [
        np.array([0.3, 0.7, -1.0, 0.0, 0.0, 0.0, 0.0, 0.2]),
        np.array([0.3, 0.7, 0.0, -1.3, 1.5708, 0.0, 1e-3, 0.2]),
    ]
    for q in configurations(arm, 60) + singular:
        jacobian, columns, twist = arm.jacobian(q), columns_at(arm, q), 0.1 * rng.normal(size=6)
        weight, z = np.diag(rng.uniform(0.2, 5.0, 10)), 0.2 * rng.normal(size=10)
        got = extended_step(
            jacobian, columns, twist, np.append(q, (0.0, 0.0)), z, weight, table, np.zeros((0, 10)), NO_VALUES,
            epsilon=0.02,
        )  # fmt: skip
        extended = np.hstack([jacobian, columns])
        if np.linalg.svd(extended, compute_uv=False)[-1] < 0.02:
            assert got.status == Status.SINGULAR
            continue
        system = np.block([[weight, extended.T], [extended, np.zeros((6, 6))]])
        wanted = np.linalg.solve(system, np.concatenate([weight @ z, twist]))[:10]
        np.testing.assert_allclose(got.dq, wanted, atol=1e-9 * (1.0 + np.abs(wanted).max()))
        assert got.status == Status.OK


def test_arguments_are_not_written_to(arm: ArmModel) -> None:
    q = configurations(arm, 1)[0]
    arguments = [
        arm.jacobian(q), np.full(6, 0.5), q, np.array([q + 0.1, np.full(8, 0.2), np.ones(8)]), 1.0, np.eye(8),
        limit_table(q - 0.3, q + 0.01, np.full(8, 0.1), np.full(8, 0.3)), np.eye(8)[:1], np.array([0.01]),
    ]  # fmt: skip
    before = [np.copy(a) for a in arguments]
    arm_step(*arguments)
    for one, other in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(one, other)


def test_limit_table_refuses_zones_that_overlap() -> None:
    with pytest.raises(ValueError, match=r"padding\[0\] is 0.6"):
        limit_table(np.zeros(1), np.ones(1), np.full(1, 0.6), np.ones(1))
    with pytest.raises(ValueError, match=r"dq_max\[0\] is 0.0"):
        limit_table(np.zeros(1), np.ones(1), np.full(1, 0.1), np.zeros(1))


def test_window_starts_and_ends_without_a_jump_in_acceleration() -> None:
    assert [window(t, 2.0) for t in (-1.0, 0.0, 1.0, 2.0, 3.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert window(1e-4, 2.0) < 1e-8
    assert 1.0 - window(2.0 - 1e-4, 2.0) < 1e-8
    assert window(0.0, 0.0) == 1.0


def test_preferred_velocity_saturates_and_vanishes_at_the_goal() -> None:
    z = preferred_velocity(np.zeros(3), np.array([10.0, 0.0, -0.1]), np.array([0.3, 0.3, 0.3]), np.full(3, 0.5))
    np.testing.assert_allclose(z, [0.3, 0.0, 0.3 * np.tanh(-0.2)])


def test_limiters_tell_whether_they_limited() -> None:
    value, limited = limit_velocity(np.array([2.0, -0.5]), np.ones(2))
    np.testing.assert_allclose(value, [1.0, -0.25])
    assert limited
    assert not limit_velocity(np.array([1.0, -0.5]), np.ones(2))[1]
    value, limited = limit_acceleration(np.array([1.0, 0.5]), np.zeros(2), np.full(2, 10.0), 0.01)
    np.testing.assert_allclose(value, [0.1, 0.05])
    assert limited
    assert not limit_acceleration(np.array([0.1, 0.05]), np.zeros(2), np.full(2, 10.0), 0.01)[1]


def test_share_of_a_motion_within_the_accelerations() -> None:
    share, reachable = acceleration_scale(np.array([1.0, -0.5]), np.zeros(2), np.full(2, 10.0), 0.01)
    assert (share, reachable) == (pytest.approx(0.1), True)
    share, reachable = acceleration_scale(np.array([1.0, -0.5]), np.array([0.5, -0.25]), np.full(2, 10.0), 0.01)
    assert (share, reachable) == (pytest.approx(0.6), True)
    share, reachable = acceleration_scale(np.array([1.0, 0.5]), np.array([0.5, -0.5]), np.full(2, 10.0), 0.01)
    assert not reachable
    assert 0.0 <= share <= 0.5
