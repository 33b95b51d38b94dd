"""One control step as one compiled call: preferences → null-space resolution → joint-limit rule base → slowing down on the path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stack.planner.limits import hold_limits, restrict_active, zones
from stack.planner.preferences import preferred_velocity
from stack.planner.problem import EPSILON, Matrix, Status, Vector
from stack.planner.resolvers._compile import kernel
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.nullspace import particular, split, whiten
from stack.planner.resolvers.path_scale import path_and_null_scale

_PASSES = 4
_TOLERANCE = 1e-9
_OK, _CONSTRAINED, _SINGULAR, _DEGRADED, _INFEASIBLE = (int(status) for status in Status)


class Step(NamedTuple):
    """What one step gives: dq, dq_unconstrained (n,); sigma (m,); limited (n,) bool: joints that the rule base restricts; scale and
    null_scale in [0, 1]: shares of the commanded twist and of the preferred motion; status: value of `Status`;
    bound: 2i for the lower, 2i + 1 for the upper velocity bound of joint i that slowed the path down, −1 for none."""

    dq: Vector
    dq_unconstrained: Vector
    sigma: Vector
    limited: NDArray[np.bool_]
    scale: float
    null_scale: float
    status: int
    bound: int


def limit_table(
    q_min: Vector, q_max: Vector, padding: Vector, dq_max: Vector, *, recovery_velocity: Vector | None = None
) -> Matrix:
    """Limits (n,) as the table (7, n) that the steps take: q_min, its threshold, the upper threshold, q_max, recovery velocity (default a fifth of
    dq_max), lower and upper velocity bound. An axis without position limits has ±inf (and any finite padding).
    Raises ValueError that names the joint whose padding zones overlap or are empty, or whose dq_max is not positive."""
    table = np.array(
        [q_min, q_min + padding, q_max - padding, q_max, 0.2 * dq_max if recovery_velocity is None else recovery_velocity, -dq_max, dq_max],
        dtype=np.float64,
    )
    for i in range(table.shape[1]):
        if not (padding[i] > 0.0 and table[1, i] <= table[2, i]):
            raise ValueError(f"padding[{i}] is {padding[i]}, it must be positive and at most half of the range {q_min[i]} to {q_max[i]}")
        if not dq_max[i] > 0.0:
            raise ValueError(f"dq_max[{i}] is {dq_max[i]}, it must be positive")
    return np.ascontiguousarray(table)


@kernel
def _inside(dq, table):
    for i in range(dq.shape[0]):
        if dq[i] < table[5, i] or dq[i] > table[6, i]:
            return False
    return True


@kernel
def _clip(dq, table):
    for i in range(dq.shape[0]):
        dq[i] = min(max(dq[i], table[5, i]), table[6, i])


@kernel
def step_in_null_space(jacobian, dq_particular, white, weight, z, q, table, rows, values, epsilon_restriction, recovery_rate):
    """From a particular solution and a whitened null-space base to (q̇, q̇_u, limited, scale, null_scale, status, bound)."""
    n = q.shape[0]
    direction, softness, floor = zones(q, table[0], table[1], table[2], table[3], recovery_rate, table[4])
    first = split(white, weight, dq_particular, z)
    scale = 1.0
    null_scale = 1.0
    bound = -1
    status = _OK
    zero = np.zeros(n)
    no_values = np.zeros(values.shape[0])
    unconstrained = first
    for attempt in range(_PASSES):
        if attempt > 0:
            unconstrained = split(white, weight, scale * dq_particular, null_scale * z)
        dq, limited, _ = hold_limits(
            white, weight, unconstrained, rows, values, direction, softness, floor, epsilon_restriction
        )
        if _inside(dq, table):
            break
        path, _, _ = restrict_active(
            white, weight, split(white, weight, scale * dq_particular, zero), rows, no_values, limited, softness, zero,
            epsilon_restriction,
        )
        null, _, _ = restrict_active(
            white, weight, split(white, weight, zero, null_scale * z), rows, no_values, limited, softness, zero,
            epsilon_restriction,
        )
        fixed = dq - path - null
        more, null_more, which, shortfall = path_and_null_scale(fixed, path, null, table[5], table[6])
        scale *= more
        null_scale *= null_more
        bound = which
        dq = fixed + more * path + null_more * null
        if shortfall > 0.0:
            status = _INFEASIBLE
            _clip(dq, table)
            break
        if attempt == _PASSES - 1:
            _clip(dq, table)
    if status == _OK:
        status = _judge(jacobian, dq, scale * dq_particular, limited, rows, values, bound)
    return dq, first, limited, scale, null_scale, status, bound


@kernel
def _judge(jacobian, dq, along_path, limited, rows, values, bound):
    """INFEASIBLE if a hard row does not hold, DEGRADED if the twist is not that of `along_path`, CONSTRAINED if anything shaped q̇."""
    for i in range(rows.shape[0]):
        error = -values[i]
        for j in range(dq.shape[0]):
            error += rows[i, j] * dq[j]
        if abs(error) > _TOLERANCE:
            return _INFEASIBLE
    for i in range(jacobian.shape[0]):
        error = 0.0
        for j in range(dq.shape[0]):
            error += jacobian[i, j] * (dq[j] - along_path[j])
        if abs(error) > _TOLERANCE:
            return _DEGRADED
    if bound >= 0 or rows.shape[0] > 0 or limited.any():
        return _CONSTRAINED
    return _OK


@kernel
def _with_singularity(status, propped):
    return _SINGULAR if propped and status < _SINGULAR else status


@kernel
def _arm_step(jacobian, xdot, q, wishes, window, weight, table, rows, values, epsilon, epsilon_restriction, recovery_rate):
    u, sigma, vt = decompose(jacobian)
    dq_particular, propped = particular(u, sigma, vt, xdot, epsilon)
    white = whiten(vt[jacobian.shape[0] :], weight)
    z = window * preferred_velocity(q, wishes[0], wishes[1], wishes[2])
    dq, first, limited, scale, null_scale, status, bound = step_in_null_space(
        jacobian, dq_particular, white, weight, z, q, table, rows, values, epsilon_restriction, recovery_rate
    )
    return dq, first, sigma, limited, scale, null_scale, _with_singularity(status, propped), bound


def arm_step(
    jacobian: Matrix,
    xdot: Vector,
    q: Vector,
    wishes: Matrix,
    window: float,
    weight: Matrix,
    table: Matrix,
    rows: Matrix,
    values: Vector,
    epsilon: float = EPSILON,
    epsilon_restriction: float = 1e-4,
    recovery_rate: float = 2.0,
) -> Step:
    """Joint velocities of one arm cycle. No checks: float64, C-contiguous arrays of the right shape, never written to.

    jacobian (m, n), xdot (m,), q (n,); wishes (3, n): preferred configuration, heights, widths of `preferred_velocity`, scaled by `window`;
    weight (n, n): B; table (7, n): `limit_table`; rows (k, n), values (k,): hard equality rows, k may be 0.
    Guarantees: finite for finite arguments; velocity bounds hold always; while the status is OK or CONSTRAINED, J q̇ = scale·ẋ to rounding;
    a joint at or outside a position limit never moves further out.
    """
    return Step(
        *_arm_step(
            jacobian, xdot, q, wishes, window, weight, table, rows, values, epsilon, epsilon_restriction, recovery_rate
        )
    )
