"""The mission as the bus would drive it: it waits, writes, locates, moves, and says why when it cannot."""

import numpy as np
import pytest

from stack.messages import Mode, PlannerPhase, PlannerState, Restriction
from stack.strategic.mission import (
    Mission,
    MissionInputs,
    MissionState,
    ParameterWrite,
    Stage,
    Step,
)
from stack.strategic.motion import CYCLE_NS
from stack.strategic.profile import RampProfile
from stack.strategic.profiled import Line, Turn, Wait

WRITE = ParameterWrite(0x2011, 3, 0.5)
LATER = ParameterWrite(0x2011, 4, 0.25)
MISSION = Mission(
    steps=(
        Step("pull", Mode.COORDINATED, Line(RampProfile(0.4, 0.2, 0.5), np.array([0.0, 1.0, 0.0]))),
        Step("turn", Mode.PLATFORM_ONLY, Turn(RampProfile(0.6, 0.5, 0.5)), writes=(LATER,)),
        Step("rest", Mode.HOLD, Wait(0.2)),
    ),
    initial_writes=(WRITE,),
)
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def planner(phase: PlannerPhase) -> PlannerState:
    return PlannerState(phase, 0, Restriction.NONE, 1.0, 0)


def run(mission: Mission, cycles: int = 1000) -> tuple[MissionState, list]:
    state, outputs = MissionState(), []
    for k in range(cycles):
        phase = PlannerPhase.READY if k < 3 else PlannerPhase.IDLE
        inputs = MissionInputs(k * CYCLE_NS, planner(phase), writes_done=True, rotation_RE=QUARTER_TURN)
        state, output = mission.step(state, inputs)
        outputs.append(output)
        if state.stage is Stage.FINISHED:
            break
    return state, outputs


def test_the_twists_add_up_to_the_line_in_the_end_point_frame() -> None:
    state, outputs = run(MISSION)
    assert state.stage is Stage.FINISHED
    travelled = sum(o.twist for o in outputs if o.mode is Mode.COORDINATED) * CYCLE_NS * 1e-9
    # y of the reference frame is x of an end point turned by a quarter
    np.testing.assert_allclose(travelled, [0.4, 0, 0, 0, 0, 0], atol=1e-12)


def test_the_turn_adds_up_too_and_only_the_platform_is_asked() -> None:
    _, outputs = run(MISSION)
    turned = sum(o.twist for o in outputs if o.mode is Mode.PLATFORM_ONLY) * CYCLE_NS * 1e-9
    np.testing.assert_allclose(turned, [0, 0, 0, 0, 0, 0.6], atol=1e-12)


def test_parameters_are_written_once_before_their_step() -> None:
    _, outputs = run(MISSION)
    assert [o.writes for o in outputs if o.writes] == [(WRITE,), (LATER,)]
    first_motion = next(i for i, o in enumerate(outputs) if o.twist.any())
    assert next(i for i, o in enumerate(outputs) if o.writes) < first_motion


def test_it_ends_by_switching_off() -> None:
    _, outputs = run(MISSION)
    assert outputs[-1].mode is Mode.OFF
    assert outputs[-1].event == "all steps done"


def test_nothing_is_asked_before_the_planner_is_ready() -> None:
    state, output = MISSION.step(MissionState(), MissionInputs(0, planner(PlannerPhase.CONFIGURE)))
    assert (state.stage, output.mode) == (Stage.WAITING, Mode.OFF)
    state, output = MISSION.step(state, MissionInputs(0, None))
    assert (state.stage, output.mode) == (Stage.WAITING, Mode.OFF)


@pytest.mark.parametrize(
    ("inputs", "reason"),
    [
        (MissionInputs(CYCLE_NS, None), "fallen silent"),
        (MissionInputs(CYCLE_NS, planner(PlannerPhase.FAULT)), "fault"),
        (MissionInputs(CYCLE_NS, planner(PlannerPhase.IDLE), sdo_failure="abort 06090030h"), "06090030h"),
    ],
)
def test_a_failing_planner_stops_the_mission_and_says_why(inputs: MissionInputs, reason: str) -> None:
    moving = MissionState(Stage.MOVING, 0, 0, np.eye(3))
    state, output = MISSION.step(moving, inputs)
    assert state.stage is Stage.FAILED
    assert output.mode is Mode.OFF
    assert not output.twist.any()
    assert output.event is not None
    assert reason in output.event
