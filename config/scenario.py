"""A scenario: what robot, what bus, what disturbs it, what the robot shall do, and what must come out.

Every key of a scenario file is a field here; nothing else is accepted.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from config.bench import DriveNode, DriveTable
from config.faults import FaultTable, RecoveryTable
from config.guidance import DoorStepTable, ForceSensorTable, GuidanceTable
from config.platform_path import PlatformPathTable
from config.reaching import GoalTable, Objective, PoseTable
from config.surroundings import DoorTable, FurnitureTable, GripperTable, ObjectTable, PersonTable, WallTable
from config.table import Finite, NotNegative, Positive, Table, Vector3

Method = Literal["pns", "fsp", "gradient", "qp"]
Coordination = Literal["abc", "unified", "arm-only"]
ModeName = Literal["hold", "arm_only", "platform_only", "coordinated", "joints"]


class PlannerTable(Table):
    """How the local planner works in this scenario."""

    method: Method = "pns"
    coordination: Coordination = "abc"
    case: Annotated[int, Field(ge=1, le=4)] = 2
    arm_cycle_hz: Annotated[float, Field(ge=10, le=500)] = 100.0
    platform_cycle_hz: Annotated[float, Field(ge=1, le=500)] = 20.0
    slip_observer: bool = True
    slip_sigma: Annotated[float, Field(ge=0, le=1)] = 0.01
    slip_tau_s: Annotated[float, Field(ge=0.01, le=1000)] = 0.5
    slip_learning_s: Annotated[float, Field(ge=0, le=1000)] = 4.0
    null_space_motion: bool = True
    joint_limit_rules: bool = True
    repulsion: bool = False
    circumvention: bool = False
    collision_avoidance: bool = False

    @field_validator("arm_cycle_hz")
    @classmethod
    def _whole_milliseconds(cls, value: float) -> float:
        period_ms = 1e3 / value
        if abs(period_ms - round(period_ms)) > 1e-9:
            low, high = 1000.0 / math.ceil(period_ms), 1000.0 / math.floor(period_ms)
            raise ValueError(f"the cycle must take whole milliseconds, next are {low:g} and {high:g} Hz")
        return value

    @model_validator(mode="after")
    def _cycles_nest(self) -> PlannerTable:
        if self.platform_cycle_hz > self.arm_cycle_hz:
            raise ValueError(
                f"platform_cycle_hz = {self.platform_cycle_hz:g} must not exceed arm_cycle_hz = {self.arm_cycle_hz:g}"
            )
        return self


class BusTable(Table):
    """The wire in lockstep."""

    bitrate: Annotated[int, Field(ge=10_000, le=1_000_000)] = 1_000_000
    queue_frames: Annotated[int, Field(ge=1, le=10_000)] = 64


class SlipTable(Table):
    """Wheel slip: per wheel an Ornstein-Uhlenbeck process with standard deviation `sigma` and time constant `tau_s`."""

    sigma: Annotated[float, Field(ge=0, le=0.5)] = 0.01
    tau_s: Positive = 0.5


class FeedbackTable(Table):
    """TCP feedback: a tracked feature. `rate_hz = 0` switches it off."""

    rate_hz: Annotated[float, Field(ge=0, le=500)] = 50.0
    latency_s: Annotated[float, Field(ge=0, le=0.3)] = 0.02
    noise_m: NotNegative = 0.0005
    noise_rad: NotNegative = 0.0005


class StartTable(Table):
    """Where the robot stands when the run begins. `configuration`: arm joints, rad and m (default: the robot's home)."""

    configuration: tuple[Finite, ...] | None = None
    x_m: Finite = 0.0
    y_m: Finite = 0.0
    heading_rad: Finite = 0.0


class PreferenceTable(Table):
    """Preferences that the strategic node writes into the planner's dictionary (eq. 2.160); unset: the robot's default.

    Joint arrays have one entry per arm joint; `weights` two more, for the platform's v and ω.
    """

    preferred: tuple[Finite, ...] | None = None
    heights: tuple[NotNegative, ...] | None = None
    widths: tuple[Positive, ...] | None = None
    weights: tuple[Positive, ...] | None = None
    platform_angle_rad: Finite | None = None
    platform_gain: NotNegative | None = None
    platform_max_rate: NotNegative | None = None
    platform_feed_forward: NotNegative | None = None
    platform_speed_m_s: Finite | None = None


class StepTable(Table):
    """One step of the task: a twist profile in the reference frame, held for its length, with smooth ramps.

    `line`: the TCP moves `length_m` along `direction` at `speed_m_s`. `wait`: nothing for `duration_s`.
    `drive`: the platform goes `length_m` straight at `speed_m_s` (negative length: backwards).
    `turn`: the platform turns `angle_rad` at `rate_rad_s`.
    `reach`: the TCP goes straight to `pose` at `speed_m_s` (and at most `rate_rad_s`). `joints`: the arm goes to `goal`, or to several,
    along trajectories planned with `objective`; the platform stands.
    `grip`: the gripper opens or closes, as `gripper` says.
    `guide`: the TCP gives way to the force on it for `duration_s`, as `guidance` says. `door`: pulls a hinged door open, see `pull`.
    """

    name: str
    kind: Literal["wait", "line", "drive", "turn", "reach", "joints", "grip", "guide", "door"]
    mode: ModeName = "coordinated"
    duration_s: Positive | None = None
    direction: Vector3 | None = None
    length_m: Finite | None = None
    speed_m_s: Positive | None = None
    angle_rad: Finite | None = None
    rate_rad_s: Positive | None = None
    pose: PoseTable | None = None
    goal: tuple[GoalTable, ...] = ()
    objective: Objective = "potentials"
    gripper: Literal["open", "close"] | None = None
    guidance: GuidanceTable | None = None
    pull: DoorStepTable | None = None
    ramp_s: Positive = 1.0
    preferences: PreferenceTable | None = None

    @model_validator(mode="after")
    def _complete(self) -> StepTable:
        needed = {
            "wait": ("duration_s",),
            "line": ("direction", "length_m", "speed_m_s"),
            "drive": ("length_m", "speed_m_s"),
            "turn": ("angle_rad", "rate_rad_s"),
            "reach": ("pose", "speed_m_s"),
            "joints": (),
            "grip": ("gripper",),
            "guide": ("duration_s",),
            "door": ("pull",),
        }[self.kind]
        for key in needed:
            if getattr(self, key) is None:
                raise ValueError(f"a step of kind {self.kind!r} needs {key}")
        if self.kind == "joints" and not self.goal:
            raise ValueError("a step of kind 'joints' needs goal")
        if (self.kind == "joints") != (self.mode == "joints"):
            raise ValueError(f'a step of kind {self.kind!r} and mode {self.mode!r}: "joints" goes with "joints"')
        if self.kind in ("drive", "turn") and self.mode != "platform_only":
            raise ValueError(f'a step of kind {self.kind!r} needs mode = "platform_only"')
        if self.direction is not None and sum(x * x for x in self.direction) < 1e-12:
            raise ValueError("direction must not be the zero vector")
        return self


class ExpectTable(Table):
    """One expectation: a metric (dotted into metrics.json) with an upper or a lower bound, or both."""

    metric: str
    max: Finite | None = None
    min: Finite | None = None

    @model_validator(mode="after")
    def _bounded(self) -> ExpectTable:
        if self.max is None and self.min is None:
            raise ValueError("an expectation needs max or min")
        return self


class Scenario(Table):
    """A whole scenario file."""

    name: str
    title: str
    robot: str = "moma8"
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    duration_s: Positive
    planner: PlannerTable = PlannerTable()
    bus: BusTable = BusTable()
    drives: dict[DriveNode, DriveTable] = Field(default_factory=dict)
    slip: SlipTable = SlipTable()
    feedback: FeedbackTable = FeedbackTable()
    force_sensor: ForceSensorTable | None = None
    start: StartTable = StartTable()
    preferences: PreferenceTable = PreferenceTable()
    platform_path: PlatformPathTable | None = None
    cases: dict[Literal["1", "2", "3", "4"], PreferenceTable] = Field(default_factory=dict)
    door: DoorTable | None = None
    person: PersonTable | None = None
    table: tuple[FurnitureTable, ...] = ()
    wall: tuple[WallTable, ...] = ()
    object: tuple[ObjectTable, ...] = ()
    gripper: GripperTable = GripperTable()
    step: tuple[StepTable, ...]
    fault: tuple[FaultTable, ...] = ()
    recovery: RecoveryTable | None = None
    expect: tuple[ExpectTable, ...] = ()

    def case_preferences(self) -> PreferenceTable:
        """The preferences in force at the start: the scenario's, overlaid with those of `planner.case`."""
        case = self.cases.get(str(self.planner.case))  # type: ignore[call-overload]
        if case is None:
            return self.preferences
        return self.preferences.model_copy(update=case.model_dump(exclude_none=True))
