"""What a step of a mission does while it lasts: a pure law from what the strategic layer hears to what it asks for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from stack.messages import Gripper, Matrix, PlannerState, Vector

CYCLE_NS = 20_000_000
CYCLE_S = CYCLE_NS * 1e-9

ZERO_TWIST = np.zeros(6)
ZERO_TWIST.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class MotionInputs:
    """What has been heard. Whatever is stale or was never received is None.

    `t_s`: time since the motion began. `planner`: its state frame. `rotation_RE` (3, 3): the TCP's orientation as the planner had it when
    the step began. `X_RE` (4, 4): the TCP pose that the planner is after, now. `wrench` (6,) `[f; m]`: acts on the TCP from outside,
    end-point frame. `grasped`: whether the gripper holds something. `q` (n,): the arm's joints as the planner read them last.
    `singularity_margin`: of the arm's kinematic singularities, 0 on one, at most 1 (see `stack.planner.monitor`).
    """

    t_s: float
    planner: PlannerState
    rotation_RE: Matrix
    X_RE: Matrix | None = None
    wrench: Vector | None = None
    grasped: bool | None = None
    q: Vector | None = None
    singularity_margin: float | None = None


@dataclass(frozen=True, slots=True)
class ParameterWrite:
    """One object of the planner to be written by SDO."""

    index: int
    subindex: int
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionOutputs:
    """What to ask for in the coming cycle: a twist (6,) of the TCP in the end-point frame (of the platform where it is the
    platform that moves: v in [0], ω in [5]), joint positions (n,) for `Mode.JOINTS`, what the gripper shall do.

    `done`: the motion has come to its end, and nothing of these outputs is sent. `failure`: why it never will, in one line. `found`: what
    was measured on the way, by name, for whoever judges the run. `writes`: what the planner shall know from now on, while the motion goes
    on; what comes before the last ones were confirmed is left out.
    """

    twist: Vector = field(default_factory=lambda: ZERO_TWIST)
    joints: Vector | None = None
    gripper: Gripper = Gripper.KEEP
    done: bool = False
    failure: str | None = None
    event: str | None = None
    found: tuple[tuple[str, float], ...] = ()
    writes: tuple[ParameterWrite, ...] = ()


class Motion(Protocol):
    """One kind of step. `State` is whatever frozen value the motion carries from cycle to cycle."""

    def begin(self, inputs: MotionInputs) -> Any:
        """The state at t = 0."""

    def step(self, state: Any, inputs: MotionInputs) -> tuple[Any, MotionOutputs]:
        """One strategic cycle of `CYCLE_NS`. Pure: the same arguments give the same result, bit for bit."""
