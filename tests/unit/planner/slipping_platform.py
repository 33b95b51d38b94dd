"""A platform whose wheels slip, seen by its encoders and by a tracker of the TCP; the arm rests."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from stack.kinematics.platform import platform_of
from stack.kinematics.se3 import pose_exp, pose_inverse, rotation_exp, rotation_log
from stack.messages import Matrix, TrackedPose, Vector
from stack.planner.drift import Belief, DriftEstimate, DriftLaw
from stack.planner.observer import SlipModel
from stack.planner.odometry import PlatformPose, advance
from tests.unit.planner.plant import ROBOT

TRACK = platform_of(ROBOT.arm).track
PERIOD_NS = 10_000_000
PERIOD = 0.01
ON_PLATFORM = pose_exp(np.array([0.55, 0.2, 0.8, 0.3, -0.4, 0.5]))
"""The TCP on the platform."""
PLACE = pose_exp(np.array([1.3, -0.7, 0.1, 0.02, -0.01, 0.8]))
"""Where the odometry frame was in R to begin with."""


def planar(pose: PlatformPose) -> Matrix:
    """(4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_exp(np.array([0.0, 0.0, pose.heading]))
    matrix[:2, 3] = pose.x, pose.y
    return matrix


def seen(pose: Matrix, age_ns: int = 0) -> TrackedPose:
    """A measurement of exactly `pose`."""
    return TrackedPose(pose[:3, 3].copy(), rotation_log(pose[:3, :3]), age_ns, 0)


def noisy(pose: Matrix, model: SlipModel, random: np.random.Generator) -> TrackedPose:
    """A measurement with the noise that `model` takes for granted."""
    turned = rotation_exp(model.rotation_noise_rad * random.standard_normal(3)) @ pose[:3, :3]
    return TrackedPose(pose[:3, 3] + model.position_noise_m * random.standard_normal(3), rotation_log(turned), 0, 0)


@dataclass(frozen=True)
class Moment:
    """One cycle: what odometry says, and what is true."""

    belief: Belief
    TCP: Matrix
    slip: Vector

    @property
    def T_RO(self) -> Matrix:
        """The true one."""
        matrix: Matrix = self.TCP @ pose_inverse(self.belief.T_OE)
        return matrix


def driving(
    cycles: int, slip: Callable[[int], Vector], v: float = 0.25, omega: float = 0.2, fine: int = 10
) -> Iterator[Moment]:
    """Constant wheel speeds; `slip` (2,) of a fine step, of which there are `fine` in a cycle."""
    odometry = true = PlatformPose(0.4, -0.2, 0.3)
    step = PERIOD / fine
    begin = PLACE @ pose_inverse(planar(true))
    for k in range(cycles):
        T_OE = planar(odometry) @ ON_PLATFORM
        yield Moment(Belief(k * PERIOD_NS, odometry, T_OE), begin @ planar(true) @ ON_PLATFORM, slip(k * fine).copy())
        for i in range(fine):
            left, right = (1.0 - slip(k * fine + i)) * (
                (v - 0.5 * TRACK * omega) * step,
                (v + 0.5 * TRACK * omega) * step,
            )
            true = advance(true, 0.5 * (left + right), (right - left) / TRACK)
        odometry = advance(odometry, v * PERIOD, omega * PERIOD)


def constant(left: float, right: float) -> Callable[[int], Vector]:
    ratio = np.array([left, right])
    return lambda _: ratio


def wandering(model: SlipModel, random: np.random.Generator, steps: int, dt: float) -> Callable[[int], Vector]:
    """Ornstein-Uhlenbeck, as the model has it, in steps of `dt`."""
    decay = math.exp(-dt / model.tau_s)
    values = [model.sigma * random.standard_normal(2)]
    for _ in range(steps):
        values.append(decay * values[-1] + model.sigma * math.sqrt(1.0 - decay**2) * random.standard_normal(2))
    return lambda i: values[i]


def follow(
    moments: Iterator[Moment],
    model: SlipModel,
    measure: Callable[[int, Moment], TrackedPose | None] = lambda k, moment: seen(moment.TCP),
    drift: DriftEstimate | None = None,
) -> tuple[DriftEstimate, Moment]:
    """Every cycle believed and, where `measure` gives something, measured; the last estimate and the last moment."""
    law, drift = DriftLaw(TRACK, model), drift or DriftEstimate()
    for k, moment in enumerate(moments):
        drift = drift.believing(moment.belief, law)
        tracked = measure(k, moment)
        if tracked is not None:
            drift = drift.measured_by(tracked, moment.belief.t_ns, law)
    return drift, moment


def far_off(tracked: TrackedPose, by: float) -> TrackedPose:
    """The same, `by` m aside."""
    return replace(tracked, position=tracked.position + np.array([by, 0.0, 0.0]))
