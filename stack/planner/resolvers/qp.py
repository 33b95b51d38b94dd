"""Quadratic programming (Schreiber, Otter, Hirzinger): the same criterion with inequalities, and time scaling ϑ.

While the closed form keeps every bound it is the answer (35). When it does not, the deviation from it is minimised in the metric of
B together with ϑ, in coordinates of the null space of the exact rows, so these hold to rounding whatever the solver's tolerance:

    q̇ = closed form − ϑ·path + Pᵀy,   lower ≤ q̇ ≤ upper,   0 ≤ ϑ ≤ 1

At the change-over both are equal, and the optimum of a strictly convex program moves without jumps, so taking over and handing
back cause none.
The cost of ϑ is an exact penalty (linear): time is not scaled as long as the null space can keep the bounds.
"""

from __future__ import annotations

import daqp
import numpy as np

from stack.planner.problem import Matrix, Problem, Solution, Vector
from stack.planner.resolvers.answer import describe, met, share_of_twist, within
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.nullspace import particular, restrict, split, whiten

_OPTIMAL = 1
_ITERATIONS = 200
_TIGHT = 1e-11
_GIVE_WAY = 1e6


class _Task:
    """Closed form of `J q̇ = ẋ`, `A q̇ = b` with the criterion, for one J: its linear response, and what is left of the null space."""

    def __init__(self, p: Problem, jacobian: Matrix) -> None:
        self._p = p
        self._svd = decompose(jacobian)
        self._white = whiten(self._svd[2][jacobian.shape[0] :], p.B)
        stacked = np.ascontiguousarray(np.vstack([jacobian, p.A]))
        m, n = stacked.shape
        self.free = whiten(decompose(stacked)[2][m:], p.B) if m < n else np.zeros((0, n))

    def respond(self, xdot: Vector, z: Vector, b: Vector) -> tuple[Vector, Vector]:
        """q̇, q̇_u (n,); linear in the arguments."""
        p = self._p
        dq_particular, _ = particular(*self._svd, xdot, p.epsilon)
        unconstrained: Vector = split(self._white, p.B, dq_particular, z)
        if b.size == 0:
            return unconstrained, unconstrained
        softness = np.zeros(b.size)
        dq, _, _ = restrict(self._white, p.B, unconstrained, p.A, b, softness, p.epsilon_restriction)
        return dq, unconstrained

    @property
    def sigma(self) -> Vector:
        sigma: Vector = self._svd[1]
        return sigma


def resolve(problem: Problem) -> Solution:
    """Exact optimum under all bounds; slows down on the path where it must; then the task gives way (DEGRADED), then rows of A
    (INFEASIBLE)."""
    p = problem
    whole = _Task(p, p.J)
    closed, unconstrained = whole.respond(p.xdot, p.z, p.b)
    kept = met(p.J @ (closed - unconstrained), closed)
    inside = not ((closed > p.upper).any() or (closed < p.lower).any())
    if inside and (p.exact.all() or whole.sigma[-1] >= p.epsilon):
        return describe(p, whole.sigma, closed, unconstrained, 1.0, 1.0, kept)
    found = _slow_down(p, whole, closed)
    if found is not None:
        dq, scale = found
        off = p.J[p.exact] @ (dq - scale * unconstrained) if p.exact.all() else p.J @ dq - scale * p.xdot
        return describe(p, whole.sigma, dq, unconstrained, scale, 1.0, kept and met(off, dq))
    return _give_way(p, whole.sigma, unconstrained)


