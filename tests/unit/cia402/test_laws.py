"""Whatever a master does, in whatever order: no torque without power, no speed beyond the limits, no number that is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.cia402.states import State, state_of
from stack.servo.state import AxisMode
from tests.unit.cia402.rig import MS, Master, Rig

JOINT = 25
POWERED = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE, State.NOT_READY)
# pairs (allowed next states), from the diagram of the standard; a SYNC may bring several transitions
NEIGHBOURS = {
    State.NOT_READY: {State.SWITCH_ON_DISABLED},
    State.SWITCH_ON_DISABLED: {State.READY_TO_SWITCH_ON},
    State.READY_TO_SWITCH_ON: {State.SWITCHED_ON, State.SWITCH_ON_DISABLED, State.OPERATION_ENABLED},
    State.SWITCHED_ON: {State.OPERATION_ENABLED, State.READY_TO_SWITCH_ON, State.SWITCH_ON_DISABLED},
    State.OPERATION_ENABLED: {
        State.SWITCHED_ON,
        State.READY_TO_SWITCH_ON,
        State.SWITCH_ON_DISABLED,
        State.QUICK_STOP_ACTIVE,
    },
    State.QUICK_STOP_ACTIVE: {State.SWITCH_ON_DISABLED, State.OPERATION_ENABLED},
    State.FAULT_REACTION_ACTIVE: {State.FAULT},
    State.FAULT: {State.SWITCH_ON_DISABLED},
}

actions = st.one_of(
    st.tuples(st.just("word"), st.sampled_from([0x00, 0x02, 0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x1F, 0x80, 0x8F, 0x10F])),
    st.tuples(st.just("word"), st.integers(0, 0xFFFF)),
    st.tuples(st.just("target"), st.integers(-(1 << 31), (1 << 31) - 1)),
    st.tuples(st.just("offset"), st.integers(-(1 << 15), (1 << 15) - 1)),
    st.tuples(st.just("mode"), st.sampled_from([0, 6, 8, 9, 10])),
    st.tuples(st.just("nmt"), st.sampled_from([1, 1, 2, 128, 129, 130])),
    st.tuples(st.just("alive"), st.booleans()),
    st.tuples(st.just("rpdo"), st.booleans()),
    st.tuples(st.just("blocked"), st.booleans()),
    st.tuples(st.just("option"), st.sampled_from([0, 1, 2, 5, 6])),
)


def act(rig: Rig, master: Master, name: str, value: int) -> None:
    if name == "word":
        master.word[JOINT] = value
    elif name == "target":
        master.target[JOINT] = value
    elif name == "offset":
        master.offset[JOINT] = value
    elif name == "mode":
        master.port.send(0x600 + JOINT, bytes((0x2F, 0x60, 0x60, 0, value, 0, 0, 0)))
    elif name == "option":
        master.port.send(0x600 + JOINT, bytes((0x2B, 0x5A, 0x60, 0, value, 0, 0, 0)))
    elif name == "nmt":
        master.port.send(0x000, bytes((value, JOINT)))
    elif name == "alive":
        master.alive = bool(value)
    elif name == "rpdo":
        master.sends_rpdo = bool(value)
    else:
        rig.plant.blocked[0] = bool(value)


@pytest.mark.slow
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(actions, st.integers(1, 45)), min_size=1, max_size=30))
def test_no_history_of_commands_breaks_the_drive(script: list[tuple[tuple[str, int], int]]) -> None:
    rig = Rig(JOINT)
    master = Master(rig)
    master.enable()
    drive, bank = rig.drive, rig.bank
    set_velocity = 0.0
    for (name, value), ticks in script:
        act(rig, master, name, value)
        for _ in range(ticks):
            before = drive.state
            rig.run(MS)
            assert np.all(np.isfinite(rig.plant.command))
            assert abs(rig.plant.command[0]) <= 200.0 + 1e-9
            if drive.state not in POWERED:
                assert bank.mode[0] == AxisMode.OFF
                assert rig.plant.command[0] == 0.0
            assert (
                drive.state is before
                or before in POWERED
                or drive.state
                in NEIGHBOURS[before]
                | {
                    State.NOT_READY,
                    State.FAULT,
                    State.FAULT_REACTION_ACTIVE,
                }
            )
            if bank.mode[0] in (AxisMode.POSITION, AxisMode.VELOCITY):
                velocity = float(bank.servo.state.set_velocity[0])
                assert abs(velocity) <= max(1.5, abs(set_velocity)) + 1e-6
            set_velocity = float(bank.servo.state.set_velocity[0])
            shown = state_of(drive.statusword())
            assert shown is drive.state
    master.alive = False
    rig.run(1_500 * MS)
    assert abs(rig.plant.velocity[0]) < 0.02 or bank.mode[0] == AxisMode.OFF
