"""The kernels of the singularity monitor: margins as plain numbers. What they mean and how they are scaled: see `monitor`.

Pure and compiled; arrays float64, C-contiguous, SI.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.jacobian_derivative import Rows, Tensor, manipulability_derivatives
from stack.planner.resolvers.decomposition import decompose

Flags = NDArray[np.bool_]
RANK_LOSS = 1e-7
"""σ_min / σ_max below which null space, gradient and multipliers mean nothing; the KS margin is this ratio then."""
ON_LIMIT = 1e-9
"""Share of its width within which a limit counts as active."""


@compiled
def joint_margins(
    jacobian: Matrix, rows: Rows, q: Vector, lower: Vector, upper: Vector, width: Vector
) -> tuple[Vector, int, Vector]:
    """`general_margins` with manipulability and the joint limits within reach."""
    task, change, _, _, value, gradient, hessian = manipulability_derivatives(jacobian, rows)
    n = q.shape[0]
    near = np.zeros(2 * n, np.int64)
    count = 0
    for i in range(2 * n):
        way = q[i] - lower[i] if i < n else upper[i - n] - q[i - n]
        if way < width[i % n]:
            near[count] = i
            count += 1
    g = np.zeros(count)
    normal = np.zeros((count, n))
    reach = np.zeros(count)
    for c in range(count):
        i = near[c] % n
        lower_one = near[c] < n
        g[c] = lower[i] - q[i] if lower_one else q[i] - upper[i]
        normal[c, i] = -1.0 if lower_one else 1.0
        reach[c] = width[i]
    bend = np.zeros((count, n, n))
    found, limit, facts = general_margins(task, change, value, gradient, hessian, g, normal, bend, reach)
    return found, near[limit] if limit >= 0 else -1, facts


@compiled
def _eigen_nearest_zero(matrix: Matrix) -> float:
    """The eigenvalue of a symmetric matrix with the smallest magnitude."""
    values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    best: float = values[0]
    for value in values:
        if abs(value) < abs(best):
            best = value
    return best


@compiled
def _least_squares(rows: Matrix, target: Vector) -> Vector:
    """Shortest μ (k,) that minimises ‖rowsᵀ μ − target‖ for rows (k, r); directions below 1e-9 of the longest are left out."""
    normal = rows @ rows.T
    values, vectors = np.linalg.eigh(normal)
    right = vectors.T @ (rows @ target)
    for i in range(values.shape[0]):
        right[i] = right[i] / values[i] if values[i] > 1e-18 * max(values[-1], 1e-300) else 0.0
    return vectors @ right


@compiled
def projected_curvature(
    jacobian: Matrix, change: Tensor, gradient: Vector, hessian: Matrix, normal: Matrix, bend: Tensor
) -> tuple[Matrix, Matrix, Vector]:
    """Z (r, n) of [J; normal], ∇(Z h) (r, n) for a base Z that is carried along without turning in itself, and the multipliers.

    ∇(z h) = zᵀ∇²H − λᵀ(∂J z), λ = [J; normal]⁺ᵀ h: on the self-motion this is the curvature of H along it, the same for every base.
    The multipliers (m + k,) are λ. `bend` (k, n, n): curvature of the limits. r may be 0.
    """
    m, n = jacobian.shape
    k = normal.shape[0]
    stacked = np.empty((m + k, n))
    stacked[:m] = jacobian
    stacked[m:] = normal
    u, sigma, vt = decompose(stacked)
    multipliers = np.zeros(m + k)
    for s in range(m + k):
        if sigma[s] > 1e-9 * sigma[0]:
            along = 0.0
            for i in range(n):
                along += vt[s, i] * gradient[i]
            for i in range(m + k):
                multipliers[i] += u[i, s] * along / sigma[s]
    null = np.ascontiguousarray(vt[m + k :])
    rows = null @ hessian
    pulled = np.zeros((n, n))
    for j in range(n):
        for i in range(n):
            for s in range(m):
                pulled[j, i] += multipliers[s] * change[j, s, i]
            for s in range(k):
                pulled[j, i] += multipliers[m + s] * bend[s, j, i]
    return null, rows - null @ pulled.T, multipliers


@compiled
def general_margins(
    jacobian: Matrix,
    change: Tensor,
    value: float,
    gradient: Vector,
    hessian: Matrix,
    g: Vector,
    normal: Matrix,
    bend: Tensor,
    width: Vector,
) -> tuple[Vector, int, Vector]:
    """Margins (4,) KS AS SS SAS; the limit of the smaller of the last two, −1; facts (5,): H, ‖Z h‖, λ, μ of that limit, 0."""
    m, n = jacobian.shape
    u, sigma, vt = decompose(jacobian)
    found = np.ones(4)
    facts = np.zeros(5)
    facts[0] = value
    if sigma[0] <= 0.0:
        found[0] = 0.0
        return found, -1, facts
    found[0] = sigma[m - 1] / sigma[0]
    if found[0] < RANK_LOSS:
        return found, -1, facts
    found[0] = 1.0 / (1.0 + _decline(u, sigma, vt, change))
    if m == n:
        return found, -1, facts
    null = np.ascontiguousarray(vt[m:])
    motion = null @ gradient
    facts[1] = math.sqrt(motion @ motion)
    scale = abs(value) + math.sqrt(gradient @ gradient)
    scale = scale if scale > 0.0 else 1.0
    k = g.shape[0]
    size = np.ones(k)
    away = np.ones(k)
    shadow = np.zeros((k, n - m))
    active = np.zeros(k, np.bool_)
    for i in range(k):
        size[i] = max(math.sqrt(normal[i] @ normal[i]), 1e-300)
        away[i] = max(-g[i] / (size[i] * width[i]), 0.0)
        shadow[i] = null @ (normal[i] / size[i])
        active[i] = away[i] <= ON_LIMIT
    _algorithmic(jacobian, change, gradient, hessian, normal, bend, active, scale, found, facts)
    limit = _at_limits(motion, shadow, away, active, scale, found, facts)
    if limit >= 0:
        facts[3] /= size[limit]
    for i in range(4):
        found[i] = min(found[i], 1.0)
    return found, limit, facts


@compiled
def _decline(u: Matrix, sigma: Vector, vt: Matrix, change: Tensor) -> float:
    """‖∇ log w‖ = ‖tr(J⁺ ∂_j J)‖ over the joints j."""
    n, m, _ = change.shape
    total = 0.0
    for j in range(n):
        trace = 0.0
        for s in range(m):
            for r in range(m):
                along = 0.0
                for i in range(n):
                    along += change[j, r, i] * vt[s, i]
                trace += u[r, s] * along / sigma[s]
        total += trace * trace
    return math.sqrt(total)


@compiled
def _algorithmic(
    jacobian: Matrix,
    change: Tensor,
    gradient: Vector,
    hessian: Matrix,
    normal: Matrix,
    bend: Tensor,
    active: Flags,
    scale: float,
    found: Vector,
    facts: Vector,
) -> None:
    """AS within the motion that active limits leave, into found[1] and facts[2]."""
    m, n = jacobian.shape
    held = np.flatnonzero(active)
    if m + held.shape[0] >= n:
        return
    null, rows, _ = projected_curvature(jacobian, change, gradient, hessian, normal[held], bend[held])
    motion = null @ gradient
    bending = _eigen_nearest_zero(rows @ null.T)
    found[1] = math.sqrt(motion @ motion + bending * bending) / scale
    facts[2] = bending


@compiled
def _at_limits(
    motion: Vector, shadow: Matrix, away: Vector, active: Flags, scale: float, found: Vector, facts: Vector
) -> int:
    """SS and SAS of the limits within reach into found[2:4] and facts[3]; the limit of the smaller one, −1 for none."""
    k, r = shadow.shape
    limit = -1
    nearest = 2.0
    held = np.flatnonzero(active)
    if held.shape[0] > 1:
        together = shadow[held]
        least = np.linalg.eigvalsh(together @ together.T)[0]
        found[2] = min(found[2], math.sqrt(max(least, 0.0))) if held.shape[0] <= r else 0.0
        nearest = found[2]
        limit = held[0]
    for i in range(k):
        if away[i] >= 1.0:
            continue
        length = math.sqrt(shadow[i] @ shadow[i])
        semi = math.sqrt(length * length + away[i] * away[i])
        count = 1
        rows = np.empty((held.shape[0] + 1, r))
        rows[0] = shadow[i]
        for j in held:
            if j != i:
                rows[count] = shadow[j]
                count += 1
        multiplier = 0.0
        algorithmic = 1.0
        if length > RANK_LOSS:
            mu = _least_squares(rows[:count], motion)
            left = motion - rows[:count].T @ mu
            multiplier = mu[0]
            off = (multiplier * multiplier + left @ left) / (scale * scale)
            algorithmic = math.sqrt(off + away[i] * away[i])
        found[2] = min(found[2], semi)
        found[3] = min(found[3], algorithmic)
        if min(semi, algorithmic) < nearest:
            nearest = min(semi, algorithmic)
            limit = i
            facts[3] = multiplier
    return limit
