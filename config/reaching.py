"""Goals of steps that go to a pose or to a configuration: their tables, and the motions built from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from pydantic import model_validator

from config.errors import ConfigError
from config.table import Finite, NotNegative, Table, Vector3
from stack.kinematics.arm import ArmModel
from stack.messages import Matrix, Vector
from stack.strategic.point_to_point import Choose, Goal, JointPath, Plan, PointToPoint
from stack.strategic.reach import Reach
from stack.strategic.straight import straight_path
from stack.strategic.trajectory import Objective as TrajectoryObjective
from stack.strategic.trajectory import Trajectory, TrajectoryLimits, TrajectoryProblem, Weights, solve

Objective = Literal["straight", "none", "manipulability", "potentials"]
Postures = Callable[[ArmModel], Choose]
"""Arm to a choice of configurations for poses; made by whoever has the manipulability map."""


class PoseTable(Table):
    """A pose of the TCP in the reference frame (the world, where the TCP is tracked). `rpy_rad`: turns about x, then y, then z of
    that frame; without it the orientation is that of the beginning."""

    position_m: Vector3
    rpy_rad: Vector3 | None = None

    def rotation(self) -> Matrix | None:
        """(3, 3), None where the orientation stays."""
        return None if self.rpy_rad is None else _rotation(*self.rpy_rad)


class GoalTable(Table):
    """Where a step of kind `joints` goes: `configuration`, rad and m, or the best posture for `pose`; from `at_s` on."""

    configuration: tuple[Finite, ...] | None = None
    pose: PoseTable | None = None
    at_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_of_two(self) -> GoalTable:
        if (self.configuration is None) == (self.pose is None):
            raise ValueError("a goal needs configuration or pose, one of the two")
        if self.pose is not None and self.pose.rpy_rad is None:
            raise ValueError("the pose of a goal needs rpy_rad")
        return self


def reach(pose: PoseTable, speed: float, rate: float | None, ramp_s: float) -> Reach:
    """The motion of a step of kind `reach`."""
    return Reach(np.array(pose.position_m), speed, rate or 0.8, ramp_s, pose.rotation())


def point_to_point(
    goals: tuple[GoalTable, ...], objective: Objective, arm: ArmModel, choose: Choose, where: str
) -> PointToPoint:
    """The motion of a step of kind `joints`.

    Raises ConfigError for configurations of the wrong length or outside the joint limits.
    """
    return PointToPoint(
        tuple(_goal(goal, arm, f"{where}: goal.{i}") for i, goal in enumerate(goals)),
        _plan(objective, arm),
        choose,
        arm.pose,
    )


def _goal(table: GoalTable, arm: ArmModel, where: str) -> Goal:
    if table.pose is not None:
        pose = np.eye(4)
        rotation = table.pose.rotation()
        assert rotation is not None  # its table has been checked
        pose[:3, :3], pose[:3, 3] = rotation, table.pose.position_m
        return Goal(pose=pose, at_s=table.at_s)
    assert table.configuration is not None
    if len(table.configuration) != arm.n:
        raise ConfigError(f"{where}.configuration has {len(table.configuration)} values, must have {arm.n}")
    for i, q in enumerate(table.configuration):
        if not arm.q_min[i] <= q <= arm.q_max[i]:
            span = f"{arm.q_min[i]:.4g} to {arm.q_max[i]:.4g}"
            raise ConfigError(f"{where}.configuration.{i} = {q:g} ({arm.joint_names[i]}): must be within {span}")
    return Goal(q=np.array(table.configuration), at_s=table.at_s)


def _plan(objective: Objective, arm: ArmModel) -> Plan:
    if objective == "straight":
        return partial(straight_path, dq_max=arm.dq_max, ddq_max=arm.ddq_max)
    aim = TrajectoryObjective(objective)

    def plan(q: Vector, dq: Vector, goal: Vector) -> JointPath | str:
        # An arm that stands on a limit leaves an interior-point method no interior.
        limits = TrajectoryLimits(
            np.minimum(arm.q_min, np.minimum(q, goal) - ROOM),
            np.maximum(arm.q_max, np.maximum(q, goal) + ROOM),
            arm.dq_max,
            arm.ddq_max,
        )
        problem = TrajectoryProblem(arm.name, q, goal, dq_start=dq, objective=aim, limits=limits, weights=QUICK)
        trajectory = solve(problem)
        return Planned(trajectory) if trajectory.status.usable else trajectory.message

    return plan


ROOM = 2e-3
"""rad, m; the planner keeps to the limits themselves, whatever the trajectory does in between."""
QUICK = Weights(time=2000.0)
"""The arm is to use the speed that it has: the paper's weight makes leisurely motions of slow joints."""


@dataclass(frozen=True, slots=True)
class Planned:
    """A trajectory as the motion wants it."""

    trajectory: Trajectory

    @property
    def duration_s(self) -> float:
        return self.trajectory.duration_s

    def at(self, t_s: float) -> tuple[Vector, Vector]:
        q, dq, _ = self.trajectory.at(t_s)
        return q, dq


def _rotation(roll: float, pitch: float, yaw: float) -> Matrix:
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
