"""Constraint optimisation through singularities (Schreiber, Otter, Hirzinger): one linearised step Δq of a task given as positions.

A part of the task holds exactly (`ex`, usually translation), a part may give way (`ap`, usually orientation). With e_ap the error of the
approximate part and r_ex that of the exact part at the linearisation point, Δx the commanded change since the last sample:

    minimise   ‖α (J_ap Δq + Δx_ap ϑ − e_ap)‖² + ‖β (J_ap Δq + Δx_ap ϑ − Δx_ap)‖² + γ² ϑ² + δ² ‖Δq‖²    (24, 25, 34)
    subject to J_ex Δq + Δx_ex ϑ = r_ex,   lower ≤ Δq ≤ upper,   0 ≤ ϑ ≤ 1                         (26-28; θ also in (26))
               |e_ap − Δx_ap ϑ − J_ap Δq| ≤ bound + s                                                   (optional, s = 0 while it can be)

What cannot be met gives way in this order: the orientation bound (s), then time (ϑ), then translation; each is named. At most four
quadratic programs, so a cycle takes a bounded time.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import daqp
import numpy as np

from stack.messages import Matrix, Vector

_OPTIMAL = 1
_LAST_RESORT = 1e3
_RANK, _CONTRADICTION = 1e-9, 1e-10
_NOTHING = 1e-12
_EXCESS_COST = 10.0
"""Of each rad beyond the error bound, linear, so that the bound is exceeded by no more than it must; small against `patience` times
the turn of one cycle, so that time does not give way before it."""


class GaveWay(IntFlag):
    """What a step had to give up, in the order in which it is given up."""

    NOTHING = 0
    ORIENTATION_BOUND = 1
    TIME = 2
    TRANSLATION = 4


@dataclass(frozen=True, slots=True)
class Weights:
    """alpha: of the approximate error; beta: of its rate (β/α = 3 damps without leaving an error, 0 overshoots, β ≥ 10 α leaves one);
    gamma: of time scaling, with the exact penalty `patience` on top: while the task can be met at a smaller cost, ϑ stays 0;
    delta: of the distance from the preferred step, which picks one Δq where J is rank-deficient (keep it far below alpha)."""

    alpha: float = 1.0
    beta: float = 3.0
    gamma: float = 1.0
    patience: float = 1.0
    delta: float = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class OptimisedStep:
    """delta_q (n,); time_scaling ϑ in [0, 1], which is also a task-dependent measure of dexterity; what gave way, also as a message."""

    delta_q: Vector
    time_scaling: float
    gave_way: GaveWay
    message: str


def optimise_step(
    exact: tuple[Matrix, Vector, Vector],
    approximate: tuple[Matrix, Vector, Vector],
    lower: Vector,
    upper: Vector,
    weights: Weights = Weights(),
    error_bound: float = np.inf,
    preferred: Vector | None = None,
) -> OptimisedStep:
    """The best Δq since the last sample.

    exact: (J_ex (m_ex, n), r_ex (m_ex,), Δx_ex (m_ex,)); approximate: (J_ap, e_ap, Δx_ap) likewise, either may have 0 rows;
    lower, upper (n,): bounds of Δq from position, velocity and acceleration (`velocity_bounds` times the cycle time);
    error_bound: largest component of what is left of e_ap; preferred (n,): Δq to stay near where the task leaves a choice, default 0
    (the smallest). Never fails: bounds that cross are met in the middle.
    """
    middle = 0.5 * (lower + upper)
    low, high = np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper)
    bounded = bool(np.isfinite(error_bound)) and approximate[1].size > 0
    centre = np.zeros(low.size) if preferred is None else preferred
    for hold_time, hold_bound in ((True, True), (True, False), (False, False)):
        if hold_bound and not bounded:
            continue
        y = _solve(
            exact,
            approximate,
            low,
            high,
            _cost(exact, approximate, weights, centre),
            error_bound,
            hold_time,
            hold_bound,
        )
        if y is not None:
            return _step(y, exact, approximate, error_bound, low, high)
    y = _solve_soft(exact, approximate, low, high, weights, centre)
    return _step(y, exact, approximate, error_bound, low, high)


def _cost(
    exact: tuple[Matrix, Vector, Vector], approximate: tuple[Matrix, Vector, Vector], weights: Weights, centre: Vector
) -> tuple[Matrix, Vector]:
    """H and g of ½yᵀHy + gᵀy for y = (Δq, ϑ)."""
    jacobian, error, change = approximate
    n = exact[0].shape[1]
    rows = np.vstack(
        [
            weights.alpha * np.column_stack([jacobian, change]),
            weights.beta * np.column_stack([jacobian, change]),
            np.diag(np.append(np.full(n, weights.delta), weights.gamma)),
        ]
    )
    target = np.concatenate([weights.alpha * error, weights.beta * change, weights.delta * centre, [0.0]])
    gradient = -rows.T @ target
    gradient[-1] += weights.patience
    return rows.T @ rows, gradient


def _solve(
    exact: tuple[Matrix, Vector, Vector],
    approximate: tuple[Matrix, Vector, Vector],
    low: Vector,
    high: Vector,
    cost: tuple[Matrix, Vector],
    error_bound: float,
    hold_time: bool,
    hold_bound: bool,
) -> Vector | None:
    """(Δq, ϑ) with the exact rows held, or None where that is impossible. hold_time: ϑ = 0; hold_bound: s = 0.

    In coordinates (w, s) of the null space of the exact rows, y = y0 + N w: they hold to rounding whatever the solver's tolerance, and
    the solver sees a well-conditioned Hessian (with the rows left in, daqp takes feasible problems for infeasible ones).
    """
    n, unknowns = low.size, low.size + (0 if hold_time else 1)
    base = _null_space(np.column_stack([exact[0], exact[2]])[:, :unknowns], exact[1])
    if base is None:
        return None
    start, free = base
    low, high = np.append(low, 0.0)[:unknowns], np.append(high, 1.0)[:unknowns]
    hessian, gradient = cost[0][:unknowns, :unknowns], cost[1][:unknowns]
    k = free.shape[1]
    reduced, slope = np.eye(k + 1), np.full(k + 1, _EXCESS_COST)
    reduced[:k, :k], slope[:k] = free.T @ hessian @ free, free.T @ (hessian @ start + gradient)
    rows, lower, upper = np.column_stack([free, np.zeros(unknowns)]), low - start, high - start
    if np.isfinite(error_bound):
        turning = np.column_stack([approximate[0], approximate[2]])[:, :unknowns]
        left = approximate[1] - turning @ start
        ones, open_end = np.ones(left.size), np.full(left.size, np.inf)
        turning = turning @ free
        rows = np.vstack([rows, np.column_stack([turning, -ones]), np.column_stack([turning, ones])])
        lower = np.concatenate([lower, -open_end, left - error_bound])
        upper = np.concatenate([upper, left + error_bound, open_end])
    no_end = np.full(k, np.inf)
    box_low, box_high = np.append(-no_end, 0.0), np.append(no_end, 0.0 if hold_bound else np.inf)
    w = _minimise(reduced, slope, rows, np.append(box_low, lower), np.append(box_high, upper))
    return None if w is None else np.append(start + free @ w[:k], np.zeros(n + 1 - unknowns))


def _null_space(rows: Matrix, values: Vector) -> tuple[Vector, Matrix] | None:
    """(y0, N) such that y0 + N w are all y with `rows·y = values`; None where the rows contradict each other."""
    u, sigma, vt = np.linalg.svd(rows)
    rank = int(np.sum(sigma > _RANK * sigma.max(initial=0.0)))
    start: Vector = vt[:rank].T @ ((u[:, :rank].T @ values) / sigma[:rank])
    if np.abs(rows @ start - values).max(initial=0.0) > _CONTRADICTION:
        return None
    return start, vt[rank:].T


def _solve_soft(
    exact: tuple[Matrix, Vector, Vector],
    approximate: tuple[Matrix, Vector, Vector],
    low: Vector,
    high: Vector,
    weights: Weights,
    centre: Vector,
) -> Vector:
    """(Δq, 1): standstill of the commanded path, and translation as near as the bounds allow."""
    hessian, gradient = _cost(exact, approximate, weights, centre)
    weight = _LAST_RESORT * max(weights.alpha, weights.beta)
    rows = weight * np.column_stack([exact[0], exact[2]])
    hessian = hessian + rows.T @ rows
    gradient = gradient - rows.T @ (weight * exact[1])
    n = low.size
    y = _minimise(hessian, gradient, np.zeros((0, n + 1)), np.append(low, 1.0), np.append(high, 1.0))
    return np.append(np.clip(np.zeros(n), low, high), 1.0) if y is None else y


def _minimise(hessian: Matrix, gradient: Vector, rows: Matrix, lower: Vector, upper: Vector) -> Vector | None:
    """Bounds of all unknowns first in `lower` and `upper`, then those of the rows. None where they cannot be met."""
    solution, _, flag, _ = daqp.solve(
        np.ascontiguousarray(hessian),
        np.ascontiguousarray(gradient),
        np.ascontiguousarray(rows),
        np.clip(upper, -1e30, 1e30),
        np.clip(lower, -1e30, 1e30),
        np.zeros(lower.size, dtype=np.int32),
        primal_tol=1e-12,
        iter_limit=200,
    )
    y = np.asarray(solution)
    return y if flag == _OPTIMAL and bool(np.isfinite(y).all()) else None


def _step(
    y: Vector,
    exact: tuple[Matrix, Vector, Vector],
    approximate: tuple[Matrix, Vector, Vector],
    error_bound: float,
    low: Vector,
    high: Vector,
) -> OptimisedStep:
    delta_q = np.clip(y[:-1], low, high)
    theta = 0.0 if y[-1] < _NOTHING else float(min(y[-1], 1.0))
    gave_way, words = GaveWay.NOTHING, []
    left = np.abs(approximate[1] - approximate[2] * theta - approximate[0] @ delta_q)
    if left.size and left.max() > error_bound + 1e-9:
        gave_way |= GaveWay.ORIENTATION_BOUND
        words.append(f"approximate error {left.max():.3g} exceeds its bound {error_bound:.3g}")
    if theta > 1e-9:
        gave_way |= GaveWay.TIME
        words.append(f"path slowed down by {theta:.3g}")
    missed = np.abs(exact[0] @ delta_q + exact[2] * theta - exact[1])
    if missed.size and missed.max() > 1e-9:
        gave_way |= GaveWay.TRANSLATION
        words.append(f"exact part missed by {missed.max():.3g}")
    return OptimisedStep(delta_q, theta, gave_way, "; ".join(words))
