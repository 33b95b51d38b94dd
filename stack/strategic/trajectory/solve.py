"""From a problem to a trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stack.strategic.trajectory.goal_pose import goal_configurations
from stack.strategic.trajectory.problem import Status, Trajectory, TrajectoryLimits, TrajectoryProblem
from stack.strategic.trajectory.structured import nothing, solve_structured

GOALS = 4
"""Configurations with the goal's pose that are tried, nearest first."""


def solve(problem: TrajectoryProblem, guess: Trajectory | None = None) -> Trajectory:
    """The trajectory of `problem`; `guess`: a solution of a problem nearby, to begin with (replanning). Pure; always returns.

    A local optimum, the better the status says it is; look at `status.usable` before use. For a pose: the best of the trajectories to the
    nearest configurations that have it.
    """
    if problem.pose_goal is None:
        return solve_structured(problem, guess)
    limits, start = problem.limits, np.asarray(problem.q_start)
    assert isinstance(limits, TrajectoryLimits)
    goals = goal_configurations(problem.robot, np.asarray(problem.pose_goal), start, limits)[:GOALS]
    if not goals:
        return nothing(problem, Status.POSE_OUT_OF_REACH)
    found = [solve_structured(replace(problem, pose_goal=None, q_goal=goal), guess) for goal in goals]
    return min(found, key=lambda one: (not one.status.usable, one.objective))
