"""Force guidance as a step of a mission: a person leads the TCP by the hand for a while."""

from __future__ import annotations

from dataclasses import dataclass

from stack.strategic.force_guidance import Admittance, AdmittanceState, admit, carried
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs

DEAF_S = 0.5
"""How long the TCP may go without a reading of the force: it comes to rest meanwhile."""


@dataclass(frozen=True, slots=True, eq=False)
class GuideState:
    """The virtual mass, the largest force and speed so far (N, m/s), and for how long no force has been heard (s)."""

    admittance: AdmittanceState
    force: float = 0.0
    speed: float = 0.0
    deaf_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """The TCP goes where it is pulled, for `duration_s`. Fails when the force sensor falls silent."""

    law: Admittance
    duration_s: float

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
        following, twist = admit(self.law, mass, inputs.wrench, rotation, scale, CYCLE_S)
        force = float((following.wrench[:3] @ following.wrench[:3]) ** 0.5)
        speed = float((twist[:3] @ twist[:3]) ** 0.5)
        return GuideState(following, max(state.force, force), max(state.speed, speed), deaf), MotionOutputs(twist)
