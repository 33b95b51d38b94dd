"""A door's leaf as an obstacle that goes where the hand takes its handle.

The leaf is a box that slides along its own length, or turns about a vertical hinge. While the hand holds the handle, the way that the
handle has made says how far the door is open, and the hand's velocity v_H how fast each point of the leaf moves:

    slides:  v = d (d · v_H)            turns:  v = ẑ × (p − h) · (ẑ × (p_H − h)) · v_H / |p_H − h|²
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from stack.kinematics.proximity import Box
from stack.messages import Matrix, Vector


class LeafMotion(IntEnum):
    """What the leaf does, as on the wire."""

    ABSENT = 0
    STANDS = 1
    SLIDES = 2
    TURNS = 3


@dataclass(frozen=True, slots=True)
class DoorLeaf:
    """`shut`: the leaf when the door is shut; `handle` and `hinge` (x, y, m) where they are then; all in the reference frame."""

    shut: Box
    handle: tuple[float, float]
    hinge: tuple[float, float]
    motion: LeafMotion

    @property
    def held(self) -> bool:
        """Whether it goes along with the hand."""
        return self.motion in (LeafMotion.SLIDES, LeafMotion.TURNS)

    def opening(self, hand: Vector) -> float:
        """How far the door is open, rad or m, with the handle where the hand is, `hand` (3,) or (2,)."""
        if self.motion is LeafMotion.SLIDES:
            return float((hand[:2] - np.array(self.handle)) @ self._way())
        here, before = hand[:2] - np.array(self.hinge), np.subtract(self.handle, self.hinge)
        return math.atan2(float(before[0] * here[1] - before[1] * here[0]), float(before @ here))

    def at(self, opening: float, motion: LeafMotion) -> Box:
        """The leaf with the door open so far; `motion`: how it came there."""
        box = self.shut
        if motion is LeafMotion.SLIDES:
            way = opening * self._way()
            return box._replace(x=box.x + float(way[0]), y=box.y + float(way[1]))
        if motion is LeafMotion.TURNS:
            cosine, sine = math.cos(opening), math.sin(opening)
            x, y = box.x - self.hinge[0], box.y - self.hinge[1]
            return box._replace(
                x=self.hinge[0] + cosine * x - sine * y, y=self.hinge[1] + sine * x + cosine * y, yaw=box.yaw + opening
            )
        return box

    def carried(self, point: Vector, hand: Vector) -> Matrix:
        """(3, 3) that makes the velocity of the leaf's point at `point` (3,) from that of the hand at `hand` (3,)."""
        L = np.zeros((3, 3))
        if self.motion is LeafMotion.SLIDES:
            way = self._way()
            L[:2, :2] = np.outer(way, way)
        elif self.motion is LeafMotion.TURNS:
            lever, radius = point[:2] - np.array(self.hinge), hand[:2] - np.array(self.hinge)
            L[:2, :2] = np.outer(_across(lever), _across(radius)) / max(float(radius @ radius), _LEAST_RADIUS**2)
        return L

    def _way(self) -> Vector:
        return np.array([math.cos(self.shut.yaw), math.sin(self.shut.yaw)])


@dataclass(frozen=True, slots=True)
class LeafState:
    """How far the door is open, and by which motion it came there; what a leaf that stands keeps."""

    opening: float = 0.0
    motion: LeafMotion = LeafMotion.STANDS

    def seen_from(self, leaf: DoorLeaf | None, hand: Vector) -> tuple[LeafState, LeafHere | None]:
        """With the hand at `hand` (3,): the state after this cycle, and where the leaf is, None where there is none."""
        if leaf is None or leaf.motion is LeafMotion.ABSENT:
            return LeafState(), None
        state = LeafState(leaf.opening(hand), leaf.motion) if leaf.held else self
        return state, LeafHere(leaf, leaf.at(state.opening, state.motion), hand)


@dataclass(frozen=True, slots=True, eq=False)
class LeafHere:
    """A leaf where it is now: its box, and the hand (3,) that may carry it, in the reference frame."""

    leaf: DoorLeaf
    box: Box
    hand: Vector


def _across(v: Vector) -> Vector:
    """ẑ × v."""
    return np.array([-v[1], v[0]])


_LEAST_RADIUS = 0.05
"""m: nobody holds a door nearer to its hinge; keeps the law finite with a hinge that was told wrong."""