def _slow_down(p: Problem, whole: _Task, closed: Vector) -> tuple[Vector, float] | None:
    """(q̇, 1 − ϑ) with the exact rows and A held, or None where no ϑ in [0, 1] keeps the bounds."""
    exact = p.exact
    task = whole if exact.all() else _Task(p, np.ascontiguousarray(p.J[exact])) if exact.any() else None
    start, path = closed, np.zeros_like(closed)
    free = task.free if task is not None else _free_of_rows(p)
    if task is not None:
        command = np.ascontiguousarray(p.xdot[exact])
        path, _ = task.respond(command, np.zeros_like(p.z), np.zeros_like(p.b))
        if task is not whole:
            start, _ = task.respond(command, p.z, p.b)
    motion = np.column_stack([free.T, -path])
    soft = (p.task_weight[:, None] * p.J)[~exact]
    soft_motion = soft @ motion
    soft_motion[:, -1] += (p.task_weight * p.xdot)[~exact]
    soft_start = soft @ start - (p.task_weight * p.xdot)[~exact]
    hessian = motion.T @ p.B @ motion + soft_motion.T @ soft_motion
    hessian[-1, -1] += p.gamma
    gradient = motion.T @ p.B @ (start - closed) + soft_motion.T @ soft_start
    gradient[-1] += p.gamma
    identity = np.zeros((1, motion.shape[1]))
    identity[0, -1] = 1.0
    y = _solve(
        hessian,
        gradient,
        np.vstack([motion, identity]),
        np.append(p.lower - start, 0.0),
        np.append(p.upper - start, 1.0),
    )
    if y is None:
        return None
    return within(start + motion @ y, p.lower, p.upper), float(min(max(1.0 - y[-1], 0.0), 1.0))


def _free_of_rows(p: Problem) -> Matrix:
    """Whitened base of all motion that A leaves, for a task without exact rows."""
    n = p.J.shape[1]
    base = decompose(p.A)[2][p.A.shape[0] :] if p.b.size else np.eye(n)
    free: Matrix = whiten(np.ascontiguousarray(base), p.B)
    return free


def _give_way(p: Problem, sigma: Vector, unconstrained: Vector) -> Solution:
    """No motion along the path keeps the bounds: hold them and A with the least deviation from the twist; failing that, A's least."""
    hessian = p.B + _GIVE_WAY * p.J.T @ p.J
    gradient = -p.B @ p.z
    n = p.z.size
    dq = _solve(
        hessian, gradient, np.vstack([np.eye(n), p.A]), np.append(p.lower, p.b), np.append(p.upper, p.b), p.b.size
    )
    words = ""
    if dq is None:
        hessian = hessian + _GIVE_WAY**2 * p.A.T @ p.A
        gradient = gradient - _GIVE_WAY**2 * p.A.T @ p.b
        middle = within(np.zeros(n), p.lower, p.upper)
        low, high = np.minimum(p.lower, middle), np.maximum(p.upper, middle)
        dq = _solve(hessian, gradient, np.eye(n), low, high)
        dq = middle if dq is None else dq
        words = _worst_restriction(p, dq)
    dq = within(dq, p.lower, p.upper)
    scale = share_of_twist(p, dq)
    return describe(p, sigma, dq, unconstrained, scale, 1.0, met(p.J @ dq - scale * p.xdot, dq), words)


def _worst_restriction(p: Problem, dq: Vector) -> str:
    error = np.abs(p.A @ dq - p.b)
    worst = int(error.argmax()) if error.size else 0
    return f"row {worst} of A is missed by {error[worst]:.3g} inside the bounds" if error.size else "no solution found"


def _solve(
    hessian: Matrix, gradient: Vector, rows: Matrix, lower: Vector, upper: Vector, equalities: int = 0
) -> Vector | None:
    """Minimiser of ½yᵀHy + gᵀy under lower ≤ rows·y ≤ upper, the last `equalities` of them equal; None where there is none."""
    sense = np.zeros(lower.size, dtype=np.int32)
    sense[lower.size - equalities :] = 5
    y, _, flag, _ = daqp.solve(
        np.ascontiguousarray(hessian),
        np.ascontiguousarray(gradient),
        np.ascontiguousarray(rows),
        np.clip(upper, -1e30, 1e30),
        np.clip(lower, -1e30, 1e30),
        sense,
        primal_tol=_TIGHT,
        iter_limit=_ITERATIONS,
    )
    solution: Vector = np.asarray(y)
    return solution if flag == _OPTIMAL and bool(np.isfinite(solution).all()) else None
