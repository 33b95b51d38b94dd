"""A hinged door pulled open by its handle, without knowing where its hinge is.

The hand goes along the tangent of the circle that is believed now, and gives way to every force, a little along the door's way, more
across it: what the belief has wrong shows as force across the handle, which the admittance turns into motion, so that the handle's way is
the door's own circle, not the believed one. From that way (and from how far the force bends arm and gripper) hinge and radius are
identified while it goes on; with them the tangent becomes right and the force across goes away.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from stack.kinematics.se3 import rotation_log
from stack.messages import Matrix, Vector
from stack.strategic.door_identification import Hinge, Identification, Prior
from stack.strategic.force_guidance import Admittance, AdmittanceState, Pair, admit, without_weight
from stack.strategic.guide import DEAF_S
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs, ParameterWrite


def _law() -> Admittance:
    """In the door's axes: along its way, across it from the hinge, up its axis. Stiff along, soft across; light against torques, so that a
    hand that cannot turn in the handle turns with it."""
    return Admittance(
        mass=np.array([60.0, 20.0, 20.0, 0.5, 0.5, 0.5]),
        damping=np.array([400.0, 200.0, 200.0, 4.0, 4.0, 4.0]),
        lead_s=0.03,
        dead_band=Pair(0.3, 0.05),
        saturation=Pair(100.0, 6.0),
        speed=Pair(0.3, 1.0),
        acceleration=Pair(1.0, 3.0),
        guided=np.ones(6),
    )


@dataclass(frozen=True, slots=True)
class Pull:
    """How the door is pulled: `angle` (rad, its sign says which way about the guessed axis), `speed` of the handle (m/s) once the radius
    is known to `known` (standard deviation over radius) and `feeling_speed` before, `acceleration` (m/s²) between them and to the end;
    `follow` share of the door's turning that the hand makes; `identify` False: the guess is believed to the end.

    `yielding_n`: force across at which the hand goes half as fast; `load_limit_n`: how much of a steady force against the door's way is
    made up for; `force_limit_n`: force that means the door is stuck; `patience_s` without progress that mean the same; `compliance` (m/N):
    how far arm and gripper give way to a force.
    """

    angle: float
    speed: float = 0.12
    feeling_speed: float = 0.05
    acceleration: float = 0.1
    follow: float = 1.0
    identify: bool = True
    known: float = 0.03
    yielding_n: float = 15.0
    force_limit_n: float = 120.0
    load_limit_n: float = 40.0
    patience_s: float = 4.0
    compliance: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class DoorGuess:
    """Where the hinge might be: `radius` m, direction (3,) from the handle to the hinge, `axis` (3,), all in the reference frame."""

    radius: float
    direction: Vector
    axis: Vector

    def hinge(self, handle: Vector) -> Hinge:
        """The guessed hinge for a handle at `handle` (3,)."""
        axis = self.axis / np.linalg.norm(self.axis)
        level = self.direction - (axis @ self.direction) * axis
        return Hinge(handle + self.radius * level / np.linalg.norm(level), axis, self.radius)


@dataclass(frozen=True, slots=True)
class LeafObjects:
    """The planner's objects, (index, subindex), that say where the hinge of the leaf is in the reference frame, and last of all how it
    moves: there `turns` is written."""

    hinge_x: tuple[int, int]
    hinge_y: tuple[int, int]
    motion: tuple[int, int]
    turns: int

    def writes(self, x: float, y: float) -> tuple[ParameterWrite, ...]:
        """What tells the planner that the hinge is at x, y (m)."""
        return (
            ParameterWrite(*self.hinge_x, x),
            ParameterWrite(*self.hinge_y, y),
            ParameterWrite(*self.motion, self.turns),
        )


@dataclass(frozen=True, slots=True, eq=False)
class DoorState:
    """What is believed of the door, and the virtual mass in the door's axes (along, outward, axis). `start` (3,): where the handle was,
    `rotation` (3, 3) how the hand was turned there. `speed` (m/s) asked for, `angle` (rad) so far, `furthest` (rad) it has come; `known`
    whether the radius is, `load` (N) what the door itself takes to be moved, `across` (N) the largest force across since the radius is
    known. `waiting_s` without progress, `deaf_s` without a force. `told` (x, y, m): where the planner was told that the hinge is.
    """

    identification: Identification
    admittance: AdmittanceState
    start: Vector
    rotation: Matrix
    speed: float = 0.0
    angle: float = 0.0
    known: bool = False
    load: float = 0.0
    across: float = 0.0
    furthest: float = 0.0
    waiting_s: float = 0.0
    deaf_s: float = 0.0
    told: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PullDoor:
    """Pulls until the door has turned by `pull.angle`. Fails when the handle is lost, the door stuck, or force or pose are not heard.

    `leaf`: where a planner that keeps clear of the leaf is told the hinge once it is known, and again where it was wrong by `HINGE_NEWS_M`.
    """

    guess: DoorGuess
    pull: Pull
    prior: Prior = Prior()
    law: Admittance = field(default_factory=_law)
    leaf: LeafObjects | None = None

    def begin(self, inputs: MotionInputs) -> DoorState | None:
        """None when the planner's reference pose is not known: `step` then says so."""
        if inputs.X_RE is None:
            return None
        handle = inputs.X_RE[:3, 3].copy()
        hinge = self.guess.hinge(handle)
        return DoorState(
            Identification.starting(hinge, self.prior), AdmittanceState.at_rest(), handle, inputs.X_RE[:3, :3].copy()
        )

    def step(self, state: DoorState | None, inputs: MotionInputs) -> tuple[DoorState | None, MotionOutputs]:
        if state is None or inputs.X_RE is None:
            return state, MotionOutputs(failure="the planner does not say where the hand is")
        if inputs.wrench is None:
            deaf = replace(state, deaf_s=state.deaf_s + CYCLE_S, admittance=AdmittanceState.at_rest(), speed=0.0)
            silent = f"no force was heard for {DEAF_S:g} s: is the force sensor on the bus?"
            return deaf, MotionOutputs(failure=silent if deaf.deaf_s > DEAF_S else None)
        if inputs.grasped is False:
            return state, MotionOutputs(failure=f"the handle was lost at {np.degrees(state.angle):.1f} degrees")
        rotation = inputs.X_RE[:3, :3]
        wrench = inputs.wrench
        if self.law.tool is not None:
            wrench = without_weight(wrench, self.law.tool, rotation)
        wrench = np.concatenate([rotation @ wrench[:3], rotation @ wrench[3:]])
        handle = inputs.X_RE[:3, 3] + self.pull.compliance * wrench[:3]
        state = self._believe(replace(state, deaf_s=0.0), handle)
        if state.angle >= abs(self.pull.angle) - ANGLE_TOLERANCE:
            return state, MotionOutputs(done=True, event=_summary(state), found=_found(state))
        return self._go_on(state, wrench, handle, rotation, inputs.planner.path_scale)

    def _believe(self, state: DoorState, handle: Vector) -> DoorState:
        """Identification, angle and progress with the handle at `handle` (3,)."""
        known = state.identification.with_point(handle) if self.pull.identify else state.identification
        angle = known.hinge.angle(state.start, handle) * np.sign(self.pull.angle)
        further = len(known.points) > len(state.identification.points) or angle > state.furthest + PROGRESS
        return replace(
            state,
            identification=known,
            angle=angle,
            known=state.known or known.radius_known < self.pull.known,
            furthest=angle if further else state.furthest,
            waiting_s=0.0 if further else state.waiting_s + CYCLE_S,
        )

    def _go_on(
        self, state: DoorState, wrench: Vector, handle: Vector, rotation: Matrix, scale: float
    ) -> tuple[DoorState, MotionOutputs]:
        """The next twist; `wrench` (6,) and `handle` (3,) in the reference frame, `rotation` (3, 3) of the hand."""
        hinge, pull = state.identification.hinge, self.pull
        outward = hinge.outward(handle)
        along = np.sign(pull.angle) * hinge.tangent(handle)
        door = np.column_stack([along, outward, hinge.axis])
        felt = np.concatenate([door.T @ wrench[:3], door.T @ wrench[3:]])
        across = float(np.hypot(felt[1], felt[2]))
        if state.waiting_s > pull.patience_s or float(np.linalg.norm(felt[:3])) > pull.force_limit_n:
            said = f"{felt[0]:.0f} N along and {across:.0f} N across the handle"
            return state, MotionOutputs(
                failure=f"the door is stuck at {np.degrees(state.angle):.1f} degrees with {said}"
            )
        speed = self._speed(state, across)
        load = state.load + CYCLE_S / (LOAD_S + CYCLE_S) * (-felt[0] - state.load)
        load = min(max(load, 0.0), pull.load_limit_n)
        wanted = np.concatenate(
            [[speed + load / self.law.damping[0], 0.0, 0.0], door.T @ self._turning(state, rotation)]
        )
        law = replace(self.law, tool=None)
        mass, twist = admit(law, state.admittance, felt, np.eye(3), scale, CYCLE_S, wanted)
        state = replace(
            state,
            admittance=mass,
            speed=speed,
            load=load,
            across=max(state.across, across) if state.known else state.across,
        )
        back = rotation.T @ door
        state, news = self._tell(state)
        return state, MotionOutputs(np.concatenate([back @ twist[:3], back @ twist[3:]]), writes=news)

    def _tell(self, state: DoorState) -> tuple[DoorState, tuple[ParameterWrite, ...]]:
        """What the planner shall know of the hinge from now on."""
        if self.leaf is None or not state.known:
            return state, ()
        x, y = (float(value) for value in state.identification.hinge.centre[:2])
        if state.told is not None and np.hypot(x - state.told[0], y - state.told[1]) < HINGE_NEWS_M:
            return state, ()
        return replace(state, told=(x, y)), self.leaf.writes(x, y)

    def _turning(self, state: DoorState, rotation: Matrix) -> Vector:
        """Angular velocity (3,), reference frame, of a hand that makes its share of the door's turn; what it has turned too far or
        about a wrong axis, while the hinge was not known, is taken back."""
        hinge, share = state.identification.hinge, self.pull.follow * np.sign(self.pull.angle)
        behind = share * state.angle * hinge.axis - rotation_log(rotation @ state.rotation.T)
        turning: Vector = share * state.speed / hinge.radius * hinge.axis + TURNING_GAIN * behind
        return turning

    def _speed(self, state: DoorState, across: float) -> float:
        """The handle's speed for the coming cycle: slower where little is known, where it strains, and towards the end."""
        pull, radius = self.pull, state.identification.hinge.radius
        top = pull.speed if state.known or not pull.identify else pull.feeling_speed
        top /= 1.0 + (across / pull.yielding_n) ** 2
        left = max(abs(pull.angle) - state.angle, 0.0) * radius
        top = max(min(top, float(np.sqrt(2.0 * pull.acceleration * left))), LAST_SPEED)
        change = pull.acceleration * CYCLE_S
        return min(max(top, state.speed - 3.0 * change), state.speed + change)


def _found(state: DoorState) -> tuple[tuple[str, float], ...]:
    hinge = state.identification.hinge
    tilt = float(np.arctan2(np.hypot(hinge.axis[0], hinge.axis[1]), abs(hinge.axis[2])))
    return ("door_radius_found_m", hinge.radius), ("door_axis_tilt_found_rad", tilt)


def _summary(state: DoorState) -> str:
    hinge = state.identification.hinge
    x, y, z = hinge.axis
    return (
        f"door open by {np.degrees(state.angle):.1f} degrees: radius {hinge.radius:.4f} m, axis ({x:.3f}, {y:.3f}, {z:.3f}), "
        f"at most {state.across:.1f} N across the handle once it was known"
    )


ANGLE_TOLERANCE = 0.002
HINGE_NEWS_M = 0.01
TURNING_GAIN = 1.0
"""1/s"""
PROGRESS = 0.003
"""rad: what counts as progress of the door."""
LOAD_S = 0.5
"""Time constant of the door's load: what lasts longer does not slow the hand down, what is quicker finds it soft."""
LAST_SPEED = 0.01
"""m/s: how fast the door arrives."""
