"""The strategic layer: a task as a sequence of steps, turned into twists, modes and parameter writes.

Pure: `step(state, inputs)` gives the next state and what to send. It knows the planner only by its messages: the state frame,
and the objects of its dictionary that it reads and writes by SDO.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stack.messages import Matrix, Mode, PlannerPhase, PlannerState, Vector
from stack.strategic.profile import RampProfile

CYCLE_NS = 20_000_000


class StepKind(Enum):
    """What a step's profile runs along."""

    WAIT = "wait"
    LINE = "line"
    DRIVE = "drive"
    TURN = "turn"


@dataclass(frozen=True, slots=True)
class ParameterWrite:
    """One object of the planner to be written by SDO."""

    index: int
    subindex: int
    value: float


@dataclass(frozen=True, slots=True)
class Step:
    """One step: `direction` (3,) unit vector in the reference frame (lines only); `wait_s` for WAIT."""

    name: str
    kind: StepKind
    mode: Mode
    profile: RampProfile | None = None
    direction: Vector | None = None
    wait_s: float = 0.0
    writes: tuple[ParameterWrite, ...] = ()

    @property
    def duration_s(self) -> float:
        return self.wait_s if self.profile is None else self.profile.duration_s


class Stage(Enum):
    """Where the mission is."""

    WAITING = "waiting for the planner"
    PREPARING = "writing parameters"
    LOCATING = "reading the TCP orientation"
    MOVING = "moving"
    FINISHED = "finished"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class MissionState:
    """Stage, index of the current step and when its profile began."""

    stage: Stage = Stage.WAITING
    index: int = 0
    began_ns: int = 0
    rotation_RE: Matrix | None = None


@dataclass(frozen=True, slots=True)
class MissionInputs:
    """What the strategic node has heard: `planner` is None when stale or never received.

    `writes_done`: every requested write was confirmed. `rotation_RE` (3, 3): the TCP's orientation as read, or None.
    """

    t_ns: int
    planner: PlannerState | None
    writes_done: bool = False
    rotation_RE: Matrix | None = None
    sdo_failure: str | None = None


@dataclass(frozen=True, slots=True)
class MissionOutputs:
    """What to send: a twist (6,) and mode every cycle; writes and the wish to read the orientation once, when entered."""

    twist: Vector
    mode: Mode
    step: int
    writes: tuple[ParameterWrite, ...] = ()
    read_orientation: bool = False
    event: str | None = None


ZERO_TWIST = np.zeros(6)
ZERO_TWIST.setflags(write=False)


@dataclass(frozen=True, slots=True)
class Mission:
    """A task: what to write first, then its steps in order."""

    steps: tuple[Step, ...]
    initial_writes: tuple[ParameterWrite, ...] = ()

    def step(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        """One strategic cycle. Never raises: a failing planner or SDO ends in Stage.FAILED with an event that says why."""
        if state.stage in (Stage.FINISHED, Stage.FAILED):
            return state, self._rest(state)
        failure = _failure(state, inputs)
        if failure is not None:
            failed = replace(state, stage=Stage.FAILED)
            return failed, self._rest(failed, event=failure)
        return _STAGES[state.stage](self, state, inputs)

    def _rest(self, state: MissionState, event: str | None = None) -> MissionOutputs:
        mode = Mode.OFF if state.stage in (Stage.WAITING, Stage.FINISHED, Stage.FAILED) else Mode.HOLD
        return MissionOutputs(ZERO_TWIST, mode, state.index, event=event)

    def _wait(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        """Ask for HOLD: the planner enables the drives and reports IDLE."""
        ready = inputs.planner is not None and inputs.planner.phase in (PlannerPhase.IDLE, PlannerPhase.EXECUTING)
        asking = inputs.planner is not None and inputs.planner.phase >= PlannerPhase.READY
        if not ready:
            return state, MissionOutputs(ZERO_TWIST, Mode.HOLD if asking else Mode.OFF, 0)
        writes = self.initial_writes + self.steps[0].writes
        return replace(state, stage=Stage.PREPARING), MissionOutputs(
            ZERO_TWIST, Mode.HOLD, 0, writes=writes, event=f"writes {len(writes)} parameters of the planner"
        )

    def _prepare(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        if not inputs.writes_done:
            return state, self._rest(state)
        return replace(state, stage=Stage.LOCATING), MissionOutputs(
            ZERO_TWIST, self.steps[state.index].mode, state.index, read_orientation=True
        )

    def _locate(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        step = self.steps[state.index]
        if inputs.rotation_RE is None:
            return state, MissionOutputs(ZERO_TWIST, step.mode, state.index)
        moving = replace(state, stage=Stage.MOVING, began_ns=inputs.t_ns, rotation_RE=inputs.rotation_RE)
        return moving, MissionOutputs(
            _twist(step, moving, 0.0),
            step.mode,
            state.index,
            event=f"step {state.index + 1}/{len(self.steps)} {step.name!r} begins",
        )

    def _move(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        step = self.steps[state.index]
        t = (inputs.t_ns - state.began_ns) * 1e-9
        if t < step.duration_s:
            return state, MissionOutputs(_twist(step, state, t), step.mode, state.index)
        if state.index + 1 == len(self.steps):
            done = replace(state, stage=Stage.FINISHED)
            return done, self._rest(done, event="all steps done")
        following = replace(state, stage=Stage.PREPARING, index=state.index + 1)
        return following, MissionOutputs(ZERO_TWIST, step.mode, state.index, writes=self.steps[following.index].writes)


def _failure(state: MissionState, inputs: MissionInputs) -> str | None:
    if inputs.sdo_failure is not None:
        return f"the planner's dictionary cannot be used: {inputs.sdo_failure}"
    if inputs.planner is None:
        return None if state.stage is Stage.WAITING else "the planner has fallen silent"
    if inputs.planner.phase is PlannerPhase.FAULT:
        return "the planner reports a fault"
    return None


def _twist(step: Step, state: MissionState, t: float) -> Vector:
    """The step's twist for the next cycle: in the end-point frame for lines, of the platform for drive and turn."""
    twist = np.zeros(6)
    if step.profile is None:
        return twist
    speed = step.profile.mean_velocity(t, CYCLE_NS * 1e-9)
    if step.kind is StepKind.LINE:
        assert step.direction is not None and state.rotation_RE is not None  # by construction of the step and of MOVING
        twist[:3] = state.rotation_RE.T @ (step.direction * speed)
    elif step.kind is StepKind.DRIVE:
        twist[0] = speed
    elif step.kind is StepKind.TURN:
        twist[5] = speed
    return twist


_STAGES = {
    Stage.WAITING: Mission._wait,
    Stage.PREPARING: Mission._prepare,
    Stage.LOCATING: Mission._locate,
    Stage.MOVING: Mission._move,
}
