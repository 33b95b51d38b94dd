"""`arm_step` for a preferred velocity that is given as such instead of as a preferred configuration."""

from __future__ import annotations

import numpy as np

from stack.compiled import compiled
from stack.planner.limits import Flags
from stack.planner.problem import EPSILON, Matrix, Vector
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.nullspace import particular, whiten
from stack.planner.resolvers.step import Step, step_in_null_space, with_singularity


@compiled
def _wished_step(
    jacobian: Matrix,
    xdot: Vector,
    q: Vector,
    z: Vector,
    weight: Matrix,
    table: Matrix,
    rows: Matrix,
    values: Vector,
    epsilon: float,
    epsilon_restriction: float,
    recovery_rate: float,
) -> tuple[Vector, Vector, Vector, Flags, float, float, int, int]:
    u, sigma, vt = decompose(jacobian)
    dq_particular, propped = particular(u, sigma, vt, xdot, epsilon)
    white = whiten(vt[jacobian.shape[0] :], weight)
    dq, first, limited, scale, null_scale, status, bound = step_in_null_space(
        jacobian, dq_particular, white, weight, z, q, table, rows, values, epsilon_restriction, recovery_rate
    )
    return dq, first, sigma, limited, scale, null_scale, with_singularity(status, propped), bound


def wished_step(
    jacobian: Matrix,
    xdot: Vector,
    q: Vector,
    z: Vector,
    weight: Matrix,
    table: Matrix,
    rows: Matrix,
    values: Vector,
    epsilon: float = EPSILON,
    epsilon_restriction: float = 1e-4,
    recovery_rate: float = 2.0,
) -> Step:
    """Joint velocities of one arm cycle that come as near to z (n,) as the task, the hard rows and the limits let them.

    Arguments, checks and guarantees as in `arm_step`.
    """
    return Step(
        *_wished_step(
            np.ascontiguousarray(jacobian), xdot, q, z, weight, table, rows, values, epsilon, epsilon_restriction,
            recovery_rate,
        )
    )  # fmt: skip
