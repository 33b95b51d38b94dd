"""Motions that run a speed profile from rest to rest: a line of the TCP, a straight drive, a turn on the spot; and waiting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stack.messages import Gripper, Vector
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs
from stack.strategic.profile import RampProfile

_DONE = MotionOutputs(done=True)


@dataclass(frozen=True, slots=True)
class Wait:
    """Nothing for `duration_s`."""

    duration_s: float

    def begin(self, inputs: MotionInputs) -> None:
        return None

    def step(self, state: None, inputs: MotionInputs) -> tuple[None, MotionOutputs]:
        return None, MotionOutputs() if inputs.t_s < self.duration_s else _DONE


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """The TCP along `direction` (3,), a unit vector of the reference frame; its orientation stays."""

    profile: RampProfile
    direction: Vector

    def begin(self, inputs: MotionInputs) -> None:
        return None

    def step(self, state: None, inputs: MotionInputs) -> tuple[None, MotionOutputs]:
        if inputs.t_s >= self.profile.duration_s:
            return None, _DONE
        speed = self.profile.mean_velocity(inputs.t_s, CYCLE_S)
        twist = np.zeros(6)
        twist[:3] = inputs.rotation_RE.T @ (self.direction * speed)
        return None, MotionOutputs(twist)


@dataclass(frozen=True, slots=True)
class Drive:
    """The platform straight ahead (negative length: back)."""

    profile: RampProfile

    def begin(self, inputs: MotionInputs) -> None:
        return None

    def step(self, state: None, inputs: MotionInputs) -> tuple[None, MotionOutputs]:
        return None, _along(self.profile, inputs.t_s, 0)


@dataclass(frozen=True, slots=True)
class Turn:
    """The platform about its own reference point, positive to the left."""

    profile: RampProfile

    def begin(self, inputs: MotionInputs) -> None:
        return None

    def step(self, state: None, inputs: MotionInputs) -> tuple[None, MotionOutputs]:
        return None, _along(self.profile, inputs.t_s, 5)


@dataclass(frozen=True, slots=True)
class Grip:
    """Opens or closes the gripper, and waits until it says that it has.

    Closing fails after `patience_s` without anything in the hand. A gripper that is not heard counts as one that has not.
    """

    asked: Gripper
    patience_s: float = 2.0

    def begin(self, inputs: MotionInputs) -> None:
        return None

    def step(self, state: None, inputs: MotionInputs) -> tuple[None, MotionOutputs]:
        holding = self.asked is Gripper.CLOSE
        if inputs.t_s > 0.0 and inputs.grasped is holding:
            return None, MotionOutputs(done=True, event="gripper holds" if holding else "gripper is open")
        if inputs.t_s < self.patience_s:
            return None, MotionOutputs(gripper=self.asked)
        said = "was not heard" if inputs.grasped is None else "is empty" if holding else "still holds"
        return None, MotionOutputs(
            failure=f"the gripper {said} {self.patience_s:g} s after it was told to {self.asked.name.lower()}"
        )


def _along(profile: RampProfile, t: float, component: int) -> MotionOutputs:
    if t >= profile.duration_s:
        return _DONE
    twist = np.zeros(6)
    twist[component] = profile.mean_velocity(t, CYCLE_S)
    return MotionOutputs(twist)
