"""The finite state automaton of a CiA 402 drive as a table: controlword in, state and statusword out, nothing kept.

Transitions 0 to 16 as numbered by CiA 402 (IEC 61800-7-201). Where vendors differ: bit 7 of the controlword is fault
reset in FAULT; in any other state it holds up the commands that lead to power (2, 3, 4, 16), not those that take it away.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import Final, NamedTuple


class State(Enum):
    """States; the value is what the statusword shows under `STATUS_MASK` (see `state_of`)."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


class Command(Enum):
    """What bits 0 to 3 of the controlword mean; SWITCH_ON is DISABLE OPERATION to an enabled drive."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on, disable operation"
    ENABLE_OPERATION = "enable operation"
    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"


class Event(Enum):
    """What happens inside the drive."""

    START = "power-on or reset"
    INITIALISED = "self-test done"
    FAULT = "a fault has been found"
    REACTION_DONE = "fault reaction completed"
    QUICK_STOP_DONE = "quick stop completed, option code 0 to 4"
    FAULT_RESET = "rising edge of controlword bit 7"


class Control:
    """Bits of the controlword 6040h. Plain integers: these are looked at in every SYNC."""

    SWITCH_ON: Final = 1 << 0
    ENABLE_VOLTAGE: Final = 1 << 1
    QUICK_STOP: Final = 1 << 2
    """0 stops."""
    ENABLE_OPERATION: Final = 1 << 3
    START_HOMING: Final = 1 << 4
    FAULT_RESET: Final = 1 << 7
    HALT: Final = 1 << 8


class Status:
    """Bits of the statusword 6041h that do not show the state."""

    VOLTAGE_ENABLED: Final = 1 << 4
    WARNING: Final = 1 << 7
    REMOTE: Final = 1 << 9
    TARGET_REACHED: Final = 1 << 10
    INTERNAL_LIMIT: Final = 1 << 11
    FOLLOWS_TARGET: Final = 1 << 12
    HOMING_ATTAINED: Final = 1 << 12
    FOLLOWING_ERROR: Final = 1 << 13
    HOMING_ERROR: Final = 1 << 13


class Mode(IntEnum):
    """Modes of operation 6060h that are in use."""

    NONE = 0
    HOMING = 6
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


class Transition(NamedTuple):
    """Number after CiA 402, and where it leads."""

    number: int
    target: State


_S = State
_C = Command

COMMANDS: dict[tuple[State, Command], Transition] = {
    (_S.SWITCH_ON_DISABLED, _C.SHUTDOWN): Transition(2, _S.READY_TO_SWITCH_ON),
    (_S.READY_TO_SWITCH_ON, _C.SWITCH_ON): Transition(3, _S.SWITCHED_ON),
    (_S.READY_TO_SWITCH_ON, _C.ENABLE_OPERATION): Transition(3, _S.SWITCHED_ON),
    (_S.SWITCHED_ON, _C.ENABLE_OPERATION): Transition(4, _S.OPERATION_ENABLED),
    (_S.OPERATION_ENABLED, _C.SWITCH_ON): Transition(5, _S.SWITCHED_ON),
    (_S.SWITCHED_ON, _C.SHUTDOWN): Transition(6, _S.READY_TO_SWITCH_ON),
    (_S.READY_TO_SWITCH_ON, _C.DISABLE_VOLTAGE): Transition(7, _S.SWITCH_ON_DISABLED),
    (_S.READY_TO_SWITCH_ON, _C.QUICK_STOP): Transition(7, _S.SWITCH_ON_DISABLED),
    (_S.OPERATION_ENABLED, _C.SHUTDOWN): Transition(8, _S.READY_TO_SWITCH_ON),
    (_S.OPERATION_ENABLED, _C.DISABLE_VOLTAGE): Transition(9, _S.SWITCH_ON_DISABLED),
    (_S.SWITCHED_ON, _C.DISABLE_VOLTAGE): Transition(10, _S.SWITCH_ON_DISABLED),
    (_S.SWITCHED_ON, _C.QUICK_STOP): Transition(10, _S.SWITCH_ON_DISABLED),
    (_S.OPERATION_ENABLED, _C.QUICK_STOP): Transition(11, _S.QUICK_STOP_ACTIVE),
    (_S.QUICK_STOP_ACTIVE, _C.DISABLE_VOLTAGE): Transition(12, _S.SWITCH_ON_DISABLED),
    (_S.QUICK_STOP_ACTIVE, _C.ENABLE_OPERATION): Transition(16, _S.OPERATION_ENABLED),
}
"""What a command does in a state; a pair that is not here changes nothing."""

_EVENTS: dict[tuple[State, Event], Transition] = {
    (_S.NOT_READY, Event.INITIALISED): Transition(1, _S.SWITCH_ON_DISABLED),
    (_S.QUICK_STOP_ACTIVE, Event.QUICK_STOP_DONE): Transition(12, _S.SWITCH_ON_DISABLED),
    (_S.FAULT_REACTION_ACTIVE, Event.REACTION_DONE): Transition(14, _S.FAULT),
    (_S.FAULT, Event.FAULT_RESET): Transition(15, _S.SWITCH_ON_DISABLED),
}
_GIVING_POWER = (2, 3, 4, 16)


def command_of(controlword: int) -> Command:
    """The command in bits 0 to 3 (CiA 402, command coding)."""
    if not controlword & Control.ENABLE_VOLTAGE:
        return Command.DISABLE_VOLTAGE
    if not controlword & Control.QUICK_STOP:
        return Command.QUICK_STOP
    if not controlword & Control.SWITCH_ON:
        return Command.SHUTDOWN
    return Command.ENABLE_OPERATION if controlword & Control.ENABLE_OPERATION else Command.SWITCH_ON


def on_controlword(state: State, controlword: int) -> Transition | None:
    """One step that `controlword` causes in `state`; None: it stays. Enabling from READY_TO_SWITCH_ON takes two steps."""
    found = COMMANDS.get((state, command_of(controlword)))
    if found is not None and controlword & Control.FAULT_RESET and found.number in _GIVING_POWER:
        return None
    return found


def on_event(state: State, event: Event) -> Transition | None:
    """The transition that `event` causes in `state`; None: it stays."""
    if event is Event.START:
        return Transition(0, State.NOT_READY)
    if event is Event.FAULT and state not in (State.FAULT, State.FAULT_REACTION_ACTIVE):
        return Transition(13, State.FAULT_REACTION_ACTIVE)
    return _EVENTS.get((state, event))


def state_of(statusword: int) -> State | None:
    """The state that a statusword shows: masks 4Fh and 6Fh of CiA 402. None for a pattern that means nothing."""
    return _STATE_OF[statusword & 0x6F]


def statusword_of(state: State, status: int) -> int:
    """Statusword of `state` with the bits of `status` (class Status) besides."""
    return state.value | status


def _decode(low_bits: int) -> State | None:
    for state in State:
        # bit 5 (quick stop) does not count where no power is on: 0x4F; elsewhere it does: 0x6F
        ignores_bit_5 = state in (
            State.NOT_READY,
            State.SWITCH_ON_DISABLED,
            State.FAULT,
            State.FAULT_REACTION_ACTIVE,
        )
        if low_bits & (0x4F if ignores_bit_5 else 0x6F) == state.value:
            return state
    return None


_STATE_OF = tuple(_decode(low_bits) for low_bits in range(0x70))
