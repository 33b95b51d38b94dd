"""Force guidance as a step of a mission: a person leads the TCP by the hand for a while."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stack.messages import Vector
from stack.strategic.fence import Fence, FencePost, freedom, moved_post, pull_back
from stack.strategic.force_guidance import Admittance, AdmittanceState, admit, carried
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs

DEAF_S = 0.5
"""How long the TCP may go without a reading of the force: it comes to rest meanwhile."""


@dataclass(frozen=True, slots=True, eq=False)
class GuideState:
    """The virtual mass, the largest force and speed so far (N, m/s), and for how long no force has been heard (s), the fence."""

    admittance: AdmittanceState
    force: float = 0.0
    speed: float = 0.0
    deaf_s: float = 0.0
    post: FencePost | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """The TCP goes where it is pulled, for `duration_s`. Fails when the force sensor falls silent.

    A spring at `fence` pulls back from singularities and from where the arm cannot follow, while the planner says where the hand is.
    """

    law: Admittance
    duration_s: float
    fence: Fence = Fence()

    def begin(self, inputs: MotionInputs) -> GuideState:
        return GuideState(AdmittanceState.at_rest())

    def step(self, state: GuideState, inputs: MotionInputs) -> tuple[GuideState, MotionOutputs]:
        deaf = state.deaf_s + CYCLE_S if inputs.wrench is None else 0.0
        if deaf > DEAF_S:
            return state, MotionOutputs(failure=f"no force was heard for {DEAF_S:g} s: is the force sensor on the bus?")
        if inputs.t_s >= self.duration_s:
            said = f"guided with at most {state.force:.1f} N, up to {state.speed:.2f} m/s"
            return state, MotionOutputs(done=True, event=said)
        rotation = inputs.rotation_RE if inputs.X_RE is None else inputs.X_RE[:3, :3]
        scale = inputs.planner.path_scale
        mass = carried(state.admittance, state.admittance.sent[3:] * (scale * CYCLE_S))
        post, wanted = self._fenced(state, inputs)
        following, twist = admit(self.law, mass, inputs.wrench, rotation, scale, CYCLE_S, wanted)
        force = float((following.wrench[:3] @ following.wrench[:3]) ** 0.5)
        speed = float((twist[:3] @ twist[:3]) ** 0.5)
        return GuideState(following, max(state.force, force), max(state.speed, speed), deaf, post), MotionOutputs(twist)

    def _fenced(self, state: GuideState, inputs: MotionInputs) -> tuple[FencePost | None, Vector | None]:
        """The fence's post and the velocity (6,) to which its spring alone would move the mass."""
        if inputs.X_RE is None:
            return state.post, None
        place = inputs.X_RE[:3, 3]
        post = moved_post(state.post, place, freedom(self.fence, inputs.singularity_margin, inputs.planner))
        force = inputs.X_RE[:3, :3].T @ pull_back(self.fence, post, place)
        return post, np.concatenate([force / self.law.damping[:3], np.zeros(3)]) * self.law.gain
