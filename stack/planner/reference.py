"""The commanded twist, made smooth, and what happens when it stops coming."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stack.messages import Vector
from stack.planner.parameters import PlannerParameters


def _zero() -> Vector:
    return np.zeros(6)


@dataclass(frozen=True, slots=True, eq=False)
class CommandFilter:
    """`twist` (6,): the command through a first-order low pass, so that 50 Hz steps do not reach the joints; `slow` (6,): a much slower one
    for the platform's feed-forward (4.1.3). Both keep the integral of the command, hence the length of the path."""

    twist: Vector = field(default_factory=_zero)
    slow: Vector = field(default_factory=_zero)

    def update(self, command: Vector | None, parameters: PlannerParameters) -> CommandFilter:
        """One arm cycle on. A missing command counts as zero: the robot comes to rest within a few time constants."""
        target = _zero() if command is None else command
        period = parameters.arm_period_s
        quick = period / (parameters.twist_smoothing_s + period)
        dull = period / (parameters.speed_smoothing_s + period)
        return CommandFilter(self.twist + quick * (target - self.twist), self.slow + dull * (target - self.slow))
