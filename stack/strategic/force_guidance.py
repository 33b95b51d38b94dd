"""Admittance at the TCP: the measured force moves a virtual mass against a virtual damper, and the TCP goes where the mass goes.

    M v' + D v = f        u = v + T v'

`u` is what is commanded. The lead `T` makes up for the time between a force and the motion that answers it (sensor, bus, strategic
cycle, the planner's smoothing, two SYNC periods: about 65 ms): slow guiding meets the damping D, what is quick meets M/T, which a stiff
hand cannot excite. `1 + Ts` over `Ms + D` is positive real, hence passive, for any T ≥ 0. See docs/force-guidance.md for the loop.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stack.kinematics.se3 import rotation_exp
from stack.messages import Matrix, Vector

GRAVITY = 9.81


def _six(linear: float, angular: float) -> Vector:
    values = np.repeat([linear, angular], 3)
    values.setflags(write=False)
    return values


@dataclass(frozen=True, slots=True)
class Pair:
    """A bound or a band for the linear and for the angular half of a wrench or twist."""

    linear: float
    angular: float


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """What hangs on the sensor and is not the load: mass (kg), centre of mass (3,) m in the end-point frame."""

    mass: float
    centre: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Admittance:
    """Parameters of the law; all six-vectors are [linear; angular] in the axes of the end-point frame.

    `mass` (6,) kg, kg·m²; `damping` (6,) N·s/m, N·m·s/rad, both positive, axis by axis; `lead_s` ≥ 0; `filter_s` time constant of the
    low pass on the wrench, 0 for none. `dead_band` N, N·m: what a wrench loses, smoothly (see `without_band`); `saturation` what it
    counts at most; `speed` m/s, rad/s and `acceleration` bound the motion. `guided` (6,) 1 or 0: axes that follow, and axes that are held.
    `gain` ≥ 0 multiplies the wrench: 0 switches the guidance off. `tool`: weight to be taken off, None if the sensor does so itself.
    """

    mass: Vector = field(default_factory=lambda: _six(25.0, 1.0))
    damping: Vector = field(default_factory=lambda: _six(55.0, 2.0))
    lead_s: float = 0.08
    filter_s: float = 0.0
    dead_band: Pair = Pair(0.5, 0.05)
    saturation: Pair = Pair(60.0, 6.0)
    speed: Pair = Pair(0.5, 1.0)
    acceleration: Pair = Pair(2.5, 6.0)
    guided: Vector = field(default_factory=lambda: _six(1.0, 0.0))
    gain: float = 1.0
    tool: Tool | None = None

    def __post_init__(self) -> None:
        if min(self.mass) <= 0.0 or min(self.damping) <= 0.0:
            raise ValueError(f"mass {self.mass} and damping {self.damping} must be positive on every axis")
        if self.lead_s < 0.0 or self.filter_s < 0.0 or self.gain < 0.0:
            raise ValueError(f"lead_s {self.lead_s}, filter_s {self.filter_s}, gain {self.gain} must not be negative")


@dataclass(frozen=True, slots=True, eq=False)
class AdmittanceState:
    """Velocity of the virtual mass (6,), the filtered wrench (6,), and the twist that was commanded last (6,), end-point axes."""

    velocity: Vector
    wrench: Vector
    sent: Vector

    @classmethod
    def at_rest(cls) -> AdmittanceState:
        return cls(np.zeros(6), np.zeros(6), np.zeros(6))


def without_weight(wrench: Vector, tool: Tool, rotation_RE: Matrix) -> Vector:
    """`wrench` (6,) without what the tool weighs: m g downwards in R, seen from the end point, acting at the tool's centre."""
    weight = rotation_RE.T @ np.array([0.0, 0.0, -GRAVITY * tool.mass])
    result: Vector = wrench - np.concatenate([weight, np.cross(tool.centre, weight)])
    return result


