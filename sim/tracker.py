"""A tracked feature: a camera that sees the TCP in the world, at its own rate, late and with noise."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from sim.rotation import rotation_of, rotation_vector_of
from stack.messages import Matrix, TrackedPose

_STREAM = 0x7C


@dataclass(frozen=True)
class TrackerParameters:
    """Defaults of a camera at the ceiling; noise of 0 is exactly none."""

    rate_hz: float = 30.0
    latency_s: float = 0.050
    """from exposure to delivery"""
    noise_m: float = 0.0005
    """standard deviation of each coordinate"""
    noise_rad: float = 0.001
    """standard deviation of each component of a small rotation"""

    def __post_init__(self) -> None:
        if not self.rate_hz > 0.0:
            raise ValueError(f"feedback.rate_hz = {self.rate_hz}: must be positive")
        for name in ("latency_s", "noise_m", "noise_rad"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"feedback.{name} = {getattr(self, name)}: must be 0 or positive")


class Tracker:
    """Whoever owns the clock calls `expose` every `period_ns`, and `deliver` whenever a message may be sent."""

    def __init__(self, parameters: TrackerParameters, seed: int, tick_ns: int = 1_000_000) -> None:
        self.parameters = parameters
        self.period_ns = max(1, round(1e9 / parameters.rate_hz / tick_ns)) * tick_ns
        """Time between exposures, whole ticks: the pose is known at ticks only."""
        self.latency_ns = round(parameters.latency_s * 1e9)
        self._random = np.random.default_rng([seed, _STREAM])
        self._waiting: deque[tuple[int, Matrix]] = deque()
        self._counter = 0

    def expose(self, t_ns: int, pose_WE: Matrix) -> None:
        """Take a picture: `pose_WE` (4, 4) is the true pose at `t_ns`."""
        self._waiting.append((t_ns, pose_WE.copy()))

    def deliver(self, t_ns: int) -> TrackedPose | None:
        """The newest picture that is at least `latency_ns` old, once; None if there is no new one."""
        due = None
        while self._waiting and self._waiting[0][0] + self.latency_ns <= t_ns:
            due = self._waiting.popleft()
        if due is None:
            return None
        exposed_ns, pose = due
        noise = self._random.standard_normal(6)
        turned = rotation_of(self.parameters.noise_rad * noise[3:]) @ pose[:3, :3]
        message = TrackedPose(
            position=pose[:3, 3] + self.parameters.noise_m * noise[:3],
            rotation_vector=rotation_vector_of(turned),
            age_ns=t_ns - exposed_ns,
            counter=self._counter,
        )
        self._counter = (self._counter + 1) % 256
        return message
