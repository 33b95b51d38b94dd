"""The reductions and special cases of the full space parameterization."""

import numpy as np
import pytest

from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.fsp import parameterize, reduce_system


def optimum(p: Problem) -> np.ndarray:
    """Direct solution of the optimality conditions."""
    rows = np.vstack([p.J, p.A])
    k, n = rows.shape
    system = np.block([[p.B, rows.T], [rows, np.zeros((k, k))]])
    return np.linalg.lstsq(system, np.concatenate([p.B @ p.z, p.xdot, p.b]), rcond=None)[0][:n]


def regular(seed: int, m: int = 4, n: int = 6) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(m, n)), rng.normal(size=n)


def agree(problem: Problem) -> None:
    solution = RESOLVERS["fsp"](problem)
    np.testing.assert_allclose(solution.dq, optimum(problem), atol=1e-9)
    assert solution.status <= Status.CONSTRAINED


def test_a_joint_without_influence_stays_free() -> None:
    jacobian, z = regular(1)
    jacobian[:, 2] = 0.0
    agree(Problem(jacobian, np.ones(4), z=z, B=np.arange(1.0, 7.0)))
    assert RESOLVERS["fsp"](Problem(jacobian, np.ones(4), z=z)).dq[2] == pytest.approx(z[2])


def test_a_row_with_one_joint_decides_it() -> None:
    jacobian, z = regular(2)
    jacobian[1] = 0.0
    jacobian[1, 3] = 2.0
    agree(Problem(jacobian, np.array([0.1, 0.4, -0.3, 0.2]), z=z))
    reduced = reduce_system(jacobian)
    assert 3 not in reduced.joints
    assert reduced.matrix.shape == (3, 5)


def test_decided_joints_may_decide_others() -> None:
    jacobian, z = regular(3)
    jacobian[1] = [0, 0, 0, 2.0, 0, 0]
    jacobian[2] = [0, 0, 0, 1.0, 0.5, 0]
    agree(Problem(jacobian, np.array([0.1, 0.4, -0.3, 0.2]), z=z))
    assert reduce_system(jacobian).matrix.shape == (2, 4)


def test_nothing_left_after_the_reductions() -> None:
    agree(Problem([[0.0, 2.0, 0.0], [0.0, 0.0, 4.0]], [1.0, 1.0], z=[0.3, 0.0, 0.0]))


def test_a_command_that_one_column_carries_alone() -> None:
    jacobian, z = regular(4)
    agree(Problem(jacobian, 0.7 * jacobian[:, 2], z=z))
    agree(Problem(jacobian, jacobian[:, 1] - 2.0 * jacobian[:, 5], z=z))


def test_parallel_columns() -> None:
    jacobian, z = regular(5)
    jacobian[:, 4] = -3.0 * jacobian[:, 1]
    agree(Problem(jacobian, np.ones(4), z=z))


def test_columns_of_very_different_size() -> None:
    jacobian, z = regular(6)
    jacobian[:, 0] *= 1e-4
    jacobian[:, 5] *= 1e3
    agree(Problem(jacobian, np.ones(4), z=z))


def test_the_solutions_span_what_they_should() -> None:
    jacobian, _ = regular(7)
    offset, columns, condition, total = parameterize(jacobian, reduce_system(jacobian), np.ones(4))
    assert columns.shape == (6, 3)
    np.testing.assert_allclose(jacobian @ columns, np.outer(np.ones(4) / 2.0, condition), atol=1e-12)
    np.testing.assert_allclose(jacobian @ offset + total * np.ones(4) / 2.0, np.ones(4), atol=1e-12)


def test_no_velocity_jump_where_the_fictitious_command_takes_over() -> None:
    jacobian, z = regular(8)
    direction = np.array([0.5, -0.5, 0.5, 0.5])
    at_zero = RESOLVERS["fsp"](Problem(jacobian, np.zeros(4), z=z)).dq
    for size in (1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 1e-200, 1e-310):
        near = RESOLVERS["fsp"](Problem(jacobian, size * direction, z=z)).dq
        assert np.abs(near - at_zero).max() <= 10.0 * size + 1e-12
