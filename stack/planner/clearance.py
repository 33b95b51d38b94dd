"""Keeping links clear of each other and of obstacles: a velocity damper on each distance (Faverjon, Tournassoud 1987).

    ḋ ≥ −ξ (d − d_s)/(d_i − d_s)    for d < d_i

An approach is slowed the nearer two things are and stops at the safety distance d_s; what is nearer already moves apart. The rows are hard:
where redundancy does not suffice the task gives way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stack.kinematics.arm import ArmState
from stack.kinematics.proximity import DOOR, BodyDistances, Box, Proximity
from stack.kinematics.se3 import pose_inverse
from stack.messages import Matrix, Vector
from stack.planner.avoidance import Zones
from stack.planner.leaf import LeafHere


@dataclass(frozen=True, slots=True)
class Clearance:
    """`influence` d_i and `safety` d_s (m); `approach` ξ (m/s), the speed of approach that is allowed at d_i.

    `braking` (m/s²): deceleration of a link that is counted on when all joints brake at once (`must_brake`).

    The damper brakes with ξ²/(d_i − d_s) at most, 0.37 m/s² with these: less than the platform's 0.5, which reacts late besides.
    """

    influence: float = 0.2
    safety: float = 0.03
    approach: float = 0.25
    braking: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.safety < self.influence < np.inf:
            raise ValueError(f"clearance: safety {self.safety} must be at least 0 and below influence {self.influence}")
        if not 0.0 < self.approach < np.inf:
            raise ValueError(f"clearance: approach {self.approach} must be positive and finite")


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Where the arm stands and how that moves: `T_RA` (4, 4), its base in the reference frame, and the platform's rate (v, ω).

    `door`: the leaf that may go along with the hand.
    """

    T_RA: Matrix
    rate: Vector
    door: LeafHere | None = None


def nearest_pairs(
    bodies: BodyDistances, model: ArmState, clearance: Clearance, boxes: Sequence[Box], standing: Standing | None
) -> list[Proximity]:
    """Every pair within `influence`, nearest first; `boxes` and door only where the `standing` is known."""
    if standing is None:
        found = bodies.near(model.q, clearance.influence)
    else:
        door, T_AR = standing.door, pose_inverse(standing.T_RA)
        found = bodies.near(model.q, clearance.influence, boxes, T_AR, None if door is None else door.box)
        if door is not None and door.leaf.held:
            found = [_with_the_hand(pair, model, standing, door, bodies.base) for pair in found]
    return sorted(found, key=lambda pair: pair.distance)


def _with_the_hand(pair: Proximity, model: ArmState, standing: Standing, door: LeafHere, base: Vector) -> Proximity:
    """A pair with the leaf, whose point goes where the hand takes it: ḋ gets n · L v_H, v_H = J q̇ + j_v v + j_ω ω."""
    if not pair.name.endswith(f" - {DOOR}"):
        return pair
    R, p = standing.T_RA[:3, :3], standing.T_RA[:3, 3]
    L = door.leaf.carried(R @ pair.point + p, door.hand)
    w = R.T @ (L.T @ (R @ pair.normal))
    x, y, _ = model.position + base
    platform = pair.platform + np.array([w[0], x * w[1] - y * w[0]])
    return replace(pair, gradient=pair.gradient + w @ model.jacobian[:3], platform=platform)


def dampers(near: Sequence[Proximity], n: int, clearance: Clearance) -> Zones:
    """A row for every pair, for an arm of `n` joints."""
    return Zones(
        tuple(pair.name for pair in near),
        np.array([pair.gradient for pair in near]).reshape(len(near), n),
        np.zeros(len(near)),
        np.array([_slowest(pair, clearance) for pair in near]),
        np.array([pair.platform for pair in near]).reshape(len(near), 2),
    )


def must_brake(near: Sequence[Proximity], dq: Vector, rate: Vector, clearance: Clearance, delay_s: float) -> bool:
    """Whether the joint velocity `dq` (n,) on a platform that moves at `rate` (2,) leaves too little way to stop in, for any pair.

    The last resort: where restrictions contradict each other the dampers give way, this does not. `delay_s`: until braking begins.
    """
    for pair in near:
        closing = -float(pair.gradient @ dq + pair.platform @ rate)
        if closing > 0.0 and pair.distance < _LEAST + closing * delay_s + closing * closing / (2.0 * clearance.braking):
            return True
    return False


_LEAST = 0.005
"""m, at rest"""


def _slowest(pair: Proximity, clearance: Clearance) -> float:
    """Least ḋ (m/s); at most `approach` either way."""
    share = (pair.distance - clearance.safety) / (clearance.influence - clearance.safety)
    return -clearance.approach * max(min(share, 1.0), -1.0)
