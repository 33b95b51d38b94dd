"""From the linear response of a closed-form resolver to its Solution: bounds by scaling the path, status, and words for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stack.planner.problem import Active, Problem, Solution, Status, Vector
from stack.planner.resolvers.path_scale import into_bounds, path_and_null_scale

Response = Callable[[Vector, Vector, Vector], tuple[Vector, Vector, bool]]
"""(ẋ, z, b) -> (q̇, q̇_u, whether the restrictions had to be damped); linear in its arguments taken together."""

TOLERANCE = 1e-9
"""What counts as met, in the unit of the equation, relative to one plus the size of its terms."""


def answer(problem: Problem, sigma: Vector, respond: Response) -> Solution:
    """Evaluate `respond`, slow down where a velocity bound asks for it, and say what happened. sigma (m,): of J, not propped."""
    p = problem
    dq, unconstrained, _ = respond(p.xdot, p.z, p.b)
    gave_way = p.J @ (dq - unconstrained)
    scale, null_scale, shortfall, worst = 1.0, 1.0, 0.0, -1
    if p.bounded and _outside(p, dq):
        zero = np.zeros_like(p.b)
        path = respond(p.xdot, np.zeros_like(p.z), zero)[0]
        null = respond(np.zeros_like(p.xdot), p.z, zero)[0]
        fixed = dq - path - null
        scale, null_scale, worst, shortfall = path_and_null_scale(fixed, path, null, p.lower, p.upper)
        if shortfall > 0.0:
            return _leave_path(p, sigma, dq, unconstrained, worst, shortfall)
        dq = within(fixed + scale * path + null_scale * null, p.lower, p.upper)
    return describe(p, sigma, dq, unconstrained, scale, null_scale, met(gave_way, dq))


def _leave_path(
    p: Problem, sigma: Vector, dq: Vector, unconstrained: Vector, half_plane: int, shortfall: float
) -> Solution:
    """No share of the motion keeps the bounds (one of them excludes standstill, say): they hold, the task gives way."""
    dq = into_bounds(dq, p.lower, p.upper)
    scale = share_of_twist(p, dq)
    kept = met(p.J @ dq - scale * p.xdot, dq)
    bound = Active("upper" if half_plane % 2 else "lower", half_plane // 2)
    words = f"the {bound} cannot be kept by slowing down, by {shortfall:.3g}"
    return describe(p, sigma, dq, unconstrained, scale, 0.0, kept, "", words)


def share_of_twist(p: Problem, dq: Vector) -> float:
    """The share of ẋ, in [0, 1], that comes nearest to the twist of dq (n,); 1 where ẋ is zero."""
    size = float(p.xdot @ p.xdot)
    return min(max(float(p.J @ dq @ p.xdot) / size, 0.0), 1.0) if size > 0.0 else 1.0


def _crossing(lower: Vector, upper: Vector) -> str:
    """Words for the joint whose bounds cross the most, empty where none do."""
    i = int((lower - upper).argmax())
    return f"the bounds of joint {i} cross by {lower[i] - upper[i]:.3g}" if lower[i] > upper[i] else ""


def within(dq: Vector, lower: Vector, upper: Vector) -> Vector:
    """dq (n,) clipped into its bounds; where they cross, the middle between them."""
    clipped: Vector = np.minimum(np.maximum(dq, lower), upper)
    crossed = lower > upper
    if crossed.any():
        clipped[crossed] = 0.5 * (lower + upper)[crossed]
    return clipped


def met(error: Vector, terms: Vector) -> bool:
    """Whether every component of `error` is zero to TOLERANCE, relative to one plus the largest of `terms`."""
    return error.size == 0 or bool(np.abs(error).max() <= TOLERANCE * (1.0 + np.abs(terms).max()))


def describe(
    problem: Problem,
    sigma: Vector,
    dq: Vector,
    unconstrained: Vector,
    scale: float,
    null_scale: float,
    task_kept: bool,
    infeasible: str = "",
    why: str = "",
) -> Solution:
    """The Solution for a given q̇: which restrictions shaped it, the status and the message; `why` and `infeasible` are words for it."""
    p = problem
    task_error = p.J @ dq - scale * p.xdot
    row_error = p.A @ dq - p.b
    rows = tuple(Active("row", i) for i in range(p.b.size))
    shaped = scale < 1.0 or null_scale < 1.0 or not np.array_equal(dq, unconstrained)
    bounds = _at_bounds(p, dq) if shaped and p.bounded else ()
    active = rows + bounds
    words = [why] if why else []
    status = Status.OK
    if active or scale < 1.0:
        status = Status.CONSTRAINED
    if bounds and scale < 1.0:
        words.append(f"path slowed to {scale:.4g} by the {bounds[0]}")
    if sigma[-1] < p.epsilon:
        status = Status.SINGULAR
        words.append(f"smallest singular value {sigma[-1]:.3g} is below epsilon {p.epsilon:.3g}")
    if not task_kept:
        status = Status.DEGRADED
        words.append(f"the task gave way to the restrictions: twist off by {np.abs(task_error).max():.3g}")
    if not met(row_error, dq):
        worst = int(np.abs(row_error).argmax())
        infeasible = infeasible or f"row {worst} of A is missed by {abs(row_error[worst]):.3g}"
    infeasible = _crossing(p.lower, p.upper) or infeasible
    if infeasible:
        status = Status.INFEASIBLE
        words.append(infeasible)
    return Solution(
        dq=dq,
        dq_unconstrained=unconstrained,
        sigma=sigma,
        manipulability=float(np.prod(sigma)),
        active=active,
        status=status,
        scale=float(scale),
        null_scale=float(null_scale),
        task_error=task_error,
        message="; ".join(words),
    )


def _outside(p: Problem, dq: Vector) -> bool:
    return bool((dq > p.upper).any() or (dq < p.lower).any())


def _at_bounds(p: Problem, dq: Vector) -> tuple[Active, ...]:
    near = TOLERANCE * (1.0 + np.abs(dq))
    low = [Active("lower", int(i)) for i in np.flatnonzero(dq <= p.lower + near)]
    high = [Active("upper", int(i)) for i in np.flatnonzero(dq >= p.upper - near)]
    return tuple(low + high)
