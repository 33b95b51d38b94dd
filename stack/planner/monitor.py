"""The singularity monitor: how near a redundant robot is to each of the four kinds, for any task, measure and active limits.

Source: Park, Chang, Lee, *A new kind of singularity in redundant manipulation: semi algorithmic singularity*, equations (16)–(19).
With Z the null-space base of J as rows, h the gradient of the measure H that the self-motion optimises, and limits g(q) ≤ 0:

| kind | is met where | what it does |
| --- | --- | --- |
| KS kinematic (17) | J loses rank | both directions of the workspace blocked |
| AS algorithmic (18) | Z h = 0 and C_AS = ∇(Z h) Zᵀ singular | the optimum ends, whichever way H is optimised |
| SS semi (19) | g = 0 and C_SS = ∇g Zᵀ Z ∇gᵀ singular | the limit is tangent to the self-motion, one direction blocked |
| SAS semi algorithmic (16) | g = 0 and a multiplier μ = (∇g Zᵀ Z ∇gᵀ)⁻¹ ∇g Zᵀ Z h is 0 | passed in one direction of optimisation only |

A margin is the size of everything that must vanish on that kind, made dimensionless: 0 exactly on it, at most 1, continuous in q away
from the other kinds. The scales, with L = 1 rad (or m) of joint motion and S = H + L‖h‖, so that no margin depends on the unit of H:

- KS: 1 / (1 + L‖∇ log w‖), w = √det(J Jᵀ): d/(d + L) at a distance d from where w falls linearly to 0. As a logarithm's gradient it
  does not depend on the units of the task's rows, unlike σ_min or a condition number that mix m and rad.
- AS: √(‖Z h‖² L² + (λ L²)²) / S, λ the eigenvalue of C_AS nearest to 0; where limits are active, within the motion that they leave.
- SS: √(sin²α + (g/w)²), α the angle between the limit's gradient and the normal space of the self-motion, −g the way left to the
  limit, w its `width` (a joint's padding zone); for several active limits also the smallest singular value of all of them together.
- SAS: √(μ² L² + ‖Z(h − ∇gᵀμ)‖² L² + …)/S and g/w as above: multiplier of the limit, gradient that is left beside it.

A limit that is further away than its width takes no part. On a KS the others have no meaning and are 1.
Pure functions; arrays float64, SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stack.kinematics.arm import ArmModel
from stack.messages import Matrix, Vector
from stack.planner.jacobian_derivative import Rows, Tensor, manipulability_derivatives
from stack.planner.measures import Local, Measure
from stack.planner.resolvers.decomposition import decompose
from stack.servo.compiled import compiled

RANK_LOSS = 1e-7
"""σ_min / σ_max below which null space, gradient and multipliers mean nothing; the KS margin is this ratio then."""
ON_LIMIT = 1e-9
"""Share of its width within which a limit counts as active."""
Flags = NDArray[np.bool_]
WHOLE_TASK: Rows = np.arange(6, dtype=np.int64)


class Kind(IntEnum):
    """Kinds of singularity, as the planner's object 2040h and its monitor frame number them."""

    NONE = 0
    KINEMATIC = 1
    ALGORITHMIC = 2
    SEMI = 3
    SEMI_ALGORITHMIC = 4


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Inequalities g(q) ≤ 0 in the neighbourhood of q. value (k,): g; gradient (k, n): ∇g, need not be normalised; width (k,): the
    distance in the unit of the joints (of g, for rows of length 1) at which a limit begins to count; hessian (k, n, n): ∇²g, zero
    where None (joint limits)."""

    value: Vector
    gradient: Matrix
    width: Vector
    hessian: Tensor | None = None


@dataclass(frozen=True, slots=True)
class Margins:
    """What the monitor says. `kinematic` … `semi_algorithmic`: margins in [0, 1]; `nearest`: the kind with the smallest one, `margin`;
    `limit`: index of the limit that SS or SAS is about, −1 for the others. `measure`: H; `gradient`: ‖Z h‖, 0 at an optimum;
    `curvature`: λ of C_AS nearest to 0 (0 where limits leave no self-motion); `multiplier`: μ of `limit`, above 0 where maximising H
    presses against it."""

    kinematic: float
    algorithmic: float
    semi: float
    semi_algorithmic: float
    nearest: Kind
    margin: float
    limit: int
    measure: float
    gradient: float
    curvature: float
    multiplier: float

    def of(self, kind: Kind) -> float:
        """The margin of one kind; 1 for NONE."""
        return (1.0, self.kinematic, self.algorithmic, self.semi, self.semi_algorithmic)[kind]

    def kind(self, radius: float) -> Kind:
        """The kind whose margin has fallen below `radius`, the nearest of them; NONE outside all."""
        return self.nearest if self.margin < radius else Kind.NONE


def margins(local: Local, limits: Limits) -> Margins:
    """Margins of a robot at one configuration: its task and measure as `local`, its `limits`. Finite for finite arguments.

    Raises ValueError for shapes that do not fit.
    """
    n, k = local.gradient.size, limits.value.size
    if limits.gradient.shape != (k, n) or limits.width.shape != (k,):
        raise ValueError(f"limits of {k} values have gradient {limits.gradient.shape} and width {limits.width.shape}")
    bend = np.zeros((k, n, n)) if limits.hessian is None else limits.hessian
    if bend.shape != (k, n, n):
        raise ValueError(f"limits.hessian has shape {bend.shape}, expected {(k, n, n)}")
    found = _margins(
        local.jacobian, local.derivative, local.value, local.gradient, local.hessian,
        limits.value, limits.gradient, bend, limits.width,
    )  # fmt: skip
    return _named(*found)


def joint_limits(q: Vector, lower: Vector, upper: Vector, width: Vector) -> Limits:
    """Both position limits of every joint (n,) as rows: n lower ones, then n upper ones."""
    n = q.size
    rows = np.vstack((-np.eye(n), np.eye(n)))
    return Limits(np.concatenate((lower - q, q - upper)), rows, np.concatenate((width, width)))


def monitor_arm(arm: ArmModel, q: Vector, measure: Measure | None = None, rows: Rows = WHOLE_TASK) -> Margins:
    """Margins of `arm` at q with its own joint limits: the task is `rows` of the TCP's twist, the measure its manipulability unless
    another one is given. Moves the arm's scratch memory, nothing else."""
    if measure is not None:
        return margins(measure.at(q), joint_limits(q, arm.q_min, arm.q_max, arm.padding))
    return monitor_jacobian(arm.jacobian(q), rows, q, arm.q_min, arm.q_max, arm.padding)


