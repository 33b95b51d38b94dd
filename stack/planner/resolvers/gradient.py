"""Gradient projection (2.25-2.27): q̇ = J⁺ẋ + N Nᵀ z, the classic; B is taken as the identity whatever the problem says."""

from __future__ import annotations

import numpy as np

from stack.planner.problem import Problem, Solution, Vector
from stack.planner.resolvers.answer import answer
from stack.planner.resolvers.decomposition import decompose, prop


def resolve(problem: Problem) -> Solution:
    """Pseudo-inverse with propped singular values plus the projection of z; rows of A are met inside the null space, by least
    squares, and by overwriting where it has no room; velocity bounds by slowing down on the path."""
    p = problem
    m = p.J.shape[0]
    u, sigma, vt = decompose(p.J)
    inverse = vt[:m].T @ (u.T / np.array([prop(value, p.epsilon) for value in sigma])[:, None])
    projector = vt[m:].T @ vt[m:]
    if p.b.size:
        lengths = np.linalg.norm(p.A, axis=1)
        lengths[lengths == 0.0] = 1.0
        rows = p.A / lengths[:, None]
        values, vectors = np.linalg.eigh(rows @ projector @ rows.T)
        propped = np.array([prop(max(value, 0.0), p.epsilon_restriction) for value in values])
        near_singular = bool((values < p.epsilon_restriction).any())
        into_rows = projector @ rows.T @ (vectors / propped) @ vectors.T
        overwriting = np.linalg.pinv(p.A, rcond=1e-9)

    def respond(xdot: Vector, z: Vector, b: Vector) -> tuple[Vector, Vector, bool]:
        unconstrained = inverse @ xdot + projector @ z
        if b.size == 0:
            return unconstrained, unconstrained, False
        dq = unconstrained + into_rows @ ((b - p.A @ unconstrained) / lengths)
        if near_singular:
            dq = dq + overwriting @ (b - p.A @ dq)
        else:
            dq = dq + into_rows @ ((b - p.A @ dq) / lengths)
        return dq, unconstrained, near_singular

    return answer(p, sigma, respond)
