"""The strategic layer: a task as a sequence of steps, turned into twists, modes and parameter writes.

Pure: `step(state, inputs)` gives the next state and what to send. It knows the planner only by its messages: the state frame,
and the objects of its dictionary that it reads and writes by SDO.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from stack.messages import Gripper, Matrix, Mode, PlannerPhase, PlannerState, Vector
from stack.strategic.motion import ZERO_TWIST, Motion, MotionInputs, ParameterWrite


@dataclass(frozen=True, slots=True)
class Step:
    """One step: what it does, in which mode, and what is written into the planner's dictionary before it.

    `reads_joints`: the arm's joints are read, too, before it begins.
    """

    name: str
    mode: Mode
    motion: Motion
    writes: tuple[ParameterWrite, ...] = ()
    reads_joints: bool = False


class Stage(Enum):
    """Where the mission is."""

    WAITING = "waiting for the planner"
    PREPARING = "writing parameters"
    LOCATING = "reading where the arm is"
    MOVING = "moving"
    FINISHED = "finished"
    FAILED = "failed"
    RECOVERING = "acknowledging a fault"


@dataclass(frozen=True, slots=True)
class MissionState:
    """Stage, index of the current step, when its motion began, with which orientation of the TCP, and the motion's own state.

    `recoveries`: faults of the planner that were acknowledged so far; `fault_ns`: when the last one was heard.
    """

    stage: Stage = Stage.WAITING
    index: int = 0
    began_ns: int = 0
    rotation_RE: Matrix | None = None
    motion: Any = None
    recoveries: int = 0
    fault_ns: int = 0


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a mission does about a fault of the planner: it asks for OFF, for HOLD after `pause_ns`, which acknowledges the fault, and
    begins the step again where the robot is; `most` times. Not done within `patience_ns`: failed."""

    pause_ns: int
    most: int
    patience_ns: int = 20_000_000_000


@dataclass(frozen=True, slots=True)
class MissionInputs:
    """What the strategic node has heard: `planner` is None when stale or never received.

    `writes_done`: every requested write was confirmed. `rotation_RE` (3, 3) and `q` (n,): orientation of the TCP and the
    arm's joints as read since they were asked for, or None. The rest: see `stack.strategic.motion.MotionInputs`.
    """

    t_ns: int
    planner: PlannerState | None
    writes_done: bool = False
    rotation_RE: Matrix | None = None
    sdo_failure: str | None = None
    q: Vector | None = None
    X_RE: Matrix | None = None
    wrench: Vector | None = None
    grasped: bool | None = None
    singularity_margin: float | None = None