def monitor_jacobian(jacobian: Matrix, rows: Rows, q: Vector, lower: Vector, upper: Vector, width: Vector) -> Margins:
    """The control cycle's call: the same from a geometric Jacobian (6, n) in base axes that is there already, as one compiled call."""
    return _named(*_of_joints(np.ascontiguousarray(jacobian), rows, q, lower, upper, width))


@compiled
def _of_joints(
    jacobian: Matrix, rows: Rows, q: Vector, lower: Vector, upper: Vector, width: Vector
) -> tuple[Vector, int, Vector]:
    """`_margins` with manipulability and the joint limits within reach."""
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
    found, limit, facts = _margins(task, change, value, gradient, hessian, g, normal, bend, reach)
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
def _margins(
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


def _named(found: Vector, limit: int, facts: Vector) -> Margins:
    kinematic, algorithmic, semi, semi_algorithmic = found.tolist()
    order = int(found.argmin())
    nearest = Kind(order + 1) if found[order] < 1.0 else Kind.NONE
    measure, gradient, curvature, multiplier, _ = facts.tolist()
    return Margins(
        kinematic, algorithmic, semi, semi_algorithmic, nearest, float(found[order]),
        int(limit) if nearest in (Kind.SEMI, Kind.SEMI_ALGORITHMIC) else -1,
        measure, gradient, curvature, multiplier,
    )  # fmt: skip
