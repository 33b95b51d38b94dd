"""What the planner can be told while it runs: every field is reachable through its object dictionary."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from stack.kinematics.proximity import Box
from stack.messages import Matrix, Vector
from stack.planner.avoidance import Avoidance
from stack.planner.clearance import Clearance
from stack.planner.leaf import DoorLeaf
from stack.planner.observer import SlipModel
from stack.planner.platform_path import RelativePath


class Method(IntEnum):
    """Redundancy resolution methods, as object 2001h numbers them."""

    PNS = 0
    FSP = 1
    GRADIENT = 2
    QP = 3

    @classmethod
    def named(cls, name: str) -> Method:
        return cls[name.upper()]


class Coordination(IntEnum):
    """How arm and platform share a motion, as object 2002h numbers it."""

    ABC = 0
    UNIFIED = 1
    ARM_ONLY = 2

    @classmethod
    def named(cls, name: str) -> Coordination:
        return cls[name.upper().replace("-", "_")]


@dataclass(frozen=True, slots=True, eq=False)
class Preferences:
    """Preferred joint velocity `z_i = a_i tanh((q_pref,i − q_i)/c_i)` and weights (2.160); the platform's wishes (4.1.3).

    preferred, heights, widths (n,) for the arm; weights (n + 2,) the diagonal of B, last two for v and ω.
    `platform_angle` (rad): wanted angle of the platform's x axis to the horizontal part of the TCP twist; `platform_gain` (1/s) and
    `platform_max_rate` (rad/s) of the saturated P-controller that keeps it; `platform_feed_forward` in [0, 1]: share of the low-passed
    TCP speed that the platform would like to drive; `platform_speed` (m/s): what it would like to drive besides, wherever the TCP goes.
    """

    preferred: Vector
    heights: Vector
    widths: Vector
    weights: Vector
    platform_angle: float = 0.0
    platform_gain: float = 0.0
    platform_max_rate: float = 0.4
    platform_feed_forward: float = 0.0
    platform_speed: float = 0.0
    wishes: Matrix = field(init=False, repr=False)
    """(3, n): preferred, heights, widths."""
    arm_weight: Matrix = field(init=False, repr=False)
    """(n, n): B of the arm alone."""
    robot_weight: Matrix = field(init=False, repr=False)
    """(n + 2, n + 2): B of the whole robot."""

    def __post_init__(self) -> None:
        n = len(self.preferred)
        object.__setattr__(self, "wishes", np.array([self.preferred, self.heights, self.widths]))
        object.__setattr__(self, "arm_weight", np.diag(self.weights[:n]))
        object.__setattr__(self, "robot_weight", np.diag(self.weights))


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Bounds that the planner respects: joints (n,), platform scalars; the drives enforce their own, a little wider, ones.

    `padding` (n,): width of the padding zone inside each joint limit.
    """

    q_min: Vector
    q_max: Vector
    padding: Vector
    dq_max: Vector
    ddq_max: Vector
    v_max: float
    omega_max: float
    dv_max: float
    domega_max: float


@dataclass(frozen=True, slots=True, eq=False)
class PlannerParameters:
    """All of it. `arm_period_ns`: the SYNC period; `platform_cycles_per_arm_cycle` in (0, 1], e.g. 20 Hz / 100 Hz = 0.2.

    `correction_gain` (1/s): how fast a deviation of the commanded TCP pose is worked off; `slip_observer`: whether
    the wheels' slip is estimated (with `slip_model`) and fed forward; without it `tracker_gain` is the weight of one TCP measurement;
    `epsilon`: propping threshold (2.139); `patience_m`, `patience_rad`: deviation of the set points from the path beyond
    which the path begins to wait, at twice of which it stands. `repulsion`, `circumvention`: whether the arm keeps away
    from its singular manifolds, softly and hard, with the sizes of `avoidance`; `collision_avoidance`: whether its
    links keep clear of each other, of the platform, of the `obstacles` and of the leaf of the `door`, as `clearance`
    says. `platform_path`: what the platform is bound to while arm and platform are coordinated, from where it stands when
    it first sees it; None: it moves freely.
    """

    arm_period_ns: int
    platform_cycles_per_arm_cycle: float
    preferences: Preferences
    limits: Limits
    method: Method = Method.PNS
    coordination: Coordination = Coordination.ABC
    null_space_motion: bool = True
    joint_limit_rules: bool = True
    repulsion: bool = False
    circumvention: bool = False
    collision_avoidance: bool = False
    clearance: Clearance = Clearance()
    obstacles: tuple[Box, ...] = ()
    door: DoorLeaf | None = None
    avoidance: Avoidance = Avoidance()
    platform_path: RelativePath | None = None
    correction_gain: float = 20.0
    slip_observer: bool = True
    slip_model: SlipModel = SlipModel()
    tracker_gain: float = 0.25
    epsilon: float = 0.02
    patience_m: float = 0.005
    patience_rad: float = 0.01
    twist_timeout_ns: int = 150_000_000
    twist_smoothing_s: float = 0.03
    speed_smoothing_s: float = 0.25
    window_s: float = 1.0

    @property
    def arm_period_s(self) -> float:
        return self.arm_period_ns * 1e-9

    @property
    def platform_period_s(self) -> float:
        """Mean time between platform cycles."""
        return self.arm_period_s / self.platform_cycles_per_arm_cycle

    def platform_cycle_due(self, cycle: int) -> bool:
        """Whether arm cycle number `cycle` holds a platform cycle; their mean rate is exact for any ratio."""
        ratio = self.platform_cycles_per_arm_cycle
        return int((cycle + 1) * ratio + 1e-9) > int(cycle * ratio + 1e-9)


def flat(n: int, value: float) -> Vector:
    """(n,) of one value, read-only."""
    array = np.full(n, value)
    array.setflags(write=False)
    return array
