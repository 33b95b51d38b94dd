"""Every singular point of a robot with one redundant freedom whose measure depends on two joints: a search of their plane.

For pictures, for tests of the monitor, and for choosing a path; not for a control cycle. Source of the kinds: see `monitor`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import brentq

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.jacobian_derivative import Tensor
from stack.planner.measures import Local, Measure
from stack.planner.monitor import Kind
from stack.planner.monitor_kernels import projected_curvature

_STEP = 1e-6
_SAME = 1e-6
_DONE = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class SingularPoint:
    """One of them. `q` (2,): the two joints, in (−π, π] where they are not bounded, else as near to the middle of the bounds as can be;
    `bound`: joint angle of the limit that SS and SAS are on, NaN for the others; `inside`: whether the point keeps the limits;
    `regular`: False for a KS on the outer edge of the workspace (no self-motion arrives there) and for an AS at which the self-motion
    does not move the two joints, so that H is constant along it."""

    kind: Kind
    q: Vector
    bound: float
    inside: bool
    regular: bool


class PlaneSearch:
    """The search for one task: `joints`: the two that count, `rest` (n,): where the others stand, `bounds` of the two joints by index."""

    def __init__(
        self, measure: Measure, joints: tuple[int, int], rest: Vector, bounds: Mapping[int, tuple[float, float]]
    ) -> None:
        self._measure, self._joints, self._rest, self._bounds = measure, joints, rest.copy(), dict(bounds)

    def all(self, cells: int = 12, samples: int = 720) -> list[SingularPoint]:
        """Every point: KS and AS on the whole plane, SS and SAS on each bound; a grid of `cells`² starts, `samples` on a bound."""
        found = [*self.kinematic(cells), *self.algorithmic(cells)]
        for joint, limits in self._bounds.items():
            for bound in limits:
                found += self._on_bound(Kind.SEMI, joint, bound, samples)
                found += self._on_bound(Kind.SEMI_ALGORITHMIC, joint, bound, samples)
        return found

    def optimality_on(self, first: Vector, second: Vector) -> tuple[Matrix, Matrix, Matrix]:
        """On a grid of the two joints, first (a,), second (b,): H, w·(z·h) and the derivative of z·h along z, each (b, a); w = √det(J Jᵀ).

        The second is zero on the optimum loci and continuous everywhere; the third is negative there where H is largest.
        """
        out = np.empty((3, second.size, first.size))
        for i, b in enumerate(second):
            for j, a in enumerate(first):
                local = self._local(np.array([a, b]))
                size, gradient, curvature, _ = _oriented(
                    local.jacobian, local.derivative, local.gradient, local.hessian
                )
                out[:, i, j] = local.value, size * gradient, curvature
        return out[0], out[1], out[2]

    def kinematic(self, cells: int = 12) -> list[SingularPoint]:
        """Where all the largest minors of J vanish."""

        def minors(point: Vector) -> Vector:
            jacobian = self._local(point).jacobian
            m, n = jacobian.shape
            return np.array([np.linalg.det(jacobian[:, list(pick)]) for pick in combinations(range(n), m)])

        return [
            self._point(Kind.KINEMATIC, point, math.nan, not _edge(self._local(point)))
            for point in self._roots(minors, cells)
        ]

    def algorithmic(self, cells: int = 12) -> list[SingularPoint]:
        """Where Z h and its derivative along the self-motion vanish together."""

        def residual(point: Vector) -> Vector:
            return np.array(self._optimality(point)[:2])

        roots = [root for root in self._roots(residual, cells) if self._rank(root) > _SAME]
        return [
            self._point(Kind.ALGORITHMIC, root, math.nan, float(np.abs(self._optimality(root)[2]).max()) > _SAME)
            for root in roots
        ]

    def _on_bound(self, kind: Kind, joint: int, bound: float, samples: int) -> list[SingularPoint]:
        """SS: the self-motion does not move the bounded joint. SAS: the optimum lies on the bound, whose multiplier is then 0."""
        column = self._joints.index(joint)

        def value(other: float) -> float:
            motion = self._optimality(self._at(column, bound, other))
            return float(motion[2][column]) if kind is Kind.SEMI else motion[0]

        return [
            self._point(kind, self._at(column, bound, root), bound, True)
            for root in _sign_changes(value, samples)
            if self._rank(self._at(column, bound, root)) > _SAME
        ]

    def _at(self, column: int, bound: float, other: float) -> Vector:
        return np.array([bound, other]) if column == 0 else np.array([other, bound])

    def _local(self, point: Vector) -> Local:
        q = self._rest.copy()
        q[list(self._joints)] = point
        return self._measure.at(q)

    def _rank(self, point: Vector) -> float:
        sigma = np.linalg.svd(self._local(point).jacobian, compute_uv=False)
        return float(sigma[-1] / sigma[0])

    def _optimality(self, point: Vector) -> tuple[float, float, Vector]:
        """z·h, its derivative along z, and the two components of z; z turned so that it is continuous: det [J; z] > 0."""
        local = self._local(point)
        _, gradient, curvature, motion = _oriented(local.jacobian, local.derivative, local.gradient, local.hessian)
        return gradient, curvature, motion[list(self._joints)]

    def _roots(self, residual: Callable[[Vector], Vector], cells: int) -> list[Vector]:
        """Distinct roots on the torus, by Gauss-Newton from a grid."""
        roots: list[Vector] = []
        steps = (np.arange(cells) + 0.37) * 2.0 * math.pi / cells - math.pi
        for start in (np.array([a, b]) for a in steps for b in steps):
            root = _gauss_newton(residual, start)
            if root is not None and all(np.abs(_wrapped(root - known)).max() > _SAME for known in roots):
                roots.append(_wrapped(root))
        return roots

    def _point(self, kind: Kind, point: Vector, bound: float, regular: bool) -> SingularPoint:
        placed = _wrapped(point)
        inside = True
        for joint, (low, high) in self._bounds.items():
            column = self._joints.index(joint)
            middle = 0.5 * (low + high)
            placed[column] = middle + _wrapped(placed[column : column + 1] - middle)[0]
            inside = inside and low - _SAME <= placed[column] <= high + _SAME
        return SingularPoint(kind, placed, bound, inside, regular)


@compiled
def _oriented(
    jacobian: Matrix, derivative: Tensor, gradient: Vector, hessian: Matrix
) -> tuple[float, float, float, Vector]:
    """√det(J Jᵀ), z·h, its derivative along z, and z (n,) with det [J; z] > 0."""
    n = gradient.shape[0]
    null, rows, _ = projected_curvature(jacobian, derivative, gradient, hessian, np.zeros((0, n)), np.zeros((0, n, n)))
    square = np.empty((n, n))
    square[: n - 1] = jacobian
    square[n - 1] = null[0]
    size = np.linalg.det(square)  # z is normal to the rows of J and of length 1
    sign = 1.0 if size >= 0.0 else -1.0
    return abs(size), sign * (null[0] @ gradient), rows[0] @ null[0], sign * null[0]


def _wrapped(angles: Vector) -> Vector:
    return np.array([math.remainder(angle, 2.0 * math.pi) for angle in angles])


def _gauss_newton(residual: Callable[[Vector], Vector], start: Vector) -> Vector | None:
    """A root near `start`, or None where the iteration does not settle on one."""
    point: Vector = start.copy()
    for _ in range(40):
        value = residual(point)
        slope: Matrix = np.column_stack(
            [(residual(point + e) - residual(point - e)) / (2.0 * _STEP) for e in _STEP * np.eye(2)]
        )
        step = -np.asarray(np.linalg.lstsq(slope, value, rcond=1e-10)[0], np.float64)
        length = float(np.linalg.norm(step))
        if not math.isfinite(length):
            return None
        if length > 0.0:
            point += step * min(1.0, 0.3 / length)
        if length < _DONE or (length < 1e-10 and float(np.abs(value).max()) < 1e-12):
            return point if float(np.abs(residual(point)).max()) < 1e-9 else None
    return None


def _sign_changes(value: Callable[[float], float], samples: int) -> Iterator[float]:
    """Roots on (−π, π], each where the sign changes between neighbouring samples, to the last bit."""
    angles = np.linspace(-math.pi, math.pi, samples + 1) + 1e-3
    values = [value(float(angle)) for angle in angles]
    for i in range(samples):
        if values[i] * values[i + 1] < 0.0:
            yield float(brentq(value, angles[i], angles[i + 1], xtol=1e-15, rtol=8.9e-16))


def _edge(local: Local) -> bool:
    """Whether the workspace ends here: no second-order self-motion exists that would give the lost direction back to both sides."""
    left, sigma, right = np.linalg.svd(local.jacobian)
    null = right[int((sigma > _SAME * sigma[0]).sum()) :]
    second = np.einsum("r,jri->ji", left[:, -1], local.derivative)
    curvature = np.linalg.eigvalsh(null @ (0.5 * (second + second.T)) @ null.T)
    return bool(curvature[0] > 0.0 or curvature[-1] < 0.0)
