"""Problem → Solution: the narrow waist that every redundancy resolver stands on.

A resolver is a pure function `resolve(problem) -> Solution`. `Problem` checks shapes and values once, when it is made, so
the compiled kernels below the resolvers do not have to; a control cycle that trusts its arrays calls the kernels directly.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

EPSILON = 0.01
"""Default threshold ε below which a singular value of J is propped (2.139); in the unit of J's singular values."""

EPSILON_RESTRICTION = 1e-6
"""Default threshold for the restrictions' own matrix C G⁻¹Cᵀ, normalised so that 1 is a joint that is free of the task."""


class Status(IntEnum):
    """What became of a problem, the worse the higher; the docs of the members say what to do about it."""

    OK = 0
    """Task met, criterion at its unconstrained optimum. Send it."""

    CONSTRAINED = 1
    """Task met, all restrictions hold, some of them shaped the answer; `scale` < 1 means: on the path, but slower. Send it,
    and let whoever commands the path know the scale."""

    SINGULAR = 2
    """J is near-singular: its small singular values were propped, so the twist is met only in the strong directions
    (`task_error` says by how much it is missed). Send it; steer away or circumvent."""

    DEGRADED = 3
    """A hard restriction held and the task gave way: `task_error` is not small. Send it if the restriction matters more than the
    path (a joint limit does); command something else soon."""

    INFEASIBLE = 4
    """The restrictions contradict each other; `message` names the worst and by how much it is missed. The answer keeps the
    velocity bounds as well as they can be kept. Stop, or drop the restriction that is named."""


