"""Joint positions that the strategic layer sends at its own, slower pace, made into set points of every arm cycle (`Mode.JOINTS`).

References come every `STRATEGIC_PERIOD_NS` with a counter. The set points run through them as a cubic spline (Catmull-Rom), a fixed
`DELAY_NS` late: then there is a reference on either side of every set point, so that nothing is extrapolated and no step of the slower
pace reaches the joints. Jitter on the bus does not enter: time is told by the counter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stack.messages import JointReference, Vector

STRATEGIC_PERIOD_NS = 20_000_000
DELAY_NS = 60_000_000
"""Three references: the newest may be one period old, a cycle's set point lies up to one period (two arm cycles) ahead, and the
spline needs one more beyond the interval that it is in."""
_KEPT = 8
_COUNTER = 256
_SLIP_NS = 30_000_000


@dataclass(frozen=True, slots=True, eq=False)
class JointFollower:
    """The last references: number `first` + i of `positions[i]` (n,), and the time at which number 0 would have come."""

    positions: tuple[Vector, ...] = ()
    first: int = 0
    origin_ns: int = 0
    counter: int = 0

    def hearing(self, reference: JointReference, received_ns: int) -> JointFollower:
        """With a new reference. Ones that were lost are filled in on a straight line; after a pause it begins anew."""
        if not self.positions:
            return self._beginning(reference, received_ns)
        number = self.first + len(self.positions) - 1 + (reference.counter - self.counter) % _COUNTER
        expected_ns = self.origin_ns + number * STRATEGIC_PERIOD_NS
        lost = number - self.first - len(self.positions)
        if abs(received_ns - expected_ns) > _SLIP_NS or lost < 0 or lost > _KEPT:
            return self._beginning(reference, received_ns)
        last = self.positions[-1]
        way = reference.position - last
        filled = tuple(last + way * (i / (lost + 1)) for i in range(1, lost + 1))
        positions = (*self.positions, *filled, reference.position)
        kept = positions[-_KEPT:]
        first = self.first + len(positions) - len(kept)
        return replace(self, positions=kept, first=first, counter=reference.counter)

    def _beginning(self, reference: JointReference, received_ns: int) -> JointFollower:
        return JointFollower((reference.position,), 0, received_ns, reference.counter)

    def at(self, t_ns: int) -> Vector | None:
        """Where the joints shall be at `t_ns` (n,), late by `DELAY_NS`; before the first reference that one, after the last it stays.

        None before anything was heard.
        """
        if not self.positions:
            return None
        place = (t_ns - DELAY_NS - self.origin_ns) / STRATEGIC_PERIOD_NS - self.first
        last = len(self.positions) - 1
        if place <= 0.0 or last == 0:
            return self.positions[0]
        if place >= last:
            return self.positions[last]
        i = int(place)
        u = place - i
        p0, p1, p2, p3 = (self.positions[min(max(i + k, 0), last)] for k in (-1, 0, 1, 2))
        a, b = 0.5 * (p2 - p0), 0.5 * (p3 - p1)
        way = p2 - p1
        value: Vector = p1 + u * (a + u * (3.0 * way - 2.0 * a - b + u * (a + b - 2.0 * way)))
        return value


def velocity_to(target: Vector, q: Vector, bounds: tuple[Vector, Vector], period_s: float) -> tuple[Vector, bool]:
    """Joint velocity (n,) that reaches `target` in one period, within `bounds`, and whether they cut it."""
    lower, upper = bounds
    wanted = (target - q) / period_s
    limited = np.clip(wanted, lower, upper)
    return limited, bool(np.abs(limited - wanted).max() > 1e-6)