@dataclass(frozen=True, slots=True)
class MissionOutputs:
    """What to send: a twist (6,), mode and gripper every cycle, joint positions (n,) where a motion has them; writes, and the wish
    to read the TCP's orientation and the joints, once."""

    twist: Vector
    mode: Mode
    step: int
    writes: tuple[ParameterWrite, ...] = ()
    read_orientation: bool = False
    read_joints: bool = False
    event: str | None = None
    joints: Vector | None = None
    gripper: Gripper = Gripper.KEEP
    found: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Mission:
    """A task: what to write first, then its steps in order."""

    steps: tuple[Step, ...]
    initial_writes: tuple[ParameterWrite, ...] = ()
    recovery: Recovery | None = None

    def step(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        """One strategic cycle. Never raises: a failing planner or SDO ends in Stage.FAILED with an event that says why."""
        if state.stage in (Stage.FINISHED, Stage.FAILED):
            return state, self._rest(state)
        if state.stage is Stage.RECOVERING:
            return self._recover(state, inputs)
        failure = _failure(state, inputs)
        if failure is FAULT and self.recovery is not None and state.recoveries < self.recovery.most:
            recovering = replace(
                state, stage=Stage.RECOVERING, recoveries=state.recoveries + 1, fault_ns=inputs.t_ns, motion=None
            )
            return recovering, self._rest(recovering, event=f"{FAULT}: stops, and will acknowledge it")
        if failure is not None:
            failed = replace(state, stage=Stage.FAILED)
            return failed, self._rest(failed, event=failure)
        return _STAGES[state.stage](self, state, inputs)

    def _rest(self, state: MissionState, event: str | None = None) -> MissionOutputs:
        """At the end, whichever it is: the planner stops and switches the drives off."""
        return MissionOutputs(ZERO_TWIST, Mode.OFF, state.index, event=event)

    def _recover(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        """OFF, then HOLD: the planner resets its drives' faults and enables them where they are."""
        assert self.recovery is not None
        elapsed_ns = inputs.t_ns - state.fault_ns
        if inputs.planner is not None and elapsed_ns < self.recovery.pause_ns:
            return state, self._rest(state)
        if inputs.planner is None or elapsed_ns > self.recovery.patience_ns:
            failed = replace(state, stage=Stage.FAILED)
            return failed, self._rest(failed, event="the fault could not be acknowledged")
        if inputs.planner.phase not in (PlannerPhase.IDLE, PlannerPhase.EXECUTING):
            return state, MissionOutputs(ZERO_TWIST, Mode.HOLD, state.index)
        step = self.steps[state.index]
        return replace(state, stage=Stage.PREPARING), MissionOutputs(
            ZERO_TWIST, Mode.HOLD, state.index, writes=step.writes, event=f"recovered: {step.name!r} begins again"
        )

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
            return state, MissionOutputs(ZERO_TWIST, self._between(state.index), state.index)
        step = self.steps[state.index]
        return replace(state, stage=Stage.LOCATING), MissionOutputs(
            ZERO_TWIST, _standing(step.mode), state.index, read_orientation=True, read_joints=step.reads_joints
        )

    def _locate(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        step = self.steps[state.index]
        if inputs.rotation_RE is None or (step.reads_joints and inputs.q is None):
            return state, MissionOutputs(ZERO_TWIST, _standing(step.mode), state.index)
        moving = replace(state, stage=Stage.MOVING, began_ns=inputs.t_ns, rotation_RE=inputs.rotation_RE)
        moving = replace(moving, motion=step.motion.begin(_motion_inputs(moving, inputs)))
        following, outputs = self._move(moving, inputs)
        begins = f"step {state.index + 1}/{len(self.steps)} {step.name!r} begins"
        return following, replace(outputs, event=begins if outputs.event is None else f"{begins}; {outputs.event}")

    def _move(self, state: MissionState, inputs: MissionInputs) -> tuple[MissionState, MissionOutputs]:
        step = self.steps[state.index]
        motion, outputs = step.motion.step(state.motion, _motion_inputs(state, inputs))
        if outputs.failure is not None:
            failed = replace(state, stage=Stage.FAILED)
            return failed, self._rest(failed, event=f"step {step.name!r}: {outputs.failure}")
        if not outputs.done:
            return replace(state, motion=motion), MissionOutputs(
                outputs.twist,
                step.mode,
                state.index,
                event=outputs.event,
                joints=outputs.joints,
                gripper=outputs.gripper,
                writes=outputs.writes,
            )
        if state.index + 1 == len(self.steps):
            done = replace(state, stage=Stage.FINISHED)
            said = "all steps done" if outputs.event is None else f"{outputs.event}; all steps done"
            return done, replace(self._rest(done, event=said), found=outputs.found)
        following = replace(state, stage=Stage.PREPARING, index=state.index + 1)
        return following, MissionOutputs(
            ZERO_TWIST,
            self._between(following.index),
            state.index,
            writes=self.steps[following.index].writes,
            event=outputs.event,
            found=outputs.found,
        )

    def _between(self, index: int) -> Mode:
        """The mode while the parameters of step `index` are written: one that goes on goes on (a platform need not stop between
        two steps), a new one begins with its parameters in force."""
        before, after = self.steps[max(index - 1, 0)].mode, self.steps[index].mode
        return _standing(after) if index > 0 and before is after else Mode.HOLD


def _standing(mode: Mode) -> Mode:
    """The mode in which a step waits for its beginning: its own, unless that needs more than a twist of zero to stand still."""
    return Mode.HOLD if mode is Mode.JOINTS else mode


def _motion_inputs(state: MissionState, inputs: MissionInputs) -> MotionInputs:
    assert (
        inputs.planner is not None and state.rotation_RE is not None
    )  # a silent planner ends the mission; set by LOCATING
    return MotionInputs(
        (inputs.t_ns - state.began_ns) * 1e-9,
        inputs.planner,
        state.rotation_RE,
        inputs.X_RE,
        inputs.wrench,
        inputs.grasped,
        inputs.q,
        inputs.singularity_margin,
    )


FAULT = "the planner reports a fault"


def _failure(state: MissionState, inputs: MissionInputs) -> str | None:
    if inputs.sdo_failure is not None:
        return f"the planner's dictionary cannot be used: {inputs.sdo_failure}"
    if inputs.planner is None:
        return None if state.stage is Stage.WAITING else "the planner has fallen silent"
    if inputs.planner.phase is PlannerPhase.FAULT:
        return FAULT
    return None


_STAGES = {
    Stage.WAITING: Mission._wait,
    Stage.PREPARING: Mission._prepare,
    Stage.LOCATING: Mission._locate,
    Stage.MOVING: Mission._move,
}
