"""Keeping away from the known singular manifolds: soft repulsion (2.161–2.164) and hard circumvention (2.178–2.180).

Both work on the margins of `singularities.manifold_margins`: distances in the space of the joints that define a manifold, whose gradient
is the radial direction away from it. Repulsion adds to the preferred velocity z, so it gives way to the task; circumvention puts hard rows
beside the task, so the task gives way where redundancy does not suffice. Pure functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stack.messages import Matrix, Vector
from stack.planner.singularities import Margin

_CORE = 0.02
_ROUNDS = 3
_TOLERANCE = 1e-9
_MEANINGFUL = 1e-6


@dataclass(frozen=True, slots=True)
class Avoidance:
    """Sizes, all in rad of margin. `strength` (rad/s): radial velocity that repulsion wishes for close to a manifold, fading to nothing at
    `reach`. `radius`: the safety sphere that circumvention keeps the arm out of; `zone`: width of the shell around it in which the
    approach is slowed; `recovery_rate` (1/s): how fast an arm that is inside comes out, at most with `strength`."""

    strength: float = 0.4
    reach: float = 0.6
    radius: float = 0.1
    zone: float = 0.3
    recovery_rate: float = 2.0

    def __post_init__(self) -> None:
        for name in ("strength", "reach", "radius", "zone", "recovery_rate"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"avoidance.{name} is {getattr(self, name)}, it must be positive and finite")


def repulsion(margins: Mapping[str, Margin], avoidance: Avoidance) -> Vector:
    """Radial velocity (n,) away from every manifold within reach, their sum; an addition to z.

    With d the margin: strength · (1 − (d/reach)²)² · d/√(d² + core²) along the gradient, C¹ at `reach`. The last factor takes the force
    away on the manifold itself, where no direction leads out; core = 0.02 rad.
    """
    wish = np.zeros(next(iter(margins.values())).gradient.size) if margins else np.zeros(0)
    for margin in margins.values():
        d = margin.distance
        if d < avoidance.reach:
            fade = (1.0 - (d / avoidance.reach) ** 2) ** 2 * d / np.hypot(d, _CORE)
            wish += avoidance.strength * fade * margin.gradient
    return wish


@dataclass(frozen=True, slots=True, eq=False)
class Zones:
    """The manifolds whose shell the arm is in, k of them: `names`; `normals` (k, n): margin gradients; `softness` (k,): s, 1 at the
    outer edge, 0 at the safety sphere; `floor` (k,): least radial velocity, above 0 inside the sphere; `platform` (k, 2): what the
    platform's v and ω add to the radial velocity (None: nothing)."""

    names: tuple[str, ...]
    normals: Matrix
    softness: Vector
    floor: Vector
    platform: Matrix | None = None

    def with_platform_at(self, rate: Vector) -> Zones:
        """For the arm alone, on a platform that moves at `rate` (2,): the arm makes up for what the platform does, where it can."""
        if self.platform is None or not self.names:
            return self
        i = np.flatnonzero(in_hand(self.normals))
        names = tuple(self.names[k] for k in i)
        return Zones(names, self.normals[i], self.softness[i], self.floor[i] - self.platform[i] @ rate)

    def and_also(self, others: Zones) -> Zones:
        """Both, these first."""
        k, m = len(self.names), len(others.names)
        if m == 0 or k == 0:
            return others if k == 0 else self
        platform = [
            np.zeros((size, 2)) if part is None else part for part, size in ((self.platform, k), (others.platform, m))
        ]
        return Zones(
            self.names + others.names,
            np.vstack((self.normals, others.normals)),
            np.concatenate((self.softness, others.softness)),
            np.concatenate((self.floor, others.floor)),
            np.vstack(platform),
        )


def in_hand(gradients: Matrix) -> NDArray[np.bool_]:
    """(k,): which of k distances with `gradients` (k, n) the arm's joints change at all."""
    found: NDArray[np.bool_] = np.einsum("ij,ij->i", gradients, gradients) > _MEANINGFUL
    return found


def zones(margins: Mapping[str, Margin], avoidance: Avoidance) -> Zones:
    """Zones of circumvention: s = 1 − ((edge − d)/zone)² with edge = radius + zone, the rule of the joint limits."""
    names, normals, softness, floor = [], [], [], []
    edge = avoidance.radius + avoidance.zone
    for name, margin in margins.items():
        if margin.distance >= edge or float(margin.gradient @ margin.gradient) < _MEANINGFUL:
            continue  # on the manifold itself there is no direction to forbid
        inside = max(0.0, avoidance.radius - margin.distance)
        names.append(name)
        normals.append(margin.gradient)
        softness.append(max(0.0, 1.0 - ((edge - margin.distance) / avoidance.zone) ** 2) if inside == 0.0 else 0.0)
        floor.append(min(avoidance.recovery_rate * inside, avoidance.strength))
    n = next(iter(margins.values())).gradient.size if margins else 0
    return Zones(tuple(names), np.array(normals).reshape(len(names), n), np.array(softness), np.array(floor))


class Resolved(Protocol):
    """What circumvention needs of an answer."""

    @property
    def dq(self) -> Vector:
        """(n,), joint velocities, or more with the platform's."""


R = TypeVar("R", bound=Resolved)


def circumvent(
    resolve: Callable[[Matrix, Vector], R], zones: Zones, width: int, room: int
) -> tuple[R, tuple[str, ...]]:
    """The answer of `resolve(rows, values)` that approaches no manifold faster than its zone allows, and which of them shaped it.

    An answer without rows that approaches manifold i at the radial velocity u is asked again with the hard row ∇d_i·q̇ = s_i u (2.178 ff.),
    inside the safety sphere with the floor instead. Rows that only then become necessary join, at most `room` of them in all, the
    innermost first: more would leave nothing of the task. `width`: number of unknowns, n or n + 2; rows are filled up with zeros.
    """
    normals = np.zeros((len(zones.names), width))
    n = zones.normals.shape[1]
    normals[:, :n] = zones.normals
    if zones.platform is not None and width > n:
        normals[:, n:] = zones.platform
    answer = resolve(normals[:0], zones.floor[:0])
    allowed = np.full(len(zones.names), -np.inf)
    chosen: list[int] = []
    for _ in range(_ROUNDS if zones.names else 0):
        speed = normals @ answer.dq
        limit = zones.floor + zones.softness * (speed - zones.floor)
        fast = [i for i in np.argsort(zones.softness) if i not in chosen and speed[i] < limit[i] - _TOLERANCE]
        fast = fast[: room - len(chosen)]
        if not fast:
            break
        allowed[fast] = limit[fast]
        chosen = sorted([*chosen, *fast], key=lambda i: float(zones.softness[i]))
        answer = resolve(np.ascontiguousarray(normals[chosen]), allowed[chosen])
    return answer, tuple(zones.names[i] for i in chosen)
