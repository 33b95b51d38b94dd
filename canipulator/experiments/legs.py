"""A path of the TCP made of legs, each from rest to rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from config.kinematic import LegTable
from stack.kinematics.se3 import rotation_exp
from stack.messages import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class _Leg:
    duration_s: float
    translation: Vector
    turn: Vector


class LegPath:
    """Pose of the TCP over time: from `start` (4, 4) leg by leg, each with the quintic that begins and ends without acceleration."""

    def __init__(self, start: Matrix, legs: Sequence[LegTable], settle_s: float = 0.0) -> None:
        self._start = start
        self._legs = [_Leg(leg.duration_s, np.array(leg.translation_m), np.array(leg.rotation_rad)) for leg in legs]
        self.moving_s = sum(leg.duration_s for leg in legs)
        self.duration_s = self.moving_s + settle_s

    def pose(self, t_s: float) -> Matrix:
        """(4, 4) at path time t_s; at rest before the beginning and after the last leg."""
        pose = self._start.copy()
        for leg in self._legs:
            if t_s <= 0.0:
                break
            share = smooth_step(t_s / leg.duration_s)
            pose[:3, 3] += share * leg.translation
            pose[:3, :3] = rotation_exp(share * leg.turn) @ pose[:3, :3]
            t_s -= leg.duration_s
        return pose


def smooth_step(x: float) -> float:
    """Quintic from 0 to 1 with no velocity and no acceleration at both ends."""
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))
