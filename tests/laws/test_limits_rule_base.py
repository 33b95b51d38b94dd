"""The joint-limit rule base: what it guarantees at every configuration, and that it moves without jumps."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.planner.limits import velocity_bounds
from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.rule_base import resolve_within_limits
from stack.planner.resolvers.step import Step, arm_step, limit_table

DEGREES = np.pi / 180
Q_MIN = np.array([-170, 0, -200, -170, -135, -170, -120, -175]) * DEGREES + np.array([0, 0.35, 0, 0, 0, 0, 0, 0])
Q_MAX = np.array([170, 0, 20, 170, 135, 170, 120, 175]) * DEGREES + np.array([0, 1.15, 0, 0, 0, 0, 0, 0])
PADDING = np.array([0.2, 0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])
FAST = np.full(8, 1e3)
NO_ROWS, NO_VALUES = np.zeros((0, 8)), np.zeros(0)
NO_WISH = np.array([np.zeros(8), np.zeros(8), np.ones(8)])
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("moma8")


def near_limits(rng: np.random.Generator, joints: int, depth: tuple[float, float] = (0.02, 0.98)) -> np.ndarray:
    """A configuration with that many joints in their padding zones, `depth` of the way through."""
    q = rng.uniform(Q_MIN + 2 * PADDING, Q_MAX - 2 * PADDING)
    for i in rng.permutation(8)[:joints]:
        into = rng.uniform(*depth) * PADDING[i]
        q[i] = Q_MAX[i] - PADDING[i] + into if rng.random() < 0.5 else Q_MIN[i] + PADDING[i] - into
    return q


def step(arm: ArmModel, q: np.ndarray, twist: np.ndarray, fast: np.ndarray = FAST, **options: float) -> Step:
    table = limit_table(Q_MIN, Q_MAX, PADDING, fast, recovery_velocity=np.full(8, 0.3))
    return arm_step(arm.jacobian(q), twist, q, NO_WISH, 1.0, np.eye(8), table, NO_ROWS, NO_VALUES, **options)


def share(q: np.ndarray) -> np.ndarray:
    """s(q) of every joint, written from its definition."""
    inside = np.maximum(np.maximum(q - (Q_MAX - PADDING), Q_MIN + PADDING - q), 0.0) / PADDING
    return np.maximum(1.0 - inside**2, 0.0)


def outwards(q: np.ndarray) -> np.ndarray:
    return np.where(q > Q_MAX - PADDING, 1.0, np.where(q < Q_MIN + PADDING, -1.0, 0.0))


@given(seed=seeds)
def test_one_joint_in_its_zone_follows_the_rule_as_printed(arm: ArmModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, twist = near_limits(rng, 1), 0.1 * rng.normal(size=6)
    got = step(arm, q, twist)
    if got.status > Status.CONSTRAINED:
        return
    i = int(np.flatnonzero(outwards(q))[0])
    free = RESOLVERS["pns"](Problem(arm.jacobian(q), twist)).dq
    if outwards(q)[i] * free[i] > 0.0:
        assert got.limited[i]
        assert got.dq[i] == pytest.approx(share(q)[i] * free[i], abs=1e-9)
    else:
        np.testing.assert_allclose(got.dq, free, atol=1e-9)
        assert not got.limited.any()
    np.testing.assert_allclose(arm.jacobian(q) @ got.dq, twist, atol=1e-9)


def by_enumeration(jacobian: np.ndarray, twist: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, set[int]]:
    """The same optimum from all sets of joints: soft restrictions as weights on the joints that would move outwards."""
    m = twist.size
    null = np.linalg.svd(jacobian)[2][m:]
    s, out = share(q), outwards(q)
    inside = [int(i) for i in np.flatnonzero(out)]
    for size in range(len(inside) + 1):
        for chosen in combinations(inside, size):
            weight = np.eye(8)
            for i in chosen:
                weight[i, i] += (1.0 - s[i]) / (s[i] * float(null[:, i] @ null[:, i]))
            system = np.block([[weight, jacobian.T], [jacobian, np.zeros((m, m))]])
            dq = np.linalg.solve(system, np.concatenate([np.zeros(8), twist]))[:8]
            if all(out[i] * dq[i] >= 0.0 for i in chosen) and all(
                out[i] * dq[i] <= 0.0 for i in set(inside) - {*chosen}
            ):
                return dq, set(chosen)
    raise AssertionError("no consistent set of restrictions")


@given(seed=seeds, joints=st.integers(2, 5))
def test_several_joints_are_the_optimum_that_enumeration_finds(arm: ArmModel, seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    q, twist = near_limits(rng, joints, (0.1, 0.9)), 0.1 * rng.normal(size=6)
    jacobian = arm.jacobian(q)
    null = np.linalg.svd(jacobian)[2][6:]
    if np.linalg.svd(jacobian)[1][-1] < 0.05 or (null**2).sum(axis=0)[outwards(q) != 0.0].min() < 1e-3:
        return
    wanted, chosen = by_enumeration(jacobian, twist, q)
    got = step(arm, q, twist, epsilon_restriction=1e-9)
    np.testing.assert_allclose(got.dq, wanted, atol=1e-6 * (1.0 + np.abs(wanted).max()))
    assert set(np.flatnonzero(got.limited)) == chosen or np.abs(wanted[sorted(chosen)]).min() < 1e-6


@given(seed=seeds, joints=st.integers(1, 8))
def test_nobody_goes_further_out_and_who_is_outside_comes_back(arm: ArmModel, seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    q = near_limits(rng, joints, (0.0, 1.6))
    limited = np.array([0.5, 0.25, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    got = step(arm, q, 0.3 * rng.normal(size=6), limited)
    assert np.isfinite(got.dq).all()
    assert (np.abs(got.dq) <= limited).all()
    assert (got.dq[q >= Q_MAX] <= 0.0).all()
    assert (got.dq[q <= Q_MIN] >= 0.0).all()
    over = np.maximum(q - Q_MAX, Q_MIN - q)
    outside = over > 1e-3
    back = -outwards(q) * got.dq
    assert (back[outside] > 0.0).all() or got.status >= Status.DEGRADED


def test_more_joints_at_their_limits_than_the_null_space_has_room_for() -> None:
    rng = np.random.default_rng(7)
    arm = ArmModel.load("moma8")
    degraded = 0
    for _ in range(100):
        q = near_limits(rng, 4, (1.0, 1.0))
        got = step(arm, q, 0.1 * rng.normal(size=6))
        assert (outwards(q) * got.dq <= 1e-12).all()
        degraded += got.status == Status.DEGRADED
        if got.status <= Status.CONSTRAINED:
            assert np.abs(arm.jacobian(q) @ got.dq).max() > 0.0
    assert degraded > 20


@pytest.mark.slow
@given(seed=seeds)
def test_no_jump_when_joints_enter_and_leave_their_zones(arm: ArmModel, seed: int) -> None:
    """Along a line through several zones the largest change of velocity shrinks with the step."""
    rng = np.random.default_rng(seed)
    start, end = near_limits(rng, 3, (-0.5, 0.9)), near_limits(rng, 0)
    end = start + 0.15 * (end - start)
    twist = 0.1 * rng.normal(size=6)
    coarse, fine = (
        np.array([step(arm, start + t * (end - start), twist, epsilon=0.1, epsilon_restriction=0.05).dq for t in ts])
        for ts in (np.linspace(0, 1, 101), np.linspace(0, 1, 1601))
    )
    assert np.abs(np.diff(fine, axis=0)).max() < 0.5 * np.abs(np.diff(coarse, axis=0)).max() + 1e-4


def test_lift_meets_its_limit_and_the_tcp_goes_on(arm: ArmModel) -> None:
    """The thesis's test of the rule base: a vertical TCP motion, wished for the lift, until that stands at its upper limit."""
    q = np.array([0.1, 0.95, -1.2, 0.4, 0.9, 0.3, 0.8, -0.2])
    twist, dt = np.array([0.0, 0.0, 0.05, 0.0, 0.0, 0.0]), 0.01
    weight = np.diag([1.0, 0.02, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    table = limit_table(Q_MIN, Q_MAX, PADDING, FAST)
    start, lift = arm.pose(q)[:3, 3], []
    for _ in range(600):
        got = arm_step(arm.jacobian(q), twist, q, NO_WISH, 1.0, weight, table, NO_ROWS, NO_VALUES)
        assert got.status <= Status.CONSTRAINED
        np.testing.assert_allclose(arm.jacobian(q) @ got.dq, twist, atol=1e-9)
        q = q + dt * got.dq
        lift.append(got.dq[1])
    speed = np.array(lift)
    assert speed[:200].min() > 0.03
    assert abs(speed[-1]) < 0.15 * speed[0]
    assert q[1] <= Q_MAX[1]
    assert np.abs(np.diff(speed)).max() < 0.002
    assert np.abs(np.diff(speed, 2)).max() < 1e-4
    assert arm.pose(q)[2, 3] - start[2] == pytest.approx(0.3, abs=2e-3)


@pytest.mark.parametrize("method", ["pns", "fsp", "qp"])
def test_any_resolver_takes_the_rule_base(arm: ArmModel, method: str) -> None:
    rng = np.random.default_rng(8)
    table = limit_table(Q_MIN, Q_MAX, PADDING, FAST)
    restricted = 0
    for _ in range(40):
        q, twist = near_limits(rng, 2, (0.1, 0.9)), 0.1 * rng.normal(size=6)
        wanted = step(arm, q, twist)
        if wanted.status > Status.CONSTRAINED:
            continue
        solution, limited = resolve_within_limits(RESOLVERS[method], Problem(arm.jacobian(q), twist), q, table)
        np.testing.assert_allclose(solution.dq, wanted.dq, atol=1e-6)
        np.testing.assert_array_equal(limited, wanted.limited)
        restricted += limited.any()
    assert restricted > 10


@given(seed=seeds)
def test_velocity_bounds_keep_position_speed_and_acceleration(seed: int) -> None:
    """Whoever drives at random inside the bounds stays inside the limits, however the speed was at the start of the braking."""
    rng = np.random.default_rng(seed)
    lower, upper, fast, strong, dt = -np.ones(3), np.ones(3), np.array([0.5, 1.0, 2.0]), np.array([1.0, 4.0, 9.0]), 0.01
    q, dq = rng.uniform(-0.9, 0.9, 3), np.zeros(3)
    target = rng.choice([-5.0, 5.0], 3)
    for _ in range(300):
        low, high = velocity_bounds(q, dq, lower, upper, fast, strong, 2.0, dt)
        assert (low <= high).all()
        new = np.clip(target + rng.normal(size=3), low, high)
        assert (np.abs(new - dq) <= strong * dt * (1 + 1e-9)).all()
        assert (np.abs(new) <= fast + 1e-12).all()
        q, dq = q + dt * new, new
        assert (q <= upper + 1e-9).all()
        assert (q >= lower - 1e-9).all()
        if rng.random() < 0.02:
            target = -target


def test_velocity_bounds_bring_a_joint_back() -> None:
    q, dq, dt = np.array([1.2]), np.zeros(1), 0.01
    before = q[0]
    for _ in range(1500):
        low, high = velocity_bounds(q, dq, -np.ones(1), np.ones(1), np.ones(1), np.full(1, 4.0), 2.0, dt)
        dq = np.clip(np.array([5.0]), low, high)
        q = q + dt * dq
        assert q[0] <= before
        before = q[0]
    assert q[0] == pytest.approx(1.0, abs=1e-3)
