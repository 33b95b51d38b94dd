"""First trajectories: the motion of least acceleration between two states, and an earlier solution moved to a new start."""

from __future__ import annotations

import numpy as np

from stack.messages import Matrix, Vector
from stack.strategic.trajectory.problem import Trajectory


def least_acceleration(
    q_start: Vector, w_start: Vector, q_goal: Vector, w_goal: Vector, points: int
) -> tuple[Matrix, Matrix, Matrix]:
    """Positions, velocities (N, n), accelerations (N−1, n), time in steps: the discrete cubic, accelerations linear in time."""
    stages = points - 1
    k = np.arange(stages, dtype=np.float64)
    reach = stages - 0.5 - k  # what an acceleration in step k adds to the last position
    # a_k = x + y·reach_k fulfils both end conditions.
    sums = np.array([[float(stages), reach.sum()], [reach.sum(), (reach**2).sum()]])
    wanted = np.array([w_goal - w_start, q_goal - q_start - stages * w_start])
    x, y = np.linalg.solve(sums, wanted)
    return rolled_out(q_start, w_start, x + np.outer(reach, y))


def by_way_of(
    q_via: Vector, q_start: Vector, w_start: Vector, q_goal: Vector, w_goal: Vector, points: int
) -> tuple[Matrix, Matrix, Matrix]:
    """The same by way of `q_via` (n,) half-way, passed at the speed of the straight line from start to goal."""
    first = (points - 1) // 2
    w_via = (q_goal - q_start) / (points - 1)
    q, w, a = least_acceleration(q_start, w_start, q_via, w_via, first + 1)
    p, v, b = least_acceleration(q_via, w_via, q_goal, w_goal, points - first)
    return np.vstack([q, p[1:]]), np.vstack([w, v[1:]]), np.vstack([a, b])


def rolled_out(q_start: Vector, w_start: Vector, a: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """What the accelerations `a` (N−1, n) do to the double integrator."""
    w = np.vstack([w_start, w_start + np.cumsum(a, axis=0)])
    q = np.vstack([q_start, q_start + np.cumsum(w[:-1] + 0.5 * a, axis=0)])
    return q, w, np.ascontiguousarray(a)


def moved(
    guess: Trajectory, q_start: Vector, dq_start: Vector, q_goal: Vector, dq_goal: Vector
) -> tuple[Matrix, Matrix, Matrix]:
    """The rest of `guess` from where it is nearest to the start, resampled, with its ends corrected by a cubic."""
    points = len(guess.q)
    first = int(np.argmin(((guess.q[: points - 2] - q_start) ** 2).sum(axis=1)))
    left = np.linspace(first * guess.step_s, guess.duration_s, points)
    h = float(left[1] - left[0])
    w = np.array([guess.at(t)[1] for t in left]) * h
    a = np.diff(w, axis=0)
    q, w, a = rolled_out(guess.q[first], w[0], a)
    dq, dw, da = least_acceleration(q_start - q[0], h * dq_start - w[0], q_goal - q[-1], h * dq_goal - w[-1], points)
    return q + dq, w + dw, a + da
