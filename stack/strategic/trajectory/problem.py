"""What a point-to-point trajectory has to do, and the trajectory itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from stack.kinematics import ArmModel
from stack.kinematics.arrays import finite, frozen
from stack.messages import Matrix, Vector

FEWEST_POINTS = 6


class Objective(Enum):
    """What is minimised besides the time and the accelerations."""

    NONE = "none"
    MANIPULABILITY = "manipulability"
    """w_m / (m(q) + ε), m Yoshikawa's measure of the arm (23)"""
    POTENTIALS = "potentials"
    """w_m Σ exp(η₁ − η₂ ψᵢ(q)) over the robot's singular manifolds (24–27)"""
    LISTED_POTENTIALS = "listed-potentials"
    """The same over the thesis's incomplete list A1–A6 and L1–L4, for comparison; moma8 only"""


class Status(Enum):
    """How a solution ended; `.value` says what to do about it."""

    SOLVED = "solved"
    ACCEPTABLE = (
        "every limit holds, the optimum is met only roughly: usable; a guess from a neighbouring problem refines it"
    )
    STALLED = "no optimum was found: do not use it; plan again from a guess, with longer motion (smaller time weight) or wider limits"
    START_CANNOT_STOP = (
        "the start is outside its limits or too fast to stop before them: brake first, or widen the position limits"
    )
    GOAL_OUTSIDE_LIMITS = "the goal is outside the joint limits: choose a goal inside them"
    POSE_OUT_OF_REACH = (
        "no configuration inside the joint limits has the goal's pose: move the platform or choose another pose"
    )

    COLLIDES = "the arm's links could touch on the way: do not use it; plan over a configuration in between"

    @property
    def usable(self) -> bool:
        return self in (Status.SOLVED, Status.ACCEPTABLE)


@dataclass(frozen=True, slots=True)
class Weights:
    """Of the objective `time · t_F + acceleration · Σ |q̈_k|² + singularity · Σ L(q_k) + collision · Σ C(q_k)`.

    The paper prints 1 for `time`; 556 comes close to its tables (fitted on their first column). `singularity` is its w_m = 10²,
    `epsilon` its ε, `height` = exp η₁, `steepness` = η₂. `collision`: what one pair of spheres costs that touch (`self_collision`).
    """

    time: float = 556.0
    acceleration: float = 1.0
    singularity: float = 100.0
    epsilon: float = 1e-6
    height: float = 2400.0
    steepness: float = 400.0
    collision: float = 5000.0

    def __post_init__(self) -> None:
        for name in ("time", "acceleration", "epsilon", "height", "steepness", "collision"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"weights.{name} is {value}, must be positive")
        if not (math.isfinite(self.singularity) and self.singularity >= 0.0):
            raise ValueError(f"weights.singularity is {self.singularity}, must not be negative")


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryLimits:
    """(n,) each: rad and s, or m; velocities and accelerations hold in both directions."""

    q_min: Vector
    q_max: Vector
    dq_max: Vector
    ddq_max: Vector

    def __post_init__(self) -> None:
        n = np.asarray(self.q_min).size
        for name in ("q_min", "q_max", "dq_max", "ddq_max"):
            object.__setattr__(self, name, frozen(finite(name, getattr(self, name), (n,))))
        if not (self.q_min < self.q_max).all():
            raise ValueError(f"q_min {self.q_min} is not below q_max {self.q_max} in every joint")
        for name in ("dq_max", "ddq_max"):
            if not (getattr(self, name) > 0.0).all():
                raise ValueError(f"{name} is {getattr(self, name)}, must be positive in every joint")


@lru_cache(maxsize=16)
def arm_model(robot: str) -> ArmModel:
    """The robot `robot`, read once."""
    return ArmModel.load(robot)


