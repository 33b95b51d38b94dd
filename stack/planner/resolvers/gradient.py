"""Gradient projection (2.25-2.27): q̇ = J⁺ẋ + N Nᵀ z, the classic; B is taken as the identity whatever the problem says."""

from __future__ import annotations

import numpy as np

from stack.planner.problem import Problem, Solution, Vector
from stack.planner.resolvers.answer import answer
from stack.planner.resolvers.decomposition import damped_inverse, decompose
from stack.planner.resolvers.row_correction import RowCorrection


def resolve(problem: Problem) -> Solution:
    """Pseudo-inverse with propped singular values plus the projection of z; rows of A are met inside the null space, by
    overwriting where it has no room; velocity bounds by slowing down on the path."""
    p = problem
    m = p.J.shape[0]
    u, sigma, vt = decompose(p.J)
    inverse = vt[:m].T @ (u.T * np.array([damped_inverse(value, p.epsilon) for value in sigma])[:, None])
    projector = vt[m:].T @ vt[m:]
    correction = RowCorrection(projector, p.A, np.linalg.norm(p.A, axis=1), p.epsilon_restriction)

    def respond(xdot: Vector, z: Vector, b: Vector) -> tuple[Vector, Vector, bool]:
        unconstrained = inverse @ xdot + projector @ z
        return correction.apply(unconstrained, b), unconstrained, correction.damped

    return answer(p, sigma, respond)
