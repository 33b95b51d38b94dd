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

- KS: 1 / (1 + L‖∇ log w‖), w = √det(J Jᵀ): at most d/(d + L) at a distance d from where w falls to 0, and near that. As a
  logarithm's gradient it does not depend on the units of the task's rows, unlike σ_min or a condition number that mix m and rad.
- AS: √(‖Z h‖² L² + (λ L²)²) / S, λ the eigenvalue of C_AS nearest to 0; where limits are active, within the motion that they leave.
- SS: √(sin²α + (g/w)²), α the angle between the limit's gradient and the normal space of the self-motion, −g the way left to the
  limit, w its `width` (a joint's padding zone); for several active limits also the smallest singular value of all of them together.
- SAS: √(μ² L² + ‖Z(h − ∇gᵀμ)‖² L² + …)/S and g/w as above: multiplier of the limit, gradient that is left beside it.

A limit that is further away than its width takes no part. On a KS the others have no meaning and are 1.
Pure functions; arrays float64, SI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stack.kinematics.arm import ArmModel
from stack.messages import Matrix, SingularityKind, Vector
from stack.planner.jacobian_derivative import Rows, Tensor
from stack.planner.measures import Local, Measure
from stack.planner.monitor_kernels import general_margins, joint_margins

WHOLE_TASK: Rows = np.arange(6, dtype=np.int64)


Kind = SingularityKind


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
    found = general_margins(
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
    return _named(*joint_margins(np.ascontiguousarray(jacobian), rows, q, lower, upper, width))


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
