"""What every kinematic experiment is to its runner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from logs.traces import Recorded

Progress = Callable[[float], None]
"""Told the simulated time in s that has been done, from time to time; raises KeyboardInterrupt like anything else may."""


class Experiment(Protocol):
    """One experiment, ready to run: scenario read and checked when it was made."""

    @property
    def duration_s(self) -> float:
        """Simulated time to the end, for the progress bar."""
        ...

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Keys of `Recorded.metrics`: expectations are checked against them before the run begins."""
        ...

    def run(self, on_progress: Progress, duration_s: float | None = None) -> Recorded:
        """Runs to the end, or for `duration_s` of simulated time. Deterministic: the same scenario and seed, the same record."""
        ...