def without_band(vector: Vector, band: float) -> Vector:
    """`vector` (3,) with its length n made n − band·tanh(n/band): nothing (n³/3band²) far inside the band, n − band far outside.

    Smooth, never longer, never turned; its slope stays in [0, 1), so a band never makes a loop stiffer.
    """
    norm = float(np.linalg.norm(vector))
    if band <= 0.0:
        return vector
    rest: Vector = vector * (1.0 - band * np.tanh(norm / band) / max(norm, 1e-12 * band))
    return rest


def bounded(vector: Vector, bound: float) -> Vector:
    """`vector` (3,), shortened to `bound` where it is longer."""
    norm = float(np.linalg.norm(vector))
    if norm <= bound:
        return vector
    shorter: Vector = vector * (bound / norm)
    return shorter


def halves(vector: Vector, bound: Pair) -> Vector:
    """Both halves of `vector` (6,), `bounded`."""
    return np.concatenate([bounded(vector[:3], bound.linear), bounded(vector[3:], bound.angular)])


def admit(
    law: Admittance,
    state: AdmittanceState,
    wrench: Vector | None,
    rotation_RE: Matrix,
    path_scale: float,
    dt: float,
    wanted: Vector | None = None,
) -> tuple[AdmittanceState, Vector]:
    """One cycle of `dt` s: the next state and the twist (6,) to command.

    `wrench` (6,): on the TCP from outside, end-point axes; None counts as no force at all, so that the TCP comes to rest.
    `path_scale` in [0, 1]: the share of the last twists that the planner went; what it did not go is taken out of the virtual mass'
    velocity, which therefore cannot wind up. `wanted` (6,): velocity that the mass would have without a force, default 0.

    Axes that turn: see `carried`. The mass is integrated by the backward Euler rule, so that in discrete time, too, its energy never
    grows by more than the work of the wrench on it, wherever no bound is reached.
    """
    force = np.zeros(6) if wrench is None else _felt(law, wrench, rotation_RE)
    smoothed = state.wrench + dt / (law.filter_s + dt) * (force - state.wrench)
    effective = law.gain * np.concatenate(
        [without_band(smoothed[:3], law.dead_band.linear), without_band(smoothed[3:], law.dead_band.angular)]
    )
    effective = halves(effective, law.saturation) * law.guided
    before = _unwound(state, path_scale)
    target = np.zeros(6) if wanted is None else wanted
    pull = effective + law.damping * (target - before)
    rate = halves(pull / (law.mass + dt * law.damping), law.acceleration)
    velocity = halves(before + dt * rate, law.speed)
    twist = halves(velocity + law.lead_s * rate, law.speed)
    return AdmittanceState(velocity, smoothed, twist), twist


def _felt(law: Admittance, wrench: Vector, rotation_RE: Matrix) -> Vector:
    return wrench if law.tool is None else without_weight(wrench, law.tool, rotation_RE)


def _unwound(state: AdmittanceState, path_scale: float) -> Vector:
    """The velocity (6,) that the planner let happen, plus a little: the path has to be asked for more to become free again."""
    if path_scale >= 1.0:
        return state.velocity
    share = min(max(path_scale, 0.0), 1.0)
    return np.concatenate(
        [
            bounded(state.velocity[:3], share * float(np.linalg.norm(state.sent[:3])) + CREEP.linear),
            bounded(state.velocity[3:], share * float(np.linalg.norm(state.sent[3:])) + CREEP.angular),
        ]
    )


def carried(state: AdmittanceState, turned: Vector) -> AdmittanceState:
    """The same state seen from axes that have turned by the rotation vector `turned` (3,), rad: a mass that goes straight does not
    turn with the hand."""
    if not turned.any():
        return state
    back = np.kron(np.eye(2), rotation_exp(-turned))
    return AdmittanceState(back @ state.velocity, back @ state.wrench, back @ state.sent)


CREEP = Pair(0.01, 0.02)
"""Speed that is asked for, at least, while a force pushes against a path that stands."""
