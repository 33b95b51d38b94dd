"""The small kernels of a step: what is inside the bounds, what has the last word, how much of a twist is left, how a step is judged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.planner.problem import Status
from stack.planner.resolvers.step import _inside, _judge, _keep, _share_of_twist, limit_table, with_singularity

DQ_MAX = np.array([1.0, 2.0, 0.5])
Q_MAX = np.array([2.0, 2.0, 2.0])
TABLE = limit_table(-Q_MAX, Q_MAX, np.array([0.1, 0.2, 0.3]), DQ_MAX)
seeds = st.integers(0, 2**32 - 1)


def test_the_table_holds_limits_thresholds_recovery_and_bounds() -> None:
    np.testing.assert_allclose(TABLE[:, 1], [-2.0, -1.8, 1.8, 2.0, 0.4, -2.0, 2.0])
    given_rates = limit_table(-Q_MAX, Q_MAX, Q_MAX, DQ_MAX, recovery_velocity=np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(given_rates[4], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(given_rates[1], given_rates[2])  # half of the range is not too much


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_inside_is_every_joint_within_both_bounds(joint: int, sign: float) -> None:
    dq = sign * DQ_MAX
    assert _inside(dq, TABLE)
    assert _inside(np.zeros(3), TABLE)
    dq[joint] *= 1.0 + 1e-9
    assert not _inside(dq, TABLE)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_joint_at_its_limit_goes_no_further_whatever_came_out(side: float) -> None:
    direction, floor = np.full(3, side), np.full(3, -0.1 * side)
    outwards = np.full(3, 0.3 * side)
    dq = outwards.copy()
    _keep(dq, TABLE, direction, np.array([0.0, 0.5, 0.0]), floor)
    np.testing.assert_array_equal(dq, [floor[0], outwards[1], floor[2]])  # a soft one is not held
    slowly = np.full(3, 0.05 * side)
    _keep(slowly, TABLE, direction, np.zeros(3), floor)
    np.testing.assert_array_equal(slowly, floor)
    back = np.full(3, -0.3 * side)
    dq = back.copy()
    _keep(dq, TABLE, direction, np.zeros(3), floor)
    np.testing.assert_array_equal(dq, back)
    dq = -3.0 * side * DQ_MAX
    _keep(dq, TABLE, direction, np.zeros(3), floor)
    np.testing.assert_array_equal(dq, -side * DQ_MAX)


@given(seeds)
def test_the_share_of_a_twist_is_its_projection(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, dq, along = rng.normal(size=(2, 3)), rng.normal(size=3), rng.normal(size=3)
    wanted, got = jacobian @ along, jacobian @ dq
    expected = np.clip(wanted @ got / (wanted @ wanted), 0.0, 1.0)
    assert _share_of_twist(jacobian, dq, along) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert _share_of_twist(jacobian, 0.25 * along, along) == pytest.approx(0.25)
    assert _share_of_twist(jacobian, 2.0 * along, along) == 1.0
    assert _share_of_twist(jacobian, -along, along) == 0.0
    assert _share_of_twist(jacobian, dq, np.zeros(3)) == 1.0


def test_a_step_is_judged_by_the_worst_that_happened() -> None:
    jacobian, along = np.eye(2, 3), np.array([0.1, 0.2, 0.3])
    none, free, no_rows = np.zeros(0), np.zeros(3, dtype=np.bool_), np.zeros((0, 3))
    held = np.array([False, True, False])
    row = np.array([[0.0, 0.0, 1.0]])
    off = along + np.array([1e-3, 0.0, 0.0])
    assert _judge(jacobian, along, along, free, no_rows, none, -1) == Status.OK
    assert _judge(jacobian, along, along, free, no_rows, none, 0) == Status.CONSTRAINED
    assert _judge(jacobian, along, along, held, no_rows, none, -1) == Status.CONSTRAINED
    assert _judge(jacobian, along, along, free, row, np.array([0.3]), -1) == Status.CONSTRAINED
    assert _judge(jacobian, off, along, free, row, np.array([0.3]), -1) == Status.DEGRADED
    assert _judge(jacobian, off, along, free, row, np.array([0.2]), -1) == Status.INFEASIBLE


def test_a_singularity_is_told_where_nothing_worse_happened() -> None:
    worse = (Status.DEGRADED, Status.INFEASIBLE)
    for status in Status:
        assert with_singularity(int(status), False) == status
        assert with_singularity(int(status), True) == (status if status in worse else Status.SINGULAR)
