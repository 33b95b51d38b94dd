"""The TCP to a pose of the reference frame, straight and in one turn, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stack.kinematics.se3 import rotation_exp, rotation_log
from stack.messages import Matrix, Vector
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs
from stack.strategic.profile import RampProfile

SETTLE_GAIN = 4.0
"""1/s: how fast what is left at the end of the way is worked off."""
_SETTLE_LIMIT_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class ReachState:
    """Pose (4, 4) at the beginning, the way and the turn from there (3,), their profile, and how much of its time has run."""

    start: Matrix
    way: Vector
    turn: Vector
    profile: RampProfile
    elapsed_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """To `position` (3,) and, where it is given, `rotation` (3, 3), both in the reference frame: the world, where the TCP is tracked.

    `speed` (m/s) and `rate` (rad/s) are both kept. The profile's time runs with the planner's path scale, so a path that is slowed
    down is not left behind; it ends when the planner's own reference is within `tolerance_m` and `tolerance_rad` of the goal, and
    fails when it is not after a few more seconds.
    """

    position: Vector
    speed: float
    rate: float = 0.8
    ramp_s: float = 0.8
    rotation: Matrix | None = None
    tolerance_m: float = 0.001
    tolerance_rad: float = 0.003

    def begin(self, inputs: MotionInputs) -> ReachState | None:
        """None when the planner's reference pose is not known: `step` then says so."""
        if inputs.X_RE is None:
            return None
        start = inputs.X_RE
        way = self.position - start[:3, 3]
        turn = np.zeros(3) if self.rotation is None else rotation_log(self.rotation @ start[:3, :3].T)
        length, angle = float(np.linalg.norm(way)), float(np.linalg.norm(turn))
        # One profile over [0, 1]: its speed is that of whichever of way and turn needs longer.
        share = min(self.speed / length if length > 0.0 else np.inf, self.rate / angle if angle > 0.0 else np.inf)
        profile = RampProfile(1.0 if np.isfinite(share) else 0.0, min(share, 1e3), self.ramp_s)
        return ReachState(start, way, turn, profile)

    def step(self, state: ReachState | None, inputs: MotionInputs) -> tuple[ReachState | None, MotionOutputs]:
        if state is None:
            return None, MotionOutputs(failure="the planner's reference pose is not known")
        elapsed = state.elapsed_s
        following = replace(state, elapsed_s=elapsed + CYCLE_S * min(inputs.planner.path_scale, 1.0))
        if elapsed < state.profile.duration_s:
            share = state.profile.position(elapsed)
            pace = state.profile.mean_velocity(elapsed, CYCLE_S)
            return following, MotionOutputs(_twist(state, share, pace * state.way, pace * state.turn))
        return self._settle(following, inputs)

    def _settle(self, state: ReachState, inputs: MotionInputs) -> tuple[ReachState, MotionOutputs]:
        if inputs.X_RE is None:
            return state, MotionOutputs(failure="the planner's reference pose is no longer known")
        left = self.position - inputs.X_RE[:3, 3]
        goal = rotation_exp(state.turn) @ state.start[:3, :3]
        turn = rotation_log(goal @ inputs.X_RE[:3, :3].T)
        distance, angle = float(np.linalg.norm(left)), float(np.linalg.norm(turn))
        if distance <= self.tolerance_m and angle <= self.tolerance_rad:
            return state, MotionOutputs(done=True)
        if state.elapsed_s > state.profile.duration_s + _SETTLE_LIMIT_S:
            return state, MotionOutputs(
                failure=f"stops {1e3 * distance:.1f} mm and {1e3 * angle:.1f} mrad from its goal"
            )
        gain = SETTLE_GAIN * min(1.0, self.speed / max(SETTLE_GAIN * distance, 1e-9))
        return state, MotionOutputs(_twist(state, 1.0, gain * left, SETTLE_GAIN * turn))


def _twist(state: ReachState, share: float, velocity: Vector, spin: Vector) -> Vector:
    """(6,) in the end-point frame of the pose at `share` of the way."""
    to_end_point = (rotation_exp(share * state.turn) @ state.start[:3, :3]).T
    return np.concatenate((to_end_point @ velocity, to_end_point @ spin))
