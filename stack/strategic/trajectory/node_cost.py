"""What the nodes of a trajectory cost, with derivatives, compiled; and a convex stand-in for a Hessian that is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.strategic.trajectory.chain import manipulability_gradient
from stack.strategic.trajectory.potentials import potential_derivatives, potential_value
from stack.strategic.trajectory.self_collision import add_nearness_derivatives, nearness

PLAIN, AWAY, POTENTIAL = 0, 1, 2
"""Kinds of singularity cost: none, manipulability, potentials."""
STEP = 1e-5


@compiled
def node_value(
    kind: int, q: Vector, chain: Matrix, f: Matrix, a: Vector, b: Vector,
    conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector, spheres: Matrix, pairs: NDArray[np.int64],
) -> float:  # fmt: skip
    """Cost of one node: `shape` = (weight, ε, height, steepness of the singularities; clearance, weight of pairs of spheres)."""
    value = 0.0
    if kind == 1:
        value = shape[0] / (manipulability_gradient(chain, q, np.empty(q.size)) + shape[1])
    elif kind == 2:
        value = shape[0] * potential_value(q, f, a, b, conditions, sets, shape[2], shape[3])
    if pairs.shape[0] > 0:
        value += shape[5] * nearness(chain, q, spheres, pairs, shape[4])
    return value


@compiled
def node_derivatives(
    kind: int, q: Vector, chain: Matrix, f: Matrix, a: Vector, b: Vector,
    conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector, spheres: Matrix, pairs: NDArray[np.int64],
    gradient: Vector, hessian: Matrix,
) -> None:  # fmt: skip
    """Gradient (n,) and Hessian (n, n) of the same. Manipulability: second derivatives by central differences of its gradient."""
    n = q.size
    gradient[:] = 0.0
    hessian[:, :] = 0.0
    if kind == 2:
        positive = np.empty((n, n))
        potential_derivatives(q, f, a, b, conditions, sets, shape[2], shape[3], gradient, positive, hessian)
        for i in range(n):
            gradient[i] *= shape[0]
            for j in range(n):
                hessian[i, j] = shape[0] * (positive[i, j] + hessian[i, j])
    elif kind == 1:
        slope, ahead, behind = np.empty(n), np.empty(n), np.empty(n)
        bend = np.empty((n, n))
        m = manipulability_gradient(chain, q, slope) + shape[1]
        moved = q.copy()
        for i in range(n):
            moved[i] = q[i] + STEP
            manipulability_gradient(chain, moved, ahead)
            moved[i] = q[i] - STEP
            manipulability_gradient(chain, moved, behind)
            moved[i] = q[i]
            for j in range(n):
                bend[i, j] = (ahead[j] - behind[j]) / (2.0 * STEP)
        for i in range(n):
            gradient[i] = -shape[0] / (m * m) * slope[i]
            for j in range(n):
                own = 0.5 * (bend[i, j] + bend[j, i])
                hessian[i, j] = shape[0] / (m * m) * (2.0 / m * slope[i] * slope[j] - own)
    if pairs.shape[0] > 0:
        add_nearness_derivatives(chain, q, spheres, pairs, shape[4], shape[5], gradient, hessian)


@compiled
def without_negative_curvature(hessian: Matrix, out: Matrix) -> None:
    """The nearest semidefinite matrix to `hessian` (n, n), both symmetric."""
    n = hessian.shape[0]
    out[:, :] = hessian
    if not hessian.any():
        return
    values, vectors = np.linalg.eigh(hessian)
    if values[0] >= 0.0:
        return
    for m in range(n):
        if values[m] < 0.0:
            for i in range(n):
                for j in range(n):
                    out[i, j] -= values[m] * vectors[i, m] * vectors[j, m]


@compiled
def objective(
    kind: int, q: Matrix, a: Matrix, h: float, time: float, effort: float, chain: Matrix, f: Matrix, fa: Vector, fb: Vector,
    conditions: NDArray[np.int64], sets: NDArray[np.int64], shape: Vector, spheres: Matrix, pairs: NDArray[np.int64],
) -> float:  # fmt: skip
    """time · N h + effort · Σ|a|²/h⁴ + Σ over the inner nodes of what they cost."""
    value = float(time * q.shape[0] * h + effort * np.sum(a * a) / h**4)
    if kind != 0 or pairs.shape[0] > 0:
        for k in range(1, q.shape[0] - 1):
            value += node_value(kind, q[k], chain, f, fa, fb, conditions, sets, shape, spheres, pairs)
    return value
