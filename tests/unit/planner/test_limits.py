"""The kernels of the joint limits, number by number: small problems whose answers can be written down."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from stack.planner.limits import (
    acceleration_scale,
    hold_limits,
    limit_acceleration,
    limit_scale,
    limit_velocity,
    restrict_active,
    velocity_bounds,
    zones,
)

LOWER, LOWER_THRESHOLD, UPPER_THRESHOLD, UPPER = -2.0, -1.5, 1.0, 3.0
EPSILON = 1e-9
THIRD = 1.0 / 3.0


@pytest.mark.parametrize(
    ("q", "share"),
    [
        (1.0, 1.0),
        (-1.5, 1.0),
        (0.0, 1.0),
        (1.5, 1 - 0.25**2),
        (2.0, 0.75),
        (3.0, 0.0),
        (3.5, 0.0),
        (-1.6, 1 - 0.2**2),
        (-1.75, 0.75),
        (-2.0, 0.0),
        (-2.5, 0.0),
    ],
)
def test_share_left_in_a_zone(q: float, share: float) -> None:
    assert limit_scale(q, LOWER, LOWER_THRESHOLD, UPPER_THRESHOLD, UPPER) == pytest.approx(share, abs=1e-15)


def zones_at(*q: float) -> tuple[list[float], list[float], list[float]]:
    n = len(q)
    edges = [np.full(n, edge) for edge in (LOWER, LOWER_THRESHOLD, UPPER_THRESHOLD, UPPER)]
    direction, softness, floor = zones(np.array(q), *edges, 2.0, np.full(n, 0.3))
    return list(direction), list(softness), list(floor)


def test_zones_tell_the_side_the_share_and_the_way_back() -> None:
    direction, softness, floor = zones_at(0.0, 1.0, -1.5, 2.0, -1.75, 3.0, -2.0, 3.1, -2.1, 4.0, -4.0)
    assert direction == [0, 0, 0, 1, -1, 1, -1, 1, -1, 1, -1]
    np.testing.assert_allclose(softness, [1, 1, 1, 0.75, 0.75, 0, 0, 0, 0, 0, 0], atol=1e-15)
    np.testing.assert_allclose(floor, [0, 0, 0, 0, 0, 0, 0, -0.2, 0.2, -0.3, 0.3], atol=1e-12)


def white_of(jacobian: np.ndarray) -> np.ndarray:
    """Orthonormal null-space base as rows: whitened for a weight of one."""
    return np.ascontiguousarray(np.linalg.svd(jacobian)[2][jacobian.shape[0] :])


SUM = np.ones((1, 3))
"""The task: three rates that add up to 1."""
NO_ROWS, NO_VALUES = np.zeros((0, 3)), np.zeros(0)


def hold(
    direction: tuple[float, ...],
    softness: tuple[float, ...],
    floor: tuple[float, ...] = (0.0, 0.0, 0.0),
    unconstrained: tuple[float, ...] = (THIRD, THIRD, THIRD),
    rows: np.ndarray = NO_ROWS,
    values: np.ndarray = NO_VALUES,
) -> tuple[np.ndarray, list[bool], bool]:
    dq, active, damped = hold_limits(
        white_of(SUM), np.eye(3), np.array(unconstrained), rows, values, np.array(direction), np.array(softness),
        np.array(floor), EPSILON,
    )  # fmt: skip
    return dq, list(active), damped


def test_far_from_the_limits_nothing_is_touched() -> None:
    dq, active, damped = hold((0, 0, 0), (1, 1, 1))
    np.testing.assert_array_equal(dq, np.full(3, THIRD))
    assert (active, damped) == ([False] * 3, False)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_one_joint_is_slowed_and_the_others_take_over(joint: int) -> None:
    direction, softness = [0.0] * 3, [1.0] * 3
    direction[joint], softness[joint] = 1.0, 0.4
    dq, active, damped = hold(tuple(direction), tuple(softness))
    wanted = np.full(3, (1 - 0.4 * THIRD) / 2)
    wanted[joint] = 0.4 * THIRD
    np.testing.assert_allclose(dq, wanted, atol=1e-9)
    assert active == [i == joint for i in range(3)]
    assert not damped


def test_a_joint_in_a_zone_that_moves_inwards_or_stands_is_left_alone() -> None:
    dq, active, _ = hold((-1, 0, 0), (0.4, 1, 1))
    np.testing.assert_allclose(dq, THIRD, atol=1e-15)
    assert not any(active)
    dq, active, _ = hold((1, 0, 0), (0.4, 1, 1), unconstrained=(0.0, 0.5, 0.5))
    np.testing.assert_allclose(dq, [0.0, 0.5, 0.5], atol=1e-15)
    assert not any(active)


def test_two_joints_at_their_limits_leave_all_to_the_third() -> None:
    dq, active, damped = hold((1, 1, 0), (0, 0, 1))
    np.testing.assert_allclose(dq, [0, 0, 1], atol=1e-9)
    assert (active, damped) == ([True, True, False], False)


def test_three_joints_at_their_limits_stand_and_the_task_gives_way() -> None:
    dq, active, damped = hold((1, 1, 1), (0, 0, 0))
    np.testing.assert_allclose(dq, 0.0, atol=1e-9)
    assert (active, damped) == ([True] * 3, True)


def test_a_joint_outside_its_limit_comes_back_at_its_rate() -> None:
    dq, active, damped = hold((1, 0, 0), (0, 1, 1), floor=(-0.2, 0, 0))
    np.testing.assert_allclose(dq, [-0.2, 0.6, 0.6], atol=1e-9)
    assert (active, damped) == ([True, False, False], False)
    dq, active, _ = hold((-1, 0, 0), (0, 1, 1), floor=(0.4, 0, 0))
    np.testing.assert_allclose(dq, [0.4, 0.3, 0.3], atol=1e-9)
    assert active == [True, False, False]


def test_a_joint_that_comes_back_faster_than_it_must_is_left_alone() -> None:
    dq, active, _ = hold((1, 0, 0), (0, 1, 1), floor=(-0.2, 0, 0), unconstrained=(-0.3, 0.65, 0.65))
    np.testing.assert_allclose(dq, [-0.3, 0.65, 0.65], atol=1e-15)
    assert not any(active)


def test_a_joint_that_came_back_fast_enough_is_caught_when_the_others_slow_it() -> None:
    """Joint 1 stops at its limit; the third of its motion that joint 0 would take over must not make it too slow."""
    dq, active, damped = hold((1, 1, 0), (0, 0, 1), floor=(-0.2, 0, 0), unconstrained=(-0.3, 1.0, 0.3))
    np.testing.assert_allclose(dq, [-0.2, 0.0, 1.2], atol=1e-9)
    assert (active, damped) == ([True, True, False], False)


def test_hard_rows_come_first_and_limits_hold_beside_them() -> None:
    row, value = np.array([[1.0, 0.0, 0.0]]), np.array([0.2])
    dq, active, damped = hold((0, 0, 0), (1, 1, 1), rows=row, values=value)
    np.testing.assert_allclose(dq, [0.2, 0.4, 0.4], atol=1e-9)
    dq, active, damped = hold((0, 1, 0), (1, 0, 1), rows=row, values=value)
    np.testing.assert_allclose(dq, [0.2, 0.0, 0.8], atol=1e-9)
    assert (active, damped) == ([False, True, False], False)


def test_a_joint_that_the_others_push_outwards_is_caught_and_one_that_they_free_is_let_go() -> None:
    """Joint 1 stands in its zone and would move inwards; with joint 0 stopped it would have to move outwards."""
    jacobian = np.array([[1.0, 1.0, 0.5]])
    white = white_of(jacobian)
    pinned = np.linalg.pinv(jacobian)[:, 0] + white.T @ white @ np.array([3.0, -2.0, 0.0])
    dq, active, _ = hold_limits(
        white, np.eye(3), pinned, NO_ROWS, NO_VALUES, np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3),
        EPSILON,
    )  # fmt: skip
    assert pinned[1] < 0.0
    assert dq[0] == pytest.approx(0.0, abs=1e-9)
    assert dq[1] <= 1e-9
    np.testing.assert_allclose(jacobian @ dq, 1.0, atol=1e-9)
    assert active[0]


def cheapest(
    jacobian: np.ndarray, unconstrained: np.ndarray, direction: np.ndarray, softness: np.ndarray
) -> tuple[np.ndarray, set[int]]:
    """The rule base's answer for a weight of one, from all sets of joints, by elimination of the multipliers."""
    m, n = jacobian.shape
    null = white_of(jacobian)
    inside = [int(i) for i in np.flatnonzero(direction)]
    for size in range(len(inside) + 1):
        for chosen in combinations(inside, size):
            weight = np.eye(n)
            for i in chosen:
                weight[i, i] += (1.0 - softness[i]) / (softness[i] * float(null[:, i] @ null[:, i]))
            system = np.block([[weight, jacobian.T], [jacobian, np.zeros((m, m))]])
            dq = np.linalg.solve(system, np.concatenate([unconstrained, jacobian @ unconstrained]))[:n]
            others = set(inside) - {*chosen}
            if all(direction[i] * dq[i] > 0 for i in chosen) and all(direction[i] * dq[i] <= 0 for i in others):
                return dq, set(chosen)
    raise AssertionError("no consistent set of restrictions")


