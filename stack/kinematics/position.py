"""Inverse kinematics of the eight-joint arm with two redundancy parameters: lift and virtual elbow angle (2.1–2.18).

The elbow C lies on a circle about the line from A (tower ∩ shoulder) to D (wrist centre). φ is C's angle on it, zero
where the elbow is lowest, positive towards the left of the direction in which D lies. The offset AB limits the
shoulder and thereby |φ|.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from stack.kinematics.arm import ArmModel
from stack.kinematics.arrays import Array, finite

_TURN = 2.0 * math.pi
_NOTHING = 1e-12  # a sine, or a length in m, that counts as zero


@dataclass(frozen=True, slots=True)
class ElbowCircle:
    """Where the elbow can be, relative to A: `centre` (3,), `radius`, directions `down` and `lateral` (3,) of φ = 0, π/2.

    `low`, `high`: the limits that the shoulder sets to |φ|, rad, 0 ≤ low ≤ high ≤ π.
    """

    centre: Array
    radius: float
    down: Array
    lateral: Array
    low: float
    high: float

    def clipped(self, phi: float) -> float:
        """φ in [−π, π], its magnitude moved to the nearest that the shoulder allows; φ = 0 counts as positive."""
        phi = math.remainder(phi, _TURN)
        return math.copysign(min(max(abs(phi), self.low), self.high), phi)

    def elbow(self, phi: float) -> Array:
        """C relative to A (3,)."""
        return self.centre + self.radius * (math.cos(phi) * self.down + math.sin(phi) * self.lateral)


def solve_position(arm: ArmModel, T: ArrayLike, lift: float, phi: float) -> list[Array]:
    """All joint vectors (8,) that put the TCP to the pose `T` (4, 4) with this lift and elbow angle: up to eight.

    φ is clipped to what the shoulder allows (`elbow_circle(...).clipped`). The list is empty if the pose is out of
    reach. Joint limits are not looked at (see `within_limits`); angles lie in [−π, π]. In order: left-handed shoulder
    (sin SH ≤ 0) first, then right-handed; each with EL ≥ 0, EL < 0; each with WT ≥ 0, WT < 0. Branches that coincide
    come once. Where two axes coincide (sin EL = 0, sin WT = 0) the earlier joint of the pair is set to zero.
    """
    target = finite("T", T, (4, 4))
    circle = elbow_circle(arm, target, lift)
    if circle is None:
        return []
    lengths = _lengths(arm)
    elbow = circle.elbow(circle.clipped(phi))
    wrist = _wrist_centre(lengths, target) - (0.0, 0.0, lift)
    solutions: list[Array] = []
    cosine = min(max(elbow[2] / lengths.d4, -1.0), 1.0)
    for shoulder in (-math.acos(cosine), math.acos(cosine)):
        bearing = math.atan2(lengths.d3, lengths.d4 * math.sin(shoulder))
        tower = math.remainder(math.atan2(elbow[1], elbow[0]) - bearing, _TURN)
        turned = _rz(tower) @ _ry(shoulder)
        for upper_arm, bend in _pan_tilt(turned.T @ (wrist - elbow) / lengths.d6):
            forearm = turned @ _rz(upper_arm) @ _ry(bend)
            for lower_arm, tilt in _pan_tilt(forearm.T @ target[:3, 2]):
                rest = (forearm @ _rz(lower_arm) @ _ry(tilt)).T @ target[:3, :3]
                pan = math.atan2(rest[1, 0], rest[0, 0])
                q = np.array([tower, lift, shoulder, upper_arm, bend, lower_arm, tilt, pan])
                if not any(_distance(q, other) < 1e-9 for other in solutions):
                    solutions.append(q)
    return solutions


def elbow_circle(arm: ArmModel, T: ArrayLike, lift: float) -> ElbowCircle | None:
    """The elbow's circle for a TCP pose and a lift (2.3–2.9), None if the pose is out of reach.

    So is D on the tower axis, where no direction of the circle would be the lowest.
    """
    if not math.isfinite(lift):
        raise ValueError(f"lift is {lift}, expected a finite length in m")
    lengths = _lengths(arm)
    wrist = _wrist_centre(lengths, finite("T", T, (4, 4))) - (0.0, 0.0, lift)
    l1, l2, d = math.hypot(lengths.d3, lengths.d4), abs(lengths.d6), math.sqrt(float(wrist.dot(wrist)))
    if not abs(l1 - l2) < d < l1 + l2:
        return None
    r, h = math.hypot(wrist[0], wrist[1]), float(wrist[2])
    if r < _NOTHING:
        return None
    out, up = np.array([wrist[0] / r, wrist[1] / r, 0.0]), np.array([0.0, 0.0, 1.0])
    p = (l1**2 + d**2 - l2**2) / (2.0 * d)
    rho = math.sqrt(max(l1**2 - p**2, 0.0))
    # C_z = (p h − ρ r cosφ)/d has to stay within ±|d4|, the shoulder's reach in height.
    reach, drop = abs(lengths.d4) * d, rho * r
    if p * h - drop > reach or p * h + drop < -reach:
        return None
    low, high = 0.0, math.pi
    if drop > _NOTHING:
        low = math.acos(min(max((p * h + reach) / drop, -1.0), 1.0))
        high = math.acos(min(max((p * h - reach) / drop, -1.0), 1.0))
    return ElbowCircle(p / d * wrist, rho, (h * out - r * up) / d, np.cross(up, out), low, high)


def elbow_angle(arm: ArmModel, q: ArrayLike) -> float:
    """φ of a configuration (8,): with its pose and its lift, the inverse of `solve_position`.

    ValueError where A, C and D lie on a line (arm stretched out or folded), since φ does not exist there.
    """
    q = finite("q", q, (8,))
    circle = elbow_circle(arm, arm.pose(q), float(q[1]))
    if circle is None or circle.radius < 1e-9:
        raise ValueError("the elbow lies on the line from the shoulder to the wrist: no elbow angle")
    points = arm.points(q)
    offset = points["C"] - points["A"] - circle.centre
    return math.atan2(float(offset @ circle.lateral), float(offset @ circle.down))


def within_limits(arm: ArmModel, solutions: Sequence[ArrayLike], near: ArrayLike | None = None) -> list[Array]:
    """Those of the solutions (n,) that fit into the joint limits after whole turns of single revolute joints.

    Of several turns that fit, the one nearest to `near` (n,) is taken; by default nearest to the middle of the range.
    """
    middle = 0.5 * (arm.q_min + arm.q_max) if near is None else finite("near", near, (arm.n,))
    revolute = np.array([row.revolute for row in arm.description.joints])
    fitting = []
    for solution in solutions:
        q = finite("solution", solution, (arm.n,)).copy()
        q[revolute] += _TURN * np.round((middle - q)[revolute] / _TURN)
        q = np.where(revolute & (q > arm.q_max), q - _TURN, q)
        q = np.where(revolute & (q < arm.q_min), q + _TURN, q)
        if bool(np.all((q >= arm.q_min) & (q <= arm.q_max))):
            fitting.append(q)
    return fitting


def nearest(arm: ArmModel, solutions: Sequence[ArrayLike], previous: ArrayLike) -> Array | None:
    """The solution inside the limits that is soonest reached from `previous` (n,) at full joint speeds; None if none."""
    start = finite("previous", previous, (arm.n,))
    fitting = within_limits(arm, solutions, near=start)
    return min(fitting, key=lambda q: float(np.max(np.abs(q - start) / arm.dq_max)), default=None)


def most_central(arm: ArmModel, solutions: Sequence[ArrayLike]) -> Array | None:
    """The solution inside the limits with the least mean square distance from the middle of the ranges; None if none."""
    middle, half = 0.5 * (arm.q_min + arm.q_max), 0.5 * (arm.q_max - arm.q_min)
    fitting = within_limits(arm, solutions)
    return min(fitting, key=lambda q: float(np.sum(((q - middle) / half) ** 2)), default=None)


def of_handedness(solutions: Sequence[ArrayLike], phi: float) -> list[Array]:
    """The solutions whose handedness goes with φ: left-handed (sin SH ≤ 0) for φ ≥ 0, right-handed below."""
    arrays = [finite("solution", q, (8,)) for q in solutions]
    return [q for q in arrays if (math.sin(q[2]) <= 0.0) == (math.remainder(phi, _TURN) >= 0.0)]


@dataclass(frozen=True, slots=True)
class _Lengths:
    d3: float
    d4: float
    d6: float
    d8: float


def _lengths(arm: ArmModel) -> _Lengths:
    rows = arm.description.joints
    if len(rows) != 8 or rows[1].revolute:
        raise ValueError(f"robot {arm.name} has no tower lift: the position solution is for the eight-joint arm")
    return _Lengths(rows[2].d, rows[3].d, rows[5].d, rows[7].d)


def _wrist_centre(lengths: _Lengths, target: Array) -> Array:
    centre: Array = target[:3, 3] - lengths.d8 * target[:3, 2]
    return centre


def _pan_tilt(direction: Array) -> list[tuple[float, float]]:
    """The two (α, β) with Rz(α) Ry(β) e_z = direction, β ≥ 0 first; α = 0 where β is 0 or π."""
    x, y, z = (float(part) for part in direction)
    sine = math.hypot(x, y)
    pan, tilt = math.atan2(y, x) if sine > _NOTHING else 0.0, math.atan2(sine, z)
    return [(pan, tilt), (math.remainder(pan + math.pi, _TURN), -tilt)]


def _rz(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _ry(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _distance(a: Array, b: Array) -> float:
    """Largest difference of two joint vectors, turns not counted (the lift is the same in both)."""
    return max(abs(math.remainder(x - y, _TURN)) for x, y in zip(a, b, strict=True))
