"""The rule base around a resolver: which rows it adds, and that everything else of the problem gets through to the resolver."""

from __future__ import annotations

import numpy as np
import pytest

from stack.planner.problem import Problem, Solution
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.rule_base import resolve_within_limits
from stack.planner.resolvers.step import limit_table

TABLE = limit_table(np.full(4, -1.0), np.ones(4), np.full(4, 0.5), np.full(4, 1e3), recovery_velocity=np.full(4, 0.3))
JACOBIAN = np.array([[1.0, 1.0, 1.0, 1.0]])


class Asked:
    """A resolver that keeps what it was asked."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def __call__(self, problem: Problem) -> Solution:
        self.problems.append(problem)
        return RESOLVERS["pns"](problem)


def test_far_from_the_limits_the_resolver_is_asked_once_and_its_answer_stands() -> None:
    asked = Asked()
    solution, limited = resolve_within_limits(asked, Problem(JACOBIAN, np.ones(1)), np.zeros(4), TABLE)
    assert len(asked.problems) == 1
    np.testing.assert_allclose(solution.dq, 0.25, atol=1e-12)
    assert not limited.any()


def test_everything_else_of_the_problem_stays_as_it_was() -> None:
    asked = Asked()
    problem = Problem(
        JACOBIAN, np.ones(1), B=np.diag([1.0, 2.0, 3.0, 4.0]), z=np.array([0.1, 0.0, 0.2, 0.0]),
        A=np.array([[0.0, 0.0, 0.0, 1.0]]), b=np.array([0.05]), lower=np.full(4, -3.0), upper=np.full(4, 4.0),
        epsilon=0.02, epsilon_restriction=1e-6, gamma=0.3,
    )  # fmt: skip
    _, limited = resolve_within_limits(asked, problem, np.array([0.75, 0.0, 0.0, 0.0]), TABLE)
    first, second = asked.problems
    assert first is problem
    assert list(limited) == [True, False, False, False]
    for name in ("J", "xdot", "B", "z", "lower", "upper", "epsilon", "epsilon_restriction", "exact", "gamma"):
        np.testing.assert_array_equal(getattr(second, name), getattr(problem, name), err_msg=name)
    np.testing.assert_array_equal(second.task_weight, problem.task_weight)
    np.testing.assert_array_equal(second.A, [[0, 0, 0, 1], [1, 0, 0, 0]])
    assert second.b[0] == 0.05


@pytest.mark.parametrize(
    ("q", "rate", "first"),
    [
        (0.75, 2.0, 0.75 * 0.25),
        (1.0, 2.0, 0.0),
        (1.05, 2.0, -0.1),
        (1.05, 4.0, -0.2),
        (1.5, 2.0, -0.3),
        (-0.75, 2.0, 0.25),
        (-1.2, 2.0, 0.3),  # would come back at 0.25: it has to faster
    ],
)
def test_the_joint_moves_as_its_zone_allows_and_the_task_is_kept(q: float, rate: float, first: float) -> None:
    options = {} if rate == 2.0 else {"recovery_rate": rate}
    at = np.array([q, 0.0, 0.0, 0.0])
    solution, _ = resolve_within_limits(RESOLVERS["pns"], Problem(JACOBIAN, np.ones(1)), at, TABLE, **options)
    np.testing.assert_allclose(solution.dq, [first, *[(1 - first) / 3] * 3], atol=1e-6)


def test_two_tasks_leave_two_joints_to_restrict() -> None:
    jacobian = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    at = np.array([1.0, 0.0, -1.0, 0.0])
    solution, limited = resolve_within_limits(RESOLVERS["pns"], Problem(jacobian, np.array([1.0, -1.0])), at, TABLE)
    np.testing.assert_allclose(solution.dq, [0.0, 1.0, 0.0, -1.0], atol=1e-6)
    assert list(limited) == [True, False, True, False]