def test_many_joints_in_zones_are_the_optimum_that_enumeration_finds() -> None:
    rng = np.random.default_rng(5)
    entered = left = 0
    for _ in range(60):
        jacobian = rng.normal(size=(2, 6))
        unconstrained, direction = rng.normal(size=6), rng.choice([-1.0, 0.0, 1.0], 6, p=[0.4, 0.2, 0.4])
        softness = np.where(direction != 0, rng.uniform(0.05, 0.95, 6), 1.0)
        wanted, chosen = cheapest(jacobian, unconstrained, direction, softness)
        dq, active, damped = hold_limits(
            white_of(jacobian), np.eye(6), unconstrained, np.zeros((0, 6)), NO_VALUES, direction, softness, np.zeros(6),
            EPSILON,
        )  # fmt: skip
        np.testing.assert_allclose(dq, wanted, atol=1e-7)
        assert set(np.flatnonzero(active)) == chosen
        assert not damped
        first = set(np.flatnonzero(direction * unconstrained > 0))
        entered, left = entered + bool(chosen - first), left + bool(first - chosen)
    assert min(entered, left) >= 3


def test_rows_and_joints_are_enforced_together_and_say_how_hard_they_pull() -> None:
    active, softness, floor = np.array([False, True, False]), np.array([1.0, 0.0, 1.0]), np.array([9.0, -0.1, 9.0])
    dq, pull, damped = restrict_active(
        white_of(SUM), np.eye(3), np.full(3, THIRD), np.array([[1.0, 0.0, 0.0]]), np.array([0.2]), active, softness,
        floor, EPSILON,
    )  # fmt: skip
    np.testing.assert_allclose(dq, [0.2, -0.1, 0.9], atol=1e-9)
    assert pull[1] < 0.0
    assert pull[0] == pull[2] == 0.0
    assert not damped


