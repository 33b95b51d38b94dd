"""Leading one drive through the power state machine: sequences that set the controlword and wait for the statusword.

The controlword goes out with the next RPDO1, which answers each TPDO1: one transition takes one SYNC, or as many as
the drive needs. Transition numbers after CiA 402.
"""

from __future__ import annotations

from enum import IntEnum

from drivers.canopen.sdo_abort import StepError
from drivers.canopen.sequence import Sequence, Until
from drivers.cia402.axis import AxisClient
from drivers.cia402.configuration import verify_process_data
from drivers.cia402.states import State

RESET_TRIES = 3
STANDING_NS = 50_000_000


class Controlword(IntEnum):
    """Commands of the state machine; bits 4 to 6 and 8 stay 0 in the cyclic modes."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


_UP = {
    State.SWITCH_ON_DISABLED: (Controlword.SHUTDOWN, State.READY_TO_SWITCH_ON),  # 2
    State.READY_TO_SWITCH_ON: (Controlword.SWITCH_ON, State.SWITCHED_ON),  # 3
    State.SWITCHED_ON: (Controlword.ENABLE_OPERATION, State.OPERATION_ENABLED),  # 4
}
_DOWN = {
    State.OPERATION_ENABLED: (Controlword.SWITCH_ON, State.SWITCHED_ON),  # 5, with the ramp of 605Ch
    State.SWITCHED_ON: (Controlword.SHUTDOWN, State.READY_TO_SWITCH_ON),  # 6
    State.READY_TO_SWITCH_ON: (Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),  # 7
    State.QUICK_STOP_ACTIVE: (Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),  # 12
}
_FAULTY = (State.FAULT, State.FAULT_REACTION_ACTIVE)


def is_faulty(axis: AxisClient) -> bool:
    return axis.state in _FAULTY


def enable(axis: AxisClient, timeout_ns: int) -> Sequence[None]:
    """To operation enabled, each step confirmed; before it, that the PDOs still are as configured."""
    yield from verify_process_data(axis.device)
    if axis.state is State.QUICK_STOP_ACTIVE:
        yield from _leave_quick_stop(axis, timeout_ns)
    yield from _walk(axis, _UP, State.OPERATION_ENABLED, timeout_ns)


def disable(axis: AxisClient, timeout_ns: int) -> Sequence[None]:
    """To switch on disabled; `timeout_ns` has to cover the ramp."""
    yield from _walk(axis, _DOWN, State.SWITCH_ON_DISABLED, timeout_ns)
    axis.controlword = Controlword.DISABLE_VOLTAGE


def quick_stop(axis: AxisClient, timeout_ns: int, standstill_raw: float, stays: bool) -> Sequence[bool]:
    """Stops on the quick-stop ramp. True: standing under torque; False: stopped and switched off.

    `stays`: 605Ah is 5 or 6, else the drive switches off by itself. Standing: at most `standstill_raw` from SYNC to SYNC
    for `STANDING_NS`, so that swinging back is not taken for it.
    """
    axis.controlword = Controlword.QUICK_STOP
    ends = (State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED)
    yield Until(lambda: axis.state in ends, timeout_ns, "quick stop active", lambda: _shown(axis))
    moved_ns = axis.received_ns

    def stands() -> bool:
        nonlocal moved_ns
        if axis.state is not State.QUICK_STOP_ACTIVE or not stays:
            return axis.state is State.SWITCH_ON_DISABLED
        if abs(axis.position_raw - axis.previous_position_raw) > standstill_raw:
            moved_ns = axis.received_ns
        return axis.received_ns - moved_ns >= STANDING_NS

    def came() -> str:
        return f"{_shown(axis)}, {axis.position_raw - axis.previous_position_raw} position units per SYNC"

    yield Until(stands, timeout_ns, "standstill" if stays else "switch on disabled", came)
    return axis.state is State.QUICK_STOP_ACTIVE


def clear_fault(axis: AxisClient, timeout_ns: int, reaction_timeout_ns: int) -> Sequence[None]:
    """Waits for the end of the fault reaction, then fault reset by the rising edge of bit 7 (transition 15)."""
    yield Until(
        lambda: axis.state is not State.FAULT_REACTION_ACTIVE,
        reaction_timeout_ns,
        "end of the fault reaction",
        lambda: _shown(axis),
    )
    for attempt in range(1, RESET_TRIES + 1):
        if axis.state is not State.FAULT:
            break
        axis.controlword = Controlword.DISABLE_VOLTAGE
        before = axis.sent
        # two frames apart: at least one SYNC has applied the low level of bit 7
        yield Until(
            lambda sent=before: axis.sent >= sent + 2,  # type: ignore[misc]
            timeout_ns,
            "two commands with bit 7 low",
            lambda: "no feedback to answer",
        )
        axis.controlword = Controlword.FAULT_RESET
        try:
            yield Until(lambda: axis.state is not State.FAULT, timeout_ns, "fault to be gone", lambda: _shown(axis))
        except StepError:
            if attempt == RESET_TRIES:
                raise
    axis.controlword = Controlword.DISABLE_VOLTAGE


def _leave_quick_stop(axis: AxisClient, timeout_ns: int) -> Sequence[None]:
    """Transition 16 where the drive has it; else by switch on disabled."""
    axis.controlword = Controlword.ENABLE_OPERATION
    try:
        yield Until(lambda: axis.state is not State.QUICK_STOP_ACTIVE, timeout_ns, "to leave quick stop active")
    except StepError:
        axis.controlword = Controlword.DISABLE_VOLTAGE
        yield Until(
            lambda: axis.state is State.SWITCH_ON_DISABLED, timeout_ns, "switch on disabled", lambda: _shown(axis)
        )


def _walk(
    axis: AxisClient, steps: dict[State, tuple[Controlword, State]], goal: State, timeout_ns: int
) -> Sequence[None]:
    while axis.state is not goal:
        state = axis.state
        step = steps.get(state) if state is not None else None
        if step is None:
            yield Until(
                lambda: axis.state in steps or axis.state is goal,
                timeout_ns,
                f"a state on the way to {_words(goal)}",
                lambda: _shown(axis),
            )
            continue
        axis.controlword, wanted = step
        yield Until(
            lambda end=wanted: axis.state is end or axis.state in _FAULTY,  # type: ignore[misc]
            timeout_ns,
            _words(wanted),
            lambda: _shown(axis),
        )
        if axis.state in _FAULTY:
            raise StepError(_words(wanted), _shown(axis))


def _words(state: State) -> str:
    return state.name.lower().replace("_", " ")


def _shown(axis: AxisClient) -> str:
    if axis.statusword is None or axis.state is None:
        return "no statusword"
    return f"{_words(axis.state)} (statusword {axis.statusword:04X}h)"
