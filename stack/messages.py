"""What the layers say to each other, in SI units. Every message is a frozen value; a thing never received is `None`.

Quaternions are xyzw; twists and wrenches are stacked `[v; ω]` and `[f; m]`. Frames: W world, B platform, E end point (TCP),
R reference frame of the commanded path (fixed in the world, chosen when a motion starts).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Mode(IntEnum):
    """What the strategic layer wants the planner to do with its twist."""

    OFF = 0
    HOLD = 1
    ARM_ONLY = 2
    PLATFORM_ONLY = 3
    COORDINATED = 4
    JOINTS = 5


class Gripper(IntEnum):
    """What the mission asks of the gripper."""

    KEEP = 0
    OPEN = 1
    CLOSE = 2


class GripperPhase(IntEnum):
    """What the gripper is doing."""

    OPEN = 0
    CLOSING = 1
    HOLDING = 2
    EMPTY = 3
    """closed on nothing, or what it held was torn out"""


class PlannerPhase(IntEnum):
    """Where the planner is, from power-up to motion."""

    BOOT = 0
    CONFIGURE = 1
    READY = 2
    ENABLING = 3
    IDLE = 4
    EXECUTING = 5
    STOPPING = 6
    FAULT = 7


class Restriction(IntFlag):
    """What shaped the last command, as bits of the planner's state frame."""

    NONE = 0
    JOINT_1 = 1 << 0
    JOINT_2 = 1 << 1
    JOINT_3 = 1 << 2
    JOINT_4 = 1 << 3
    JOINT_5 = 1 << 4
    JOINT_6 = 1 << 5
    JOINT_7 = 1 << 6
    JOINT_8 = 1 << 7
    VELOCITY = 1 << 8
    ACCELERATION = 1 << 9
    SINGULARITY = 1 << 10
    PLATFORM = 1 << 11
    STALE_TWIST = 1 << 12
    STALE_DRIVE = 1 << 13
    DEGRADED = 1 << 14
    COLLISION = 1 << 15


class SingularityKind(IntEnum):
    """Kinds of singularity (Park, Chang, Lee), as the planner's object 2041h and its singularity frame number them."""

    NONE = 0
    KINEMATIC = 1
    ALGORITHMIC = 2
    SEMI = 3
    SEMI_ALGORITHMIC = 4


@dataclass(frozen=True, slots=True)
class SingularityReport:
    """What the planner's singularity monitor says: the kind that the robot is within the named radius of, the nearest known manifold
    (1: the first of the robot's, 0: none known), margins in [0, 1] of KS, AS, SS, SAS (see `stack.planner.monitor`)."""

    kind: SingularityKind
    manifold: int
    margins: tuple[float, float, float, float]
    counter: int


@dataclass(frozen=True, slots=True)
class SlipReport:
    """What the planner's slip observer says: slip ratio of the left and the right wheel, and how many tracked poses it has taken in and
    rejected, both modulo 256."""

    slip: tuple[float, float]
    measured: int
    rejected: int
    counter: int


@dataclass(frozen=True, slots=True)
class TwistCommand:
    """Commanded TCP twist in the commanded end-point frame, (6,) `[v; ω]`; platform only: v[0] and ω[2] of the platform."""

    twist: Vector
    counter: int


@dataclass(frozen=True, slots=True)
class MissionCommand:
    """What the strategic layer is doing; `mode` tells the planner how to use the twist, `gripper` the gripper what to do."""

    mode: Mode
    step: int
    counter: int
    gripper: Gripper = Gripper.KEEP


@dataclass(frozen=True, slots=True)
class JointReference:
    """Where the arm's joints shall be, (8,) rad (m for the lift), when this message is received; one every strategic cycle."""

    position: Vector
    counter: int


@dataclass(frozen=True, slots=True)
class PlannerState:
    """The planner's answer of every arm cycle."""

    phase: PlannerPhase
    status: int
    restrictions: Restriction
    path_scale: float
    counter: int


@dataclass(frozen=True, slots=True)
class Wrench:
    """Force and torque at the TCP in the end-point frame, (6,) `[f; m]`, acting on the robot from outside."""

    wrench: Vector
    counter: int


@dataclass(frozen=True, slots=True)
class GripperState:
    """What the gripper says of itself."""

    phase: GripperPhase
    counter: int


@dataclass(frozen=True, slots=True)
class TrackedPose:
    """TCP pose in the world as a tracked feature sees it: position (3,), rotation vector (3,), and how old it is."""

    position: Vector
    rotation_vector: Vector
    age_ns: int
    counter: int


@dataclass(frozen=True, slots=True)
class DriveFeedback:
    """One drive's TPDO: position in rad or m, effort in N·m or N (of the rated torque), statusword."""

    statusword: int
    position: float
    effort: float


@dataclass(frozen=True, slots=True)
class Truth:
    """What only the physics knows, sampled at a SYNC: for recording and judging, never for control.

    `pose_WB`, `pose_WE` (4, 4); `q`, `dq` (8,) joint positions and velocities; `wheel_slip` (2,) current slip ratios;
    `base_twist` (v, ω) of the platform over ground; `contact_wrench` (6,) on the gripper, end-point frame.
    Where there is a door: `door` (2,) how far it is open (rad, m) and its rate; `handle_force` (3,) on its handle: along the door's way,
    across it (outwards), along the handle. Where a person pulls: `hand` (6,) where the hand is and its force on the gripper, world.
    `body_poses` (k, 4, 4) in the world: what moves around the robot, in the order of the scenario.
    """

    t_ns: int
    pose_WB: Matrix
    pose_WE: Matrix
    q: Vector
    dq: Vector
    effort: Vector
    wheel_velocity: Vector
    wheel_slip: Vector
    base_twist: Vector
    contact_wrench: Vector
    door: Vector | None = None
    handle_force: Vector | None = None
    hand: Vector | None = None
    body_poses: Matrix | None = None
