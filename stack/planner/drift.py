"""Slip that the wheels cannot see: the TCP's own sensor against what odometry and the arm's encoders believe.

`T_RO` carries the odometry frame O into the reference frame R. A measurement is compared with the belief at *its* time, so the
sensor's latency costs nothing but delay; each one moves the estimate by `gain` of the difference.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from stack.kinematics.se3 import rotation_exp, rotation_log
from stack.messages import Matrix, TrackedPose

_HISTORY = 64


@dataclass(frozen=True, slots=True, eq=False)
class DriftEstimate:
    """`T_RO` (4, 4): identity until the first measurement, which it then takes over whole; `count`: measurements so far;
    `beliefs`: the believed TCP poses T_OE of the last cycles with their times."""

    T_RO: Matrix = field(default_factory=lambda: np.eye(4))
    count: int = 0
    beliefs: tuple[tuple[int, Matrix], ...] = ()

    def believing(self, t_ns: int, T_OE: Matrix) -> DriftEstimate:
        """With the belief of `t_ns` remembered."""
        return DriftEstimate(self.T_RO, self.count, (*self.beliefs[1 - _HISTORY :], (t_ns, T_OE)))

    def measured_by(self, tracked: TrackedPose, t_ns: int, gain: float) -> DriftEstimate:
        """With a measurement taken in that was received at `t_ns`, `age_ns` old. One that is older than memory changes nothing.

        The first ones are averaged, until their number gives each the weight `gain`.
        """
        belief = self._belief_at(t_ns - tracked.age_ns)
        if belief is None:
            return self
        predicted = self.T_RO @ belief
        weight = max(gain, 1.0 / (self.count + 1))
        turn = rotation_exp(weight * rotation_log(rotation_exp(tracked.rotation_vector) @ predicted[:3, :3].T))
        # The correction turns about the TCP: orientation noise then does not throw the position about.
        position = predicted[:3, 3] + weight * (tracked.position - predicted[:3, 3])
        corrected = np.eye(4)
        corrected[:3, :3] = turn @ self.T_RO[:3, :3]
        corrected[:3, 3] = position - corrected[:3, :3] @ belief[:3, 3]
        return replace(self, T_RO=corrected, count=self.count + 1)

    def _belief_at(self, t_ns: int) -> Matrix | None:
        """The believed TCP pose at `t_ns`, position linear between cycles (rotation of the nearer one)."""
        later: tuple[int, Matrix] | None = None
        for entry in reversed(self.beliefs):
            if entry[0] > t_ns:
                later = entry
                continue
            if later is None or entry[0] == t_ns:
                return entry[1]
            u = (t_ns - entry[0]) / (later[0] - entry[0])
            pose = (entry if u < 0.5 else later)[1].copy()
            pose[:3, 3] = (1.0 - u) * entry[1][:3, 3] + u * later[1][:3, 3]
            return pose
        return None
