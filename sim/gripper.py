"""A two-finger gripper: closes in its time, then holds what is between its fingers, until it opens or that is torn out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.grasping import GraspPoint, Hold, PadParameters
from sim.physics import Physics
from stack.messages import Gripper, GripperPhase, Vector


@dataclass(frozen=True)
class GripperParameters:
    """A gripper that is told to open or to close."""

    closing_s: float = 0.3
    reach: float = 0.03
    """m from the TCP within which the fingers find what they close around"""
    pads: PadParameters = field(default_factory=PadParameters)

    def __post_init__(self) -> None:
        if not (self.closing_s >= 0.0 and self.reach > 0.0):
            raise ValueError(
                f"gripper: closing_s = {self.closing_s} must not be negative, reach = {self.reach} positive"
            )


class GripperHand:
    """The robot's gripper. `graspable` may grow while it is open."""

    def __init__(self, physics: Physics, parameters: GripperParameters) -> None:
        self.parameters = parameters
        self.graspable: list[GraspPoint] = []
        self.phase = GripperPhase.OPEN
        self.hold: Hold | None = None
        self._physics = physics
        self._left = 0

    def command(self, asked: Gripper) -> None:
        """What the mission asks for; being asked again for what is done already changes nothing."""
        if asked is Gripper.OPEN:
            self.phase, self.hold = GripperPhase.OPEN, None
        elif asked is Gripper.CLOSE and self.phase is GripperPhase.OPEN:
            self.phase = GripperPhase.CLOSING
            self._left = round(self.parameters.closing_s / self._physics.parameters.step_s)

    def act(self) -> None:
        """Before a step: closes further, or holds on."""
        if self.phase is GripperPhase.CLOSING:
            if self._left > 0:
                self._left -= 1
                return
            self.hold = self._grasp()
            self.phase = GripperPhase.EMPTY if self.hold is None else GripperPhase.HOLDING
        if self.hold is not None and not self.hold.act():
            self.phase, self.hold = GripperPhase.EMPTY, None

    def force_on(self, point: GraspPoint) -> Vector:
        """Force (3,) N, world axes, that the hand exerts on `point` over this step; zero when it does not hold it."""
        if self.hold is None or self.hold.point is not point:
            return np.zeros(3)
        return self.hold.force

    def _grasp(self) -> Hold | None:
        """Around the nearest thing within reach."""
        physics = self._physics
        tcp = np.array(physics.hand()[4])
        best: tuple[float, GraspPoint, Vector] | None = None
        for point in self.graspable:
            place, distance = point.nearest(physics.client, tcp)
            if distance <= self.parameters.reach and (best is None or distance < best[0]):
                best = distance, point, place
        return None if best is None else Hold(physics, best[1], best[2], self.parameters.pads)
