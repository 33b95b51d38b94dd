"""The arm to a configuration, along a trajectory that is planned when the motion begins, and again when its goal changes on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from stack.kinematics.se3 import pose_inverse
from stack.messages import Matrix, Vector
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs

SETTLE_S = 0.2
"""How long the goal is sent on after the trajectory's end: the planner follows references some cycles late."""


class JointPath(Protocol):
    """A motion of the joints from rest or motion to rest."""

    @property
    def duration_s(self) -> float:
        """Its length in time."""

    def at(self, t_s: float) -> tuple[Vector, Vector]:
        """Position and velocity (n,) at `t_s`, those of the ends outside [0, duration]."""


Plan = Callable[[Vector, Vector, Vector], JointPath | str]
"""(q, dq, goal), all (n,), to a path, or to one line that says why there is none."""
Choose = Callable[[Matrix], Vector | None]
"""TCP pose (4, 4) seen from the arm's base to a configuration (n,) that has it, None if there is none."""
Forward = Callable[[Vector], Matrix]
"""Configuration (n,) to the TCP pose (4, 4) seen from the arm's base."""


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Either a configuration `q` (n,), or a TCP `pose` (4, 4) in the reference frame. `at_s`: when it becomes the goal."""

    q: Vector | None = None
    pose: Matrix | None = None
    at_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PointToPointState:
    """`T_RA` (4, 4): where the arm's base stands (None: not known); which goal is in force, its path, and when that began."""

    T_RA: Matrix | None
    q: Vector
    dq: Vector
    index: int = -1
    path: JointPath | None = None
    began_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PointToPoint:
    """To the `goals` one after another, each from the moment it is announced; the last one is gone to its end.

    A new goal is planned from where the trajectory is by then, with the velocity that it has there: nothing stops in between. Fails with
    one line where a goal is out of reach or the plan does not succeed. Needs the joints at the beginning (`Step.reads_joints`).
    """

    goals: tuple[Goal, ...]
    plan: Plan
    choose: Choose
    forward: Forward

    def begin(self, inputs: MotionInputs) -> PointToPointState | None:
        if inputs.q is None:
            return None
        T_RA = None if inputs.X_RE is None else inputs.X_RE @ pose_inverse(self.forward(inputs.q))
        return PointToPointState(T_RA, inputs.q, np.zeros(inputs.q.size))

    def step(
        self, state: PointToPointState | None, inputs: MotionInputs
    ) -> tuple[PointToPointState | None, MotionOutputs]:
        if state is None:
            return None, MotionOutputs(failure="the arm's joints are not known")
        event = None
        due = max(i for i, goal in enumerate(self.goals) if i == 0 or goal.at_s <= inputs.t_s)
        if due != state.index:
            planned = self._replan(state, due, inputs.t_s)
            if isinstance(planned, str):
                return state, MotionOutputs(failure=planned)
            state = planned
            assert state.path is not None
            event = f"planned {state.path.duration_s:.2f} s to goal {due + 1} of {len(self.goals)}"
        assert state.path is not None
        elapsed = inputs.t_s - state.began_s
        if elapsed >= state.path.duration_s + SETTLE_S and due == len(self.goals) - 1:
            return state, MotionOutputs(done=True)
        # What is sent now shall be reached one strategic cycle from now: references are samples of one continuous motion.
        q, dq = state.path.at(elapsed + CYCLE_S)
        return replace(state, q=q, dq=dq), MotionOutputs(joints=q, event=event)

    def _replan(self, state: PointToPointState, due: int, t_s: float) -> PointToPointState | str:
        goal = self.goals[due]
        target = goal.q
        if target is None:
            assert goal.pose is not None  # by construction: one of the two
            if state.T_RA is None:
                return "where the arm stands is not known, so no pose can be planned to"
            target = self.choose(pose_inverse(state.T_RA) @ goal.pose)
            if target is None:
                return f"goal {due + 1} is out of reach"
        path = self.plan(state.q, state.dq, target)
        if isinstance(path, str):
            return f"no trajectory to goal {due + 1}: {path}"
        # `q` and `dq` are those of the reference sent last, which is this path's beginning.
        return replace(state, index=due, path=path, began_s=t_s)
