"""Singularity-avoiding point-to-point trajectories in joint space (Beck, Vu, Hartl-Nesic, Kugi, IFAC-PapersOnLine 56-2, 2023)."""

from stack.strategic.trajectory.problem import (
    Objective,
    Status,
    Trajectory,
    TrajectoryLimits,
    TrajectoryProblem,
    Weights,
)
from stack.strategic.trajectory.solve import solve

__all__ = ["Objective", "Status", "Trajectory", "TrajectoryLimits", "TrajectoryProblem", "Weights", "solve"]
