"""The choice of lift TL and elbow angle φ for a TCP pose: from a manipulability map, improved by a short search (2.1.4)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stack.kinematics.arm import ArmModel
from stack.kinematics.arrays import Array
from stack.kinematics.manipulability import manipulability
from stack.kinematics.manipulability_map import PoseMap
from stack.kinematics.position import elbow_angle, elbow_circle, solve_position, within_limits
from stack.kinematics.proximity import BodyDistances

_FIRST_STEP = (0.08, 0.4)
_LAST_STEP = 1e-3
_STARTS = 12
_MARGIN = 0.02
"""m: a lift that stands on its limit has no room left."""


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """A configuration `q` (n,) for a pose, its lift TL (m) and elbow angle φ (rad), and the arm's manipulability there."""

    q: Array
    lift: float
    phi: float
    manipulability: float


Value = Callable[[float, float], Posture | None]
"""(lift, φ) to the best posture there."""


def best_posture(
    arm: ArmModel,
    T: Array,
    pose_map: PoseMap | None = None,
    bodies: BodyDistances | None = None,
    clearance: float = 0.03,
) -> Posture | None:
    """The posture inside the joint limits with the largest manipulability that a search over (TL, φ) finds for the pose `T` (4, 4).

    It begins where `pose_map` says; where the map is empty or missing, at the best of a coarse grid. With `bodies`, postures in which links
    come nearer to each other than `clearance` (m) do not count. None where no posture reaches the pose.
    """

    def value(lift: float, phi: float) -> Posture | None:
        return _best_branch(arm, T, lift, phi, bodies, clearance)

    best = _from_map(arm, T, pose_map, value) or _from_grid(arm, value)
    if best is None:
        return None
    steps = np.array(_FIRST_STEP)
    while steps[1] > _LAST_STEP:
        around = [
            value(best.lift + sign * steps[0] * (k == 0), best.phi + sign * steps[1] * (k == 1))
            for k in (0, 1)
            for sign in (1, -1)
        ]
        better = max((p for p in around if p is not None), key=lambda p: p.manipulability, default=None)
        if better is not None and better.manipulability > best.manipulability + 1e-9:
            best = better
        else:
            steps = 0.5 * steps
    return best


def _from_map(arm: ArmModel, T: Array, pose_map: PoseMap | None, value: Value) -> Posture | None:
    posture = None if pose_map is None else pose_map.posture_for(T)
    if posture is None:
        return None
    q = np.concatenate(([0.0, 0.0], posture, [0.0]))
    low, high = float(arm.q_min[1]) + _MARGIN, float(arm.q_max[1]) - _MARGIN
    lift = min(max(float(T[2, 3] - arm.pose(q)[2, 3]), low), high)
    try:
        phi = elbow_angle(arm, q)
    except ValueError:  # stretched: φ does not matter
        phi = 0.0
    return value(lift, phi)


def _from_grid(arm: ArmModel, value: Value) -> Posture | None:
    lifts = np.linspace(arm.q_min[1] + _MARGIN, arm.q_max[1] - _MARGIN, 7)
    angles = np.linspace(-math.pi, math.pi, _STARTS, endpoint=False)
    found = [value(float(lift), float(phi)) for lift in lifts for phi in angles]
    return max((p for p in found if p is not None), key=lambda p: p.manipulability, default=None)


def _best_branch(
    arm: ArmModel, T: Array, lift: float, phi: float, bodies: BodyDistances | None, clearance: float
) -> Posture | None:
    """The most dexterous of the up to eight branches inside the limits and clear of collisions."""
    if not arm.q_min[1] + _MARGIN <= lift <= arm.q_max[1] - _MARGIN:
        return None
    circle = elbow_circle(arm, T, lift)
    if circle is None:
        return None
    fitting = within_limits(arm, solve_position(arm, T, lift, phi))
    if bodies is not None:
        fitting = [q for q in fitting if not bodies.near(q, clearance)]
    valued = [Posture(q, lift, circle.clipped(phi), manipulability(arm.jacobian(q))) for q in fitting]
    return max(valued, key=lambda p: p.manipulability, default=None)