@lru_cache(maxsize=16)
def limits_of(robot: str) -> TrajectoryLimits:
    """The limits that the robot's file gives."""
    arm = arm_model(robot)
    return TrajectoryLimits(arm.q_min, arm.q_max, arm.dq_max, arm.ddq_max)


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryProblem:
    """From the state (`q_start`, `dq_start`) of `robot`'s arm to a state (`q_goal`, `dq_goal`) or to rest at a TCP pose.

    All vectors (n,), `pose_goal` (4, 4) in the arm's base frame; exactly one of `q_goal` and `pose_goal`. Velocities that are not given
    are zero, limits the robot's own. `clearance` (m): the links are kept off each other, softly below this distance; a motion on which they
    could touch is not usable (`Status.COLLIDES`). None: they are not looked at. ValueError names the field that is wrong.
    """

    robot: str
    q_start: ArrayLike
    q_goal: ArrayLike | None = None
    pose_goal: ArrayLike | None = None
    dq_start: ArrayLike | None = None
    dq_goal: ArrayLike | None = None
    objective: Objective = Objective.NONE
    limits: TrajectoryLimits | None = None
    weights: Weights = field(default_factory=Weights)
    points: int = 30
    clearance: float | None = None

    def __post_init__(self) -> None:
        limits = limits_of(self.robot) if self.limits is None else self.limits
        n = arm_model(self.robot).n
        if limits.q_min.size != n:
            raise ValueError(f"limits are for {limits.q_min.size} joints, robot {self.robot} has {n}")
        object.__setattr__(self, "limits", limits)
        if (self.q_goal is None) == (self.pose_goal is None):
            raise ValueError("give exactly one of q_goal and pose_goal")
        if self.points < FEWEST_POINTS:
            raise ValueError(f"points is {self.points}, must be at least {FEWEST_POINTS}")
        if self.clearance is not None and not (math.isfinite(self.clearance) and self.clearance > 0.0):
            raise ValueError(f"clearance is {self.clearance}, must be positive (m), or None: links are not looked at")
        for name in ("q_start", "dq_start", "q_goal", "dq_goal"):
            value = getattr(self, name)
            if value is None and name.startswith("dq"):
                value = np.zeros(n)
            if value is not None:
                object.__setattr__(self, name, frozen(finite(name, value, (n,))))
        if self.pose_goal is not None:
            object.__setattr__(self, "pose_goal", frozen(finite("pose_goal", self.pose_goal, (4, 4))))


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Nodes of a motion, `step_s` apart: `q`, `dq`, `ddq` (N, n); the acceleration of node k holds until node k + 1.

    `t_f` (s) is the paper's t_F = N · step_s; the motion lasts `duration_s` = (N − 1) · step_s. `objective` with the problem's weights.
    `stationarity` (the Newton decrement in shares of the objective), `infeasibility` and `complementarity`: how well the optimum is met.
    """

    q: Matrix
    dq: Matrix
    ddq: Matrix
    t_f: float
    status: Status
    iterations: int
    objective: float
    stationarity: float = 0.0
    infeasibility: float = 0.0
    complementarity: float = 0.0

    @property
    def step_s(self) -> float:
        return self.t_f / len(self.q)

    @property
    def duration_s(self) -> float:
        """Its length in time."""
        return self.step_s * (len(self.q) - 1)

    @property
    def message(self) -> str:
        """What to do about it, one line."""
        return self.status.value

    def at(self, t_s: float) -> tuple[Vector, Vector, Vector]:
        """Position, velocity, acceleration (n,) at `t_s`; the first and last node before and after, there without acceleration.

        Position and velocity are continuous; where the status is usable, all three stay inside their limits, between the nodes, too.
        """
        if t_s < 0.0 or t_s >= self.duration_s:
            end = 0 if t_s < 0.0 else -1
            return self.q[end].copy(), self.dq[end].copy(), np.zeros(self.q.shape[1])
        k = min(int(t_s / self.step_s), len(self.q) - 2)
        dt = t_s - k * self.step_s
        q = self.q[k] + dt * (self.dq[k] + 0.5 * dt * self.ddq[k])
        return q, self.dq[k] + dt * self.ddq[k], self.ddq[k].copy()
