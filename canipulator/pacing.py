"""Virtual time held back to real time, so that people and their tools can watch a lockstep run."""

from __future__ import annotations

import time

MAX_LAG_NS = 500_000_000
"""Behind by more than this, a run is given up as too slow for the pace: it goes on from where it is, and does not catch up."""


class Pacer:
    """Waits until virtual times are due. The first wait starts the schedule; deadlines are absolute, so errors do not add up."""

    def __init__(self, factor: float, start_ns: int = 0) -> None:
        """`factor` virtual seconds to a real one; `start_ns` is the virtual time at which the schedule starts."""
        if not 0.0 < factor < float("inf"):
            raise ValueError(f"factor {factor:g}: must be a positive number")
        self.factor = factor
        self.slipped_ns = 0
        """Real time by which the schedule was put off because the run could not keep up."""
        self._start_ns = start_ns
        self._began_ns = time.monotonic_ns()

    def wait(self, t_ns: int) -> None:
        """Returns when virtual time `t_ns` is due, at once when it is overdue."""
        due_ns = self._began_ns + round((t_ns - self._start_ns) / self.factor)
        ahead_ns = due_ns - time.monotonic_ns()
        if ahead_ns > 0:
            time.sleep(ahead_ns * 1e-9)
        elif ahead_ns < -MAX_LAG_NS:
            self._began_ns -= ahead_ns
            self.slipped_ns -= ahead_ns