@dataclass(frozen=True, slots=True)
class Active:
    """One restriction that shaped the answer: row `index` of A, or the lower or upper bound of joint `index`."""

    kind: Literal["row", "lower", "upper"]
    index: int

    def __str__(self) -> str:
        return f"row {self.index} of A" if self.kind == "row" else f"{self.kind} bound of joint {self.index}"


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Find q̇ with `J q̇ = ẋ` that minimises `(q̇ − z)ᵀ B (q̇ − z)` under `A q̇ = b` and `lower ≤ q̇ ≤ upper`.

    J (m, n) Jacobian, m ≤ n; xdot (m,) commanded twist, zero allowed; B (n, n) symmetric positive definite, or (n,) its diagonal,
    default identity; z (n,) preferred joint velocity, default 0; A (k, n), b (k,) hard equality rows; lower, upper (n,) velocity
    bounds, ±inf where there is none. SI: m, rad, s. `epsilon` props singular values of J, `epsilon_restriction` does the same
    for the restrictions (see the constants above).

    For `qp` alone: `exact` (m,) bool marks the rows of the task that hold exactly, the others may give way (None: all exact);
    `gamma` is what slowing down costs, `task_weight` (m,) what a deviation in the other rows costs.

    Everything is stored as float64, C-contiguous, B always as (n, n). The arrays given are never written to.
    Raises ValueError that shows both shapes where they do not fit, the index of a NaN or infinity, and a B that is not
    symmetric positive definite. Bounds that cross are no error here but come back as INFEASIBLE: a cycle must not crash on them.
    """

    J: Matrix
    xdot: Vector
    B: Matrix
    z: Vector
    A: Matrix
    b: Vector
    lower: Vector
    upper: Vector
    epsilon: float
    epsilon_restriction: float
    exact: NDArray[np.bool_]
    gamma: float
    task_weight: Vector

    def __init__(
        self,
        J: ArrayLike,
        xdot: ArrayLike,
        *,
        B: ArrayLike | None = None,
        z: ArrayLike | None = None,
        A: ArrayLike | None = None,
        b: ArrayLike | None = None,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        epsilon: float = EPSILON,
        epsilon_restriction: float = EPSILON_RESTRICTION,
        exact: ArrayLike | None = None,
        gamma: float = 1.0e6,
        task_weight: ArrayLike | None = None,
    ) -> None:
        jacobian = _array("J", J)
        if jacobian.ndim != 2 or not 0 < jacobian.shape[0] <= jacobian.shape[1]:
            raise ValueError(f"J has shape {jacobian.shape}, it must be (m, n) with 0 < m <= n")
        m, n = jacobian.shape
        rows = np.zeros((0, n)) if A is None else np.atleast_2d(_array("A", A))
        if rows.ndim != 2 or rows.shape[1] != n:
            raise ValueError(f"A has shape {rows.shape}, J of shape {(m, n)} needs (k, {n})")
        if (A is None) != (b is None):
            raise ValueError("A and b belong together: give both or none")
        values: dict[str, object] = {
            "J": jacobian,
            "xdot": _vector("xdot", xdot, m, jacobian),
            "B": _weight(B, n, jacobian),
            "z": np.zeros(n) if z is None else _vector("z", z, n, jacobian),
            "A": rows,
            "b": np.zeros(0)
            if b is None
            else _vector("b", np.atleast_1d(np.asarray(b, np.float64)), rows.shape[0], rows, "A"),
            "lower": np.full(n, -np.inf) if lower is None else _bound("lower", lower, n, jacobian),
            "upper": np.full(n, np.inf) if upper is None else _bound("upper", upper, n, jacobian),
            "epsilon": _positive("epsilon", epsilon),
            "epsilon_restriction": _positive("epsilon_restriction", epsilon_restriction),
            "exact": np.ones(m, np.bool_) if exact is None else _mask("exact", exact, m, jacobian),
            "gamma": _positive("gamma", gamma),
            "task_weight": np.full(m, 1.0e2)
            if task_weight is None
            else _vector("task_weight", task_weight, m, jacobian),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def bounded(self) -> bool:
        """Whether any joint has a finite velocity bound."""
        return bool(np.isfinite(self.lower).any() or np.isfinite(self.upper).any())


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """What a resolver answers.

    dq (n,) the joint velocities to send; dq_unconstrained (n,) the answer before any restriction (for rule bases to look at);
    sigma (m,) singular values of J, descending, as they are (not propped); manipulability their product; active: the restrictions
    that shaped the answer; scale in [0, 1]: the robot moves with `scale`·ẋ along the commanded path; null_scale in [0, 1]: how much
    of the preferred motion z was kept; task_error (m,) = J q̇ − scale·ẋ; message: empty when OK, else what happened, by name.
    """

    dq: Vector
    dq_unconstrained: Vector
    sigma: Vector
    manipulability: float
    active: tuple[Active, ...]
    status: Status
    scale: float
    null_scale: float
    task_error: Vector
    message: str = ""


def _array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    array = np.ascontiguousarray(value, dtype=np.float64)
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(f"{name}{list(index)} is {array[index]}, it must be finite")
    return array


def _fit(name: str, array: NDArray[np.generic], n: int, partner: Matrix, partner_name: str) -> None:
    if array.shape != (n,):
        raise ValueError(f"{name} has shape {array.shape}, {partner_name} of shape {partner.shape} needs ({n},)")


def _vector(name: str, value: ArrayLike, n: int, partner: Matrix, partner_name: str = "J") -> Vector:
    array = _array(name, value)
    _fit(name, array, n, partner, partner_name)
    return array


def _bound(name: str, value: ArrayLike, n: int, partner: Matrix) -> Vector:
    array = np.ascontiguousarray(value, dtype=np.float64)
    _fit(name, array, n, partner, "J")
    if np.isnan(array).any():
        raise ValueError(
            f"{name}[{int(np.argwhere(np.isnan(array))[0, 0])}] is nan, it must be a number, or infinite for no bound"
        )
    return array


def _mask(name: str, value: ArrayLike, n: int, partner: Matrix) -> NDArray[np.bool_]:
    array = np.ascontiguousarray(value, dtype=np.bool_)
    _fit(name, array, n, partner, "J")
    return array


def _positive(name: str, value: float) -> float:
    if not 0.0 < value < np.inf:
        raise ValueError(f"{name} is {value}, it must be positive and finite")
    return float(value)


def _weight(value: ArrayLike | None, n: int, jacobian: Matrix) -> Matrix:
    if value is None:
        return np.eye(n)
    array = _array("B", value)
    if array.shape not in ((n,), (n, n)):
        raise ValueError(f"B has shape {array.shape}, J of shape {jacobian.shape} needs ({n},) or ({n}, {n})")
    if array.ndim == 1:
        if not (array > 0.0).all():
            i = int(np.argmin(array))
            raise ValueError(f"B[{i}] is {array[i]}, every weight must be positive")
        return np.diag(array)
    if np.abs(array - array.T).max() > 1e-9 * np.abs(array).max():
        i, j = divmod(int(np.abs(array - array.T).argmax()), n)
        raise ValueError(f"B is not symmetric: B[{i}, {j}] is {array[i, j]} but B[{j}, {i}] is {array[j, i]}")
    try:
        np.linalg.cholesky(array)
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(array)[0])
        raise ValueError(f"B is not positive definite: its smallest eigenvalue is {smallest:.3g}") from None
    return array
