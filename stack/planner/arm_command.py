"""What one arm cycle commands, within the bounds of each joint, and the words for what shaped it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Restriction, Vector
from stack.planner.problem import Status

_BITS_OF_STATUS = {
    int(Status.SINGULAR): int(Restriction.SINGULARITY),
    int(Status.DEGRADED): int(Restriction.DEGRADED),
}


@dataclass(frozen=True, slots=True, eq=False)
class ArmCommand:
    """Joint velocities (n,) of one arm cycle, the share of the path that they follow, and what shaped them."""

    dq: Vector
    scale: float
    status: Status
    restrictions: Restriction
    sigma: Vector

    @classmethod
    def holding(cls, n: int) -> ArmCommand:
        """The arm keeps still."""
        return cls(np.zeros(n), 1.0, Status.OK, Restriction.NONE, np.zeros(6))


def clipped(command: ArmCommand, lower: Vector, upper: Vector) -> ArmCommand:
    """Accelerations are limited joint by joint and last: the path loop works off what that costs, while slowing the path for it
    would also slow what compensates the platform."""
    dq, worst = within_bounds(command.dq, lower, upper)
    if worst <= 1e-6:
        return command
    return replace(command, dq=dq, restrictions=command.restrictions | Restriction.ACCELERATION)


@compiled
def within_bounds(dq: Vector, lower: Vector, upper: Vector) -> tuple[Vector, float]:
    """dq (n,) clipped joint by joint, and the most that this changed of any of them."""
    clipped = np.empty(dq.shape[0])
    worst = 0.0
    for i in range(dq.shape[0]):
        clipped[i] = min(max(dq[i], lower[i]), upper[i])
        worst = max(worst, abs(clipped[i] - dq[i]))
    return clipped, worst


def restrictions_of(limited: NDArray[np.bool_], status: int, scale: float = 1.0) -> Restriction:
    """Joints that the rule base limits, what became of the task, and whether the path was slowed down."""
    bits = _BITS_OF_STATUS.get(status, 0) | (int(Restriction.VELOCITY) if scale < 1.0 else 0)
    for i, is_limited in enumerate(limited.tolist()):
        bits |= is_limited << i
    return Restriction(bits)


def restrictions_around(around: tuple[str, ...]) -> Restriction:
    """Manifolds have names of one word, pairs of things that are near each other of several."""
    bits = Restriction.NONE
    for name in around:
        bits |= Restriction.COLLISION if " - " in name else Restriction.SINGULARITY
    return bits
