"""What a Problem refuses, and how it says so."""

import numpy as np
import pytest

from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS

J = np.eye(2, 4) + 0.1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"xdot": np.zeros(3)}, r"xdot has shape \(3,\), J of shape \(2, 4\) needs \(2,\)"),
        ({"J": np.zeros((4, 2))}, r"J has shape \(4, 2\), it must be \(m, n\) with 0 < m <= n"),
        ({"z": np.zeros(5)}, r"z has shape \(5,\), J of shape \(2, 4\) needs \(4,\)"),
        ({"B": np.zeros((4, 3))}, r"B has shape \(4, 3\), J of shape \(2, 4\) needs \(4,\) or \(4, 4\)"),
        ({"B": np.array([1.0, 0.0, 1.0, 1.0])}, r"B\[1\] is 0.0, every weight must be positive"),
        ({"B": np.diag([1.0, 1.0, 1.0, -1.0])}, r"not positive definite: its smallest eigenvalue is -1"),
        ({"B": np.eye(4) + np.eye(4, k=1)}, r"B is not symmetric: B\[0, 1\] is 1.0 but B\[1, 0\] is 0.0"),
        ({"A": np.zeros((1, 3)), "b": [0.0]}, r"A has shape \(1, 3\), J of shape \(2, 4\) needs \(k, 4\)"),
        ({"A": np.ones((2, 4)), "b": [0.0]}, r"b has shape \(1,\), A of shape \(2, 4\) needs \(2,\)"),
        ({"A": np.ones((1, 4))}, "A and b belong together"),
        ({"upper": np.zeros(2)}, r"upper has shape \(2,\), J of shape \(2, 4\) needs \(4,\)"),
        ({"lower": [0.0, np.nan, 0.0, 0.0]}, r"lower\[1\] is nan"),
        ({"z": [0.0, 0.0, np.nan, 0.0]}, r"z\[2\] is nan, it must be finite"),
        ({"J": np.array([[1.0, 2.0], [np.inf, 0.0]])}, r"J\[1, 0\] is inf"),
        ({"epsilon": 0.0}, r"epsilon is 0.0, it must be positive"),
        ({"exact": [True]}, r"exact has shape \(1,\)"),
    ],
)
def test_says_what_is_wrong(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Problem(**{"J": J, "xdot": np.zeros(2), **arguments})  # type: ignore[arg-type]


def test_a_diagonal_weight_is_the_matrix_of_it() -> None:
    diagonal = np.array([1.0, 2.0, 3.0, 4.0])
    z = np.arange(4.0)
    one = RESOLVERS["pns"](Problem(J, [0.1, 0.2], B=diagonal, z=z))
    other = RESOLVERS["pns"](Problem(J, [0.1, 0.2], B=np.diag(diagonal), z=z))
    np.testing.assert_array_equal(one.dq, other.dq)


@pytest.mark.parametrize("method", list(RESOLVERS))
def test_crossed_bounds_are_an_answer_not_an_error(method: str) -> None:
    solution = RESOLVERS[method](Problem(J, [0.1, 0.0], lower=[-1, 0.2, -1, -1], upper=[1, 0.1, 1, 1]))
    assert solution.status is Status.INFEASIBLE
    assert "bounds of joint 1 cross by 0.1" in solution.message
    assert solution.dq[1] == pytest.approx(0.15)


@pytest.mark.parametrize("method", list(RESOLVERS))
def test_a_non_redundant_robot_has_one_answer(method: str) -> None:
    square = np.array([[1.0, 0.3], [0.1, 2.0]])
    solution = RESOLVERS[method](Problem(square, [0.3, -0.4], z=[5.0, 5.0]))
    np.testing.assert_allclose(solution.dq, np.linalg.solve(square, [0.3, -0.4]), atol=1e-14)


@pytest.mark.parametrize("method", list(RESOLVERS))
def test_contradicting_rows_are_named_with_what_they_miss(method: str) -> None:
    row = np.eye(4)[[0, 0]]
    solution = RESOLVERS[method](Problem(J, [0.1, 0.0], A=row, b=[0.1, 0.3]))
    assert solution.status is Status.INFEASIBLE
    assert "of A is missed by 0.1" in solution.message
    assert solution.dq[0] == pytest.approx(0.2)


@pytest.mark.parametrize("method", list(RESOLVERS))
def test_a_repeated_row_is_no_contradiction(method: str) -> None:
    once = RESOLVERS[method](Problem(J, [0.1, 0.0], A=np.eye(4)[:1], b=[0.1]))
    twice = RESOLVERS[method](Problem(J, [0.1, 0.0], A=np.eye(4)[[0, 0]], b=[0.1, 0.1]))
    np.testing.assert_allclose(once.dq, twice.dq, atol=1e-6)
    assert twice.status <= Status.DEGRADED
    np.testing.assert_allclose(twice.dq[0], 0.1, atol=1e-12)


@pytest.mark.parametrize("method", list(RESOLVERS))
def test_a_row_that_the_task_decides_makes_the_task_give_way(method: str) -> None:
    decided = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    solution = RESOLVERS[method](Problem(decided, [0.5, 0.2], A=[[1.0, 0.0, 0.0]], b=[0.0]))
    assert solution.status is Status.DEGRADED
    assert solution.dq[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(solution.task_error, [-0.5, 0.0], atol=1e-9)
    assert "gave way" in solution.message
