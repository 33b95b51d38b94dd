"""Parameterization through null space (2.112-2.139): particular solution and null-space base from one SVD, then the split."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.planner.problem import Matrix, Problem, Solution, Vector
from stack.planner.resolvers.answer import answer
from stack.planner.resolvers.decomposition import decompose
from stack.planner.resolvers.nullspace import particular, restrict, split, whiten


@compiled
def pns_respond(
    u: Matrix,
    sigma: Vector,
    vt: Matrix,
    white: Matrix,
    weight: Matrix,
    xdot: Vector,
    z: Vector,
    rows: Matrix,
    values: Vector,
    epsilon: float,
    epsilon_restriction: float,
) -> tuple[Vector, Vector, bool, bool]:
    """q̇, q̇_u (n,), propped, damped from the SVD and the whitened base; linear in (ẋ, z, values). Arrays are taken as they are."""
    dq_particular, propped = particular(u, sigma, vt, xdot, epsilon)
    unconstrained = split(white, weight, dq_particular, z)
    if rows.shape[0] == 0:
        return unconstrained.copy(), unconstrained, propped, False
    softness = np.zeros(rows.shape[0])
    dq, _, damped = restrict(white, weight, unconstrained, rows, values, softness, epsilon_restriction)
    return dq, unconstrained, propped, damped


@compiled
def pns(
    jacobian: Matrix,
    xdot: Vector,
    weight: Matrix,
    z: Vector,
    rows: Matrix,
    values: Vector,
    epsilon: float,
    epsilon_restriction: float,
) -> tuple[Vector, Vector, Vector, bool, bool]:
    """The whole method without any check: q̇, q̇_u (n,), σ (m,), propped, damped.

    All arguments float64 and C-contiguous: J (m, n), ẋ (m,), B (n, n), z (n,), A (k, n), b (k,), k may be 0.
    """
    u, sigma, vt = decompose(jacobian)
    white = whiten(vt[jacobian.shape[0] :], weight)
    dq, unconstrained, propped, damped = pns_respond(
        u, sigma, vt, white, weight, xdot, z, rows, values, epsilon, epsilon_restriction
    )
    return dq, unconstrained, sigma, propped, damped


def resolve(problem: Problem) -> Solution:
    """The optimum of `problem`; velocity bounds are kept by slowing down on the path, preferred motion given up first."""
    p = problem
    u, sigma, vt = decompose(p.J)
    white = whiten(vt[p.J.shape[0] :], p.B)

    def respond(xdot: Vector, z: Vector, b: Vector) -> tuple[Vector, Vector, bool]:
        dq, unconstrained, _, damped = pns_respond(
            u, sigma, vt, white, p.B, xdot, z, p.A, b, p.epsilon, p.epsilon_restriction
        )
        return dq, unconstrained, damped

    return answer(p, sigma, respond)


def reference(
    jacobian: Matrix,
    xdot: Vector,
    weight: Matrix,
    z: Vector,
    rows: Matrix,
    values: Vector,
    epsilon: float,
) -> tuple[Vector, Vector, NDArray[np.float64]]:
    """The same in plain NumPy, formula by formula, for non-singular restrictions: q̇, q̇_u, σ. What the kernels are tested against."""
    m = jacobian.shape[0]
    u, sigma, vt = np.linalg.svd(jacobian)
    propped = np.where(sigma < epsilon, (sigma**2 + epsilon**2) / (2.0 * epsilon), sigma)
    dq_particular = vt[:m].T @ ((u.T @ xdot) * sigma / propped**2)
    base = vt[m:].T
    gram = base.T @ weight @ base
    w0 = np.linalg.solve(gram, base.T @ weight @ (z - dq_particular))
    unconstrained = dq_particular + base @ w0
    c = rows @ base
    d = values - rows @ dq_particular
    inverse_c = np.linalg.solve(gram, c.T)
    w = w0 + inverse_c @ np.linalg.solve(c @ inverse_c, d - c @ w0)
    return dq_particular + base @ w, unconstrained, sigma
