"""Slip that the wheels cannot see: the TCP's own sensor against what odometry and the arm's encoders believe.

`T_RO` carries the odometry frame O into the reference frame R. A measurement is compared with the belief at *its* time, so the
sensor's latency costs nothing but delay; each one moves the estimate by `gain` of the difference.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from stack.kinematics.se3 import exp_so3, log_so3
from stack.messages import Matrix, TrackedPose

_HISTORY = 64


@dataclass(slots=True)
class DriftEstimate:
    """The estimate and the believed TCP poses of the last cycles; owned by the planner's state, one per run.

    `T_RO` (4, 4): identity until the first measurement, which it then takes over whole.
    """

    gain: float
    T_RO: Matrix = field(default_factory=lambda: np.eye(4))
    measured: bool = False
    _beliefs: deque[tuple[int, Matrix]] = field(default_factory=lambda: deque(maxlen=_HISTORY))

    def believe(self, t_ns: int, T_OE: Matrix) -> None:
        """Remember where odometry and encoders put the TCP at `t_ns`."""
        self._beliefs.append((t_ns, T_OE))

    def measure(self, tracked: TrackedPose, t_ns: int) -> bool:
        """Take in a measurement received at `t_ns`, `age_ns` old. False when it is older than what is remembered."""
        belief = self._belief_at(t_ns - tracked.age_ns)
        if belief is None:
            return False
        predicted = self.T_RO @ belief
        weight = self.gain if self.measured else 1.0
        rotation = exp_so3(weight * log_so3(exp_so3(tracked.rotation_vector) @ predicted[:3, :3].T))
        # The correction turns about the TCP: orientation noise then does not throw the position about.
        position = predicted[:3, 3] + weight * (tracked.position - predicted[:3, 3])
        corrected = np.eye(4)
        corrected[:3, :3] = rotation @ self.T_RO[:3, :3]
        corrected[:3, 3] = position - corrected[:3, :3] @ belief[:3, 3]
        self.T_RO = corrected
        self.measured = True
        return True

    def _belief_at(self, t_ns: int) -> Matrix | None:
        """The believed TCP pose at `t_ns`, position linear between cycles (rotation of the nearer one)."""
        earlier: tuple[int, Matrix] | None = None
        for entry in reversed(self._beliefs):
            if entry[0] <= t_ns:
                earlier = entry
                break
            later = entry
        if earlier is None:
            return None
        if earlier[0] == t_ns or earlier is self._beliefs[-1]:
            return earlier[1]
        u = (t_ns - earlier[0]) / (later[0] - earlier[0])
        pose = (earlier if u < 0.5 else later)[1].copy()
        pose[:3, 3] = (1.0 - u) * earlier[1][:3, 3] + u * later[1][:3, 3]
        return pose
