"""What a door is: how it moves, where it hangs, how big and how stiff it is. No physics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from stack.messages import Matrix

_EDGE = 0.07
"""m of panel beyond the handle"""
_GAP = 0.01
"""m between hinge axis and panel, and under the panel"""


class DoorKind(StrEnum):
    """How a door moves."""

    HINGED = "hinged"
    SLIDING = "sliding"


class HandleGrasp(StrEnum):
    """How a hand holds the bar: `pivot` may turn about it, `rigid` turns with it."""

    PIVOT = "pivot"
    RIGID = "rigid"


@dataclass(frozen=True)
class DoorParameters:
    """A door that is shut at opening 0; openings are rad for a hinged door, m for a sliding one, torques N for a sliding one.

    `heading`: direction in the world, rad: for a hinged door from the handle to the hinge; for a sliding door the way that it opens.
    `side`: +1 or -1. A hinged door opens counter-clockwise seen from above with +1. A sliding door has its handle to the left of its way
    with +1. `across` is the distance of the handle from the hinge's axis, for a sliding door the panel's width.
    """

    kind: DoorKind
    handle: tuple[float, float, float]
    """middle of the bar in the world when the door is shut, m"""
    heading: float
    side: int
    across: float = 0.8
    height: float = 2.0
    thickness: float = 0.04
    mass: float = 15.0
    travel: float = 1.75
    """how far it opens"""
    start: float = 0.0
    """how far it is open at the start"""
    friction: float = 0.5
    damping: float = 0.5
    closer_stiffness: float = 0.0
    """per rad or m"""
    closer_preload: float = 0.0
    """when it is shut"""
    catch: float = 0.0
    """most that a ball catch resists"""
    catch_width: float = 0.02
    """opening at which the catch lets go"""
    standoff: float = 0.07
    """m from panel to bar"""
    bar_length: float = 0.2
    bar_radius: float = 0.012
    grasp: HandleGrasp = HandleGrasp.PIVOT

    def __post_init__(self) -> None:
        for name in ("across", "height", "thickness", "mass", "travel", "catch_width", "bar_length", "bar_radius"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"door: {name} = {getattr(self, name)}: must be positive")
        for name in ("friction", "damping", "closer_stiffness", "closer_preload", "catch", "standoff"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"door: {name} = {getattr(self, name)}: must be 0 or positive")
        if self.side not in (1, -1):
            raise ValueError(f"door: side = {self.side}: must be 1 or -1")
        if not 0.0 <= self.start <= self.travel:
            raise ValueError(f"door: start = {self.start}: must be within 0 to travel = {self.travel}")

    @property
    def hinged(self) -> bool:
        return self.kind is DoorKind.HINGED

    def frame(self) -> Matrix:
        """Pose (4, 4) in the world of the frame that the door moves in: z up; hinged: origin on the axis at the height of the handle,
        x to the handle; sliding: origin at the handle, x the way it opens. y is where the handle goes, or where the hand is."""
        if self.hinged:
            towards = np.array([math.cos(self.heading), math.sin(self.heading)])
            origin = np.array([*(np.array(self.handle[:2]) + self.across * towards), self.handle[2]])
            x = np.array([-towards[0], -towards[1], 0.0])
        else:
            origin = np.array(self.handle)
            x = np.array([math.cos(self.heading), math.sin(self.heading), 0.0])
        pose = np.eye(4)
        pose[:3, 0] = x
        pose[:3, 1] = -x[1], x[0], 0.0
        pose[:3, 3] = origin
        return pose

    def panel(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Size of the panel (x, y, z) and where its middle is in the frame of the door."""
        z = self.height / 2 + _GAP - self.handle[2]
        y = -self.side * (self.standoff + self.thickness / 2)
        if self.hinged:
            width = self.across + _EDGE - _GAP
            return (width, self.thickness, self.height), (_GAP + width / 2, y, z)
        return (self.across, self.thickness, self.height), (self.across / 2 - _EDGE, y, z)

    def bar(self) -> tuple[float, float, float]:
        """Where the middle of the bar is in the frame of the door."""
        return (self.across, 0.0, 0.0) if self.hinged else (0.0, 0.0, 0.0)
