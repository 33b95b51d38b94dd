"""What goes into an arm cycle of the planner, what it carries to the next one, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass

from stack.messages import JointReference, Matrix, Mode, Restriction, TrackedPose, Vector
from stack.planner.arm_command import ArmCommand
from stack.planner.drift import DriftEstimate
from stack.planner.joint_following import JointFollower
from stack.planner.leaf import LeafState
from stack.planner.odometry import Odometry, PlatformPose, PlatformRate
from stack.planner.path_following import Deviation, PathFollower
from stack.planner.platform_command import PlatformCommand
from stack.planner.preference_change import PreferenceChange
from stack.planner.reference import CommandFilter


@dataclass(frozen=True, slots=True, eq=False)
class PlannerInputs:
    """What this cycle has heard. `q` (n,) and `wheels` (left, right; rad) were sampled at `t_ns`; None: missing or stale.

    `twist` (6,) is None when it is stale or was never received; `tracked` is None unless it is new in this cycle, and
    so is `joints`, a joint reference with the time at which it came (ns).
    """

    t_ns: int
    mode: Mode
    q: Vector | None
    wheels: tuple[float, float] | None
    twist: Vector | None
    tracked: TrackedPose | None
    joints: tuple[JointReference, int] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlannerState:
    """Everything that the planner carries from cycle to cycle.

    `q_next` (n,): the set point of the last cycle, where the arm is at SYNC k + 1, None at rest; `dq` (n,) the velocity that leads there.
    `X_RE` (4, 4): commanded TCP pose for SYNC k + 1 in the reference frame, None while nothing is commanded.
    `rate`: platform rate last commanded; `commanded`: the platform's pose at SYNC k + 1 had it always obeyed.
    """

    drift: DriftEstimate
    cycle: int = 0
    mode: Mode = Mode.OFF
    began_ns: int = 0
    q_next: Vector | None = None
    dq: Vector | None = None
    X_RE: Matrix | None = None
    command: CommandFilter = CommandFilter()
    odometry: Odometry = Odometry()
    commanded: PlatformPose = PlatformPose(0.0, 0.0, 0.0)
    rate: PlatformRate = PlatformRate(0.0, 0.0)
    joints: JointFollower = JointFollower()
    path: PathFollower = PathFollower()
    preferences: PreferenceChange = PreferenceChange()
    door: LeafState = LeafState()


@dataclass(frozen=True, slots=True, eq=False)
class PlannerOutputs:
    """What to send: joint set points for SYNC k + 2 with velocity and torque offset (n,), wheel rates (rad/s), and what is reported.

    `X_RE` (4, 4): commanded TCP pose for SYNC k + 2, None while nothing is commanded; `T_RE` the believed one at SYNC k.
    `path`: where the platform is on the path that it is bound to, as the last platform cycle saw it ahead. `opening`: how far the door is
    open (rad or m) whose leaf is kept clear of.
    """

    q: Vector
    dq: Vector
    effort: Vector
    wheels: tuple[float, float]
    X_RE: Matrix | None
    T_RE: Matrix
    arm: ArmCommand
    platform: PlatformCommand
    restrictions: Restriction
    platform_cycle: bool
    path: Deviation | None = None
    opening: float = 0.0
