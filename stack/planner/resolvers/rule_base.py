"""The joint-limit rule base around any resolver: padding zones become hard rows of the problem."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stack.messages import Matrix, Vector
from stack.planner.limits import Flags, hold_limits, zones
from stack.planner.problem import Problem, Solution
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.nullspace import whiten


def resolve_within_limits(
    resolve: Callable[[Problem], Solution],
    problem: Problem,
    q: Vector,
    table: Matrix,
    *,
    recovery_rate: float = 2.0,
) -> tuple[Solution, Flags]:
    """`resolve(problem)` with the joints that are in a padding zone of `table` (7, n; see `limit_table`) at positions q (n,) restricted
    by the rule base, and which ones were (n,) bool. The rates that the rows prescribe are those of `hold_limits`, so for "pns" and "fsp"
    the answer is that of `arm_step`; `problem.lower` and `upper` stay the resolver's to keep."""
    p = problem
    solution = resolve(p)
    white = whiten(decompose(p.J)[2][p.J.shape[0] :], p.B)
    direction, softness, floor = zones(q, table[0], table[1], table[2], table[3], recovery_rate, table[4])
    dq, limited, _ = hold_limits(
        white, p.B, solution.dq_unconstrained, p.A, p.b, direction, softness, floor, p.epsilon_restriction
    )
    if not limited.any():
        return solution, limited
    restricted = Problem(
        p.J, p.xdot, B=p.B, z=p.z, A=np.vstack([p.A, np.eye(q.size)[limited]]), b=np.append(p.b, dq[limited]),
        lower=p.lower, upper=p.upper, epsilon=p.epsilon, epsilon_restriction=p.epsilon_restriction,
        exact=p.exact, gamma=p.gamma, task_weight=p.task_weight,
    )  # fmt: skip
    return resolve(restricted), limited
