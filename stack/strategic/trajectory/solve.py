"""From a problem to a trajectory."""

from __future__ import annotations

from stack.strategic.trajectory.problem import Trajectory, TrajectoryProblem
from stack.strategic.trajectory.structured import solve_structured


def solve(problem: TrajectoryProblem, guess: Trajectory | None = None) -> Trajectory:
    """The trajectory of `problem`; `guess`: a solution of a problem nearby, to begin with (replanning)."""
    return solve_structured(problem, guess)
