"""Slip observer: what the wheels cannot see, estimated from the TCP's own sensor and fed forward.

An extended Kalman filter with eight error states, in this order and in the axes of the reference frame R:

    δp (3,)  of the platform's reference point      δφ (3,)  rotation of `T_RO`, left      δs (2,)  slip ratio, left and right wheel

`T_RO` carries the odometry frame O into R. A wheel that turns too far by its slip s gets (1 − s) of its arc, so a step of odometry moves
`T_RO`; s is an Ornstein-Uhlenbeck process (`sigma`, `tau`), which also is what remains of it while nothing is measured. What turns or
shifts the frame otherwise (a floor that is not even, a gear's backlash) is a slow random walk. Measurements are taken one component at a
time: no matrix is inverted, the result does not depend on a LAPACK, and the squares add up to the squared Mahalanobis distance by which a
measurement is judged. Covariances are updated in Joseph's form (Bucy & Joseph 1968) and stay symmetric.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise

import numpy as np

from stack.messages import Matrix, Vector
from stack.planner.observer_kernels import (
    STATES,
    along_arc,
    arc_between,
    first_covariance,
    lost_of,
    propagate,
    rotation_matrix,
    take_in,
)
from stack.planner.odometry import PlatformPose

_LEAST_POSITION_NOISE, _LEAST_ROTATION_NOISE = 2e-5, 5e-5
"""m, rad: of a sensor without noise: what the wire rounds off, and what is not in the model."""
_LEAST, _MOST = 0.2, 6.0
"""Bounds of the slip that is learned, as shares of what the model says."""


@dataclass(frozen=True, slots=True)
class SlipModel:
    """What the observer takes for granted: standard deviations of one tracked pose (each coordinate, each component of a small
    rotation), and slip per wheel as a stationary process of standard deviation `sigma` (-), correlated over `tau_s`.

    `sigma` is what to begin with: with `learning_s` > 0 the observer goes over to what it finds, within a few times that.
    """

    position_noise_m: float = 0.0005
    rotation_noise_rad: float = 0.0005
    sigma: float = 0.01
    tau_s: float = 0.5
    learning_s: float = 4.0


class Verdict(IntEnum):
    """What became of a measurement."""

    REJECTED = 0
    TAKEN = 1


def _nothing_known() -> Matrix:
    return np.zeros((STATES, STATES))


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """At one instant: `T_RO` (4, 4), slip ratio of the left and the right wheel (2,), covariance (8, 8) of the error states, and the
    variance of slip in general."""

    T_RO: Matrix = field(default_factory=lambda: np.eye(4))
    slip: Vector = field(default_factory=lambda: np.zeros(2))
    covariance: Matrix = field(default_factory=_nothing_known)
    variance: float = 0.0

    @classmethod
    def placed(cls, T_OE: Matrix, pose: PlatformPose, position: Vector, rotation: Vector, model: SlipModel) -> Estimate:
        """From a first measurement of the TCP, which is taken over whole; the slip is unknown."""
        T_RO = np.eye(4)
        T_RO[:3, :3] = rotation_matrix(rotation) @ T_OE[:3, :3].T
        T_RO[:3, 3] = position - T_RO[:3, :3] @ T_OE[:3, 3]
        covariance = first_covariance(T_RO, T_OE, *pose, *_variances(model), model.sigma)
        return cls(T_RO, np.zeros(2), covariance, model.sigma**2)

    def moved(self, before: PlatformPose, after: PlatformPose, dt: float, track: float, model: SlipModel) -> Estimate:
        """After the `dt` s in which odometry says that the platform went from `before` to `after`, a single arc."""
        T_RO, slip, covariance = propagate(
            self.T_RO, self.slip, self.covariance, *before, *after, dt, track, self.variance, model.tau_s
        )
        return Estimate(T_RO, slip, covariance, self._learned(dt, model))

    def _learned(self, dt: float, model: SlipModel) -> float:
        """The variance, on its way to the second moment of slip that is believed in. That is the step of expectation maximisation
        (Shumway & Stoffer 1982) as it comes, forgetting; it stands still where the slip cannot be seen."""
        if model.learning_s <= 0.0:
            return model.sigma**2
        slip, P = self.slip, self.covariance
        moment = 0.5 * float(slip[0] * slip[0] + slip[1] * slip[1] + P[6, 6] + P[7, 7])
        learned = self.variance - math.expm1(-dt / model.learning_s) * (moment - self.variance)
        return min(max(learned, (_LEAST * model.sigma) ** 2), (_MOST * model.sigma) ** 2)

    def measured(
        self, T_OE: Matrix, pose: PlatformPose, position: Vector, rotation: Vector, model: SlipModel
    ) -> tuple[Estimate, Verdict]:
        """With a pose of the TCP that was seen while odometry and encoders said `T_OE` and the platform was at `pose`.

        One that is far from what was to be expected, and by more than a few millimetres, is rejected and changes nothing.
        """
        T_RO, slip, covariance, taken = take_in(
            self.T_RO, self.slip, self.covariance, T_OE, *pose, position, rotation, *_variances(model)
        )
        return (Estimate(T_RO, slip, covariance, self.variance), Verdict.TAKEN) if taken else (self, Verdict.REJECTED)


def _variances(model: SlipModel) -> tuple[float, float]:
    return (
        model.position_noise_m**2 + _LEAST_POSITION_NOISE**2,
        model.rotation_noise_rad**2 + _LEAST_ROTATION_NOISE**2,
    )


def slipping(poses: list[PlatformPose], slip: Vector, dt: float, track: float, tau_s: float) -> list[PlatformPose]:
    """`poses`, `dt` s apart and as the wheels will have it, as they become with the slip of the first instant dying away."""
    left, right = float(slip[0]), float(slip[1])
    if left == 0.0 and right == 0.0:
        return poses
    decay = math.exp(-dt / tau_s)
    left, right = 0.5 * (1.0 + decay) * left, 0.5 * (1.0 + decay) * right
    found = [poses[0]]
    for before, after in pairwise(poses):
        way, turn = arc_between(before.x, before.y, before.heading, after.x, after.y, after.heading)
        lost, unturned = lost_of(way, turn, track, left, right)
        found.append(PlatformPose(*along_arc(*found[-1], way - lost, turn - unturned)))
        left, right = decay * left, decay * right
    return found
