"""The redundancy resolvers, by name. Each is a pure function `resolve(problem: Problem) -> Solution`."""

from __future__ import annotations

from collections.abc import Callable

from stack.planner.problem import Problem, Solution
from stack.planner.resolvers import fsp, gradient, pns, qp

RESOLVERS: dict[str, Callable[[Problem], Solution]] = {
    "pns": pns.resolve,
    "fsp": fsp.resolve,
    "gradient": gradient.resolve,
    "qp": qp.resolve,
}