def test_without_restrictions_the_answer_is_a_copy() -> None:
    free = np.full(3, THIRD)
    dq, pull, damped = restrict_active(
        white_of(SUM), np.eye(3), free, NO_ROWS, NO_VALUES, np.zeros(3, bool), np.ones(3), np.zeros(3), EPSILON
    )
    np.testing.assert_array_equal(dq, free)
    assert dq is not free
    assert not np.shares_memory(dq, free)
    np.testing.assert_array_equal(pull, 0.0)
    assert not damped


FAST, STRONG, RATE, DT = 1.0, 4.0, 2.0, 0.01
STEP = STRONG * DT


def bounds_at(q: float, dq: float, fast: float = FAST) -> tuple[float, float]:
    low, high = velocity_bounds(
        np.array([q]), np.array([dq]), -np.ones(1), np.ones(1), np.full(1, fast), np.full(1, STRONG), RATE, DT
    )
    return float(low[0]), float(high[0])


def braking(distance: float) -> float:
    """v with v·dt + v²/2a = distance: a cycle at that speed, then braking."""
    return float(np.roots([0.5 / STRONG, DT, -distance]).max())


@pytest.mark.parametrize(
    ("q", "dq", "low", "high"),
    [
        (0.0, 0.0, -STEP, STEP),
        (0.0, 0.5, 0.5 - STEP, 0.5 + STEP),
        (0.0, 0.99, 0.99 - STEP, FAST),
        (0.0, -0.99, -FAST, -0.99 + STEP),
        (0.995, 0.18, 0.18 - STEP, braking(0.005)),
        (-0.995, -0.18, -braking(0.005), -0.18 + STEP),
        (1.0, 0.0, -STEP, 0.0),
        (-1.0, 0.0, 0.0, STEP),
        (1.01, -0.01, -0.01 - STEP, -0.02),
        (-1.01, 0.01, 0.02, 0.01 + STEP),
        (1.01, -0.04, -0.08, -0.02),
        (2.0, -0.2, -0.2 - STEP, -0.2),  # no faster back than a fifth of its speed
        (-2.0, 0.2, 0.2, 0.2 + STEP),
        (2.0, -0.19, -0.19 - STEP, -0.2),
        (1.01, 0.5, 0.5 - STEP, 0.5 - STEP),  # too fast for everything: it brakes as hard as it may
        (-1.01, -0.5, -0.5 + STEP, -0.5 + STEP),
        (0.0, 2.0, 2.0 - STEP, 2.0 - STEP),
        (0.0, -2.0, -2.0 + STEP, -2.0 + STEP),
    ],
)
def test_bounds_of_the_next_cycle(q: float, dq: float, low: float, high: float) -> None:
    assert bounds_at(q, dq) == (pytest.approx(low, abs=1e-12), pytest.approx(high, abs=1e-12))


