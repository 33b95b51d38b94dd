"""What a drive would have said: its position over a few lost answers, from the last one and from where it was told to go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stack.messages import Vector

BRIDGED_CYCLES = 5
"""SYNCs without an answer that are bridged; after that nobody knows where the axis is."""


class Bridge:
    """Positions of n axes. An axis keeps its tracking error while it is not heard: it goes on as its set point does."""

    def __init__(self, count: int) -> None:
        self._last = np.zeros(count)
        self._missed = np.full(count, BRIDGED_CYCLES + 1)
        self.bridged = 0
        """Answers that were made up so far."""

    def update(self, heard: Sequence[float | None], moved: Vector) -> Vector | None:
        """Positions (n,) at this SYNC; None when an axis was not heard for too long (or never).

        `heard`: what each axis said at this SYNC; `moved` (n,): the way of its set point since the SYNC before.
        """
        for axis, position in enumerate(heard):
            if position is not None:
                self._last[axis] = position
                self._missed[axis] = 0
            elif self._missed[axis] <= BRIDGED_CYCLES:
                self._missed[axis] += 1
                self._last[axis] += moved[axis]
                self.bridged += 1
        if self._missed.max() > BRIDGED_CYCLES:
            return None
        return self._last.copy()