def test_a_faster_axis_comes_back_faster() -> None:
    assert bounds_at(2.0, -0.39, fast=2.0)[1] == pytest.approx(-0.4)
    assert bounds_at(-2.0, 0.39, fast=2.0)[0] == pytest.approx(0.4)


def test_velocity_is_limited_as_a_whole() -> None:
    most = np.array([1.0, 0.5])
    for dq, wanted, limited in (
        ([2.0, -0.5], [1.0, -0.25], True),
        ([0.1, -2.0], [0.025, -0.5], True),
        ([1.0, -0.5], [1.0, -0.5], False),
        ([0.3, 0.1], [0.3, 0.1], False),
    ):
        value, told = limit_velocity(np.array(dq), most)
        np.testing.assert_allclose(value, wanted, atol=1e-15)
        assert bool(told) == limited


def test_acceleration_is_limited_along_the_straight_line() -> None:
    previous, strong = np.array([0.5, -0.2]), np.array([10.0, 5.0])
    for dq, wanted, limited in (
        ([0.9, -0.2], [0.6, -0.2], True),
        ([0.7, -0.4], [0.55, -0.25], True),
        ([0.1, -0.2], [0.4, -0.2], True),
        ([0.58, -0.23], [0.58, -0.23], False),
    ):
        value, told = limit_acceleration(np.array(dq), previous, strong, 0.01)
        np.testing.assert_allclose(value, wanted, atol=1e-12)
        assert bool(told) == limited
    inside = np.array([0.5625, -0.2])  # binary: not a bit may change
    np.testing.assert_array_equal(limit_acceleration(inside, previous, strong, 0.01)[0], inside)


@pytest.mark.parametrize(
    ("dq", "previous", "share", "reachable"),
    [
        ([1.0, 0.5], [0.0, 0.0], 0.1, True),
        ([-1.0, -0.5], [0.0, 0.0], 0.1, True),
        ([1.0, -0.5], [0.5, -0.25], 0.6, True),
        ([-1.0, 0.5], [-0.5, 0.25], 0.6, True),
        ([0.4, -0.2], [0.4, -0.2], 1.0, True),
        ([0.4, 0.0], [0.38, 0.1], 1.0, True),  # the second joint may just stop
        ([0.4, 0.0], [0.1, 0.0], 0.5, True),
        ([0.0, 0.0], [0.05, -0.1], 1.0, True),
        ([0.0, 0.0], [0.0, 0.0], 1.0, True),
        ([1.0, 1.0], [0.9, 1.1], 1.0, True),  # one share and no other
        ([2.0, 0.5], [1.9, 0.45], 1.0, True),
        ([-2.0, -0.5], [-1.9, -0.45], 1.0, True),
        ([-2.0, -0.5], [-1.9, -0.3], 0.88, False),
        ([1.0, 1.0], [0.9, 0.75], 0.85, True),
        ([-1.0, -1.0], [-0.9, -0.75], 0.85, True),
        ([1.0, 0.0], [0.5, 0.3], None, False),  # … may not: no share helps
        ([1.0, 0.5], [0.5, -0.5], 0.0, False),
        ([1.0, 1.0], [0.2, 0.8], 0.5, False),
        ([-1.0, -1.0], [-0.2, -0.8], 0.5, False),
        ([1.0, -1.0], [0.2, -0.8], 0.5, False),
        ([0.5, 0.5], [0.9, 0.9], 1.0, False),
    ],
)
def test_share_of_a_motion_that_accelerations_allow(
    dq: list[float], previous: list[float], share: float | None, reachable: bool
) -> None:
    """Steps of 0.1; where there is no such share, the one with the least excess."""
    got, told = acceleration_scale(np.array(dq), np.array(previous), np.full(2, 10.0), 0.01)
    assert bool(told) == reachable
    assert 0.0 <= got <= 1.0
    if share is not None:
        assert got == pytest.approx(share, abs=1e-9)


def test_least_excess_is_measured_in_each_joints_own_acceleration() -> None:
    """A joint that is four times as strong may be left four times as far behind."""
    got, told = acceleration_scale(np.array([1.0, 1.0]), np.array([0.0, 1.0]), np.array([40.0, 10.0]), 0.01)
    assert not told
    assert got == pytest.approx(0.8, abs=1e-9)
