"""All states x all commands against the table of the standard, written down here once more from vendors' manuals."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cia402.states import (
    Command,
    Control,
    Event,
    Mode,
    State,
    Status,
    command_of,
    on_controlword,
    on_event,
    state_of,
    statusword_of,
)

S = State
# (state, bits 7 and 3…0 of the controlword) -> (transition, next state). From the command coding tables of ABB FEPL-02
# (p. 79), MovingCap "Controlword 6040h" and Toshiba VF-S15 (6.1.2): shutdown 0 x110, switch on 0 0111, disable
# voltage 0 xx0x, quick stop 0 x01x, disable operation 0 0111, enable operation 0 1111.
SHUTDOWN = [0b00110, 0b01110]
SWITCH_ON = [0b00111]
ENABLE = [0b01111]
DISABLE_VOLTAGE = [0b00000, 0b00001, 0b00100, 0b00101, 0b01000, 0b01001, 0b01100, 0b01101]
QUICK_STOP = [0b00010, 0b00011, 0b01010, 0b01011]
ROWS = [
    (2, S.SWITCH_ON_DISABLED, SHUTDOWN, S.READY_TO_SWITCH_ON),
    (3, S.READY_TO_SWITCH_ON, SWITCH_ON + ENABLE, S.SWITCHED_ON),
    (4, S.SWITCHED_ON, ENABLE, S.OPERATION_ENABLED),
    (5, S.OPERATION_ENABLED, SWITCH_ON, S.SWITCHED_ON),
    (6, S.SWITCHED_ON, SHUTDOWN, S.READY_TO_SWITCH_ON),
    (7, S.READY_TO_SWITCH_ON, DISABLE_VOLTAGE + QUICK_STOP, S.SWITCH_ON_DISABLED),
    (8, S.OPERATION_ENABLED, SHUTDOWN, S.READY_TO_SWITCH_ON),
    (9, S.OPERATION_ENABLED, DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),
    (10, S.SWITCHED_ON, DISABLE_VOLTAGE + QUICK_STOP, S.SWITCH_ON_DISABLED),
    (11, S.OPERATION_ENABLED, QUICK_STOP, S.QUICK_STOP_ACTIVE),
    (12, S.QUICK_STOP_ACTIVE, DISABLE_VOLTAGE, S.SWITCH_ON_DISABLED),
    (16, S.QUICK_STOP_ACTIVE, ENABLE, S.OPERATION_ENABLED),
]
EXPECTED = {(state, bits): (number, target) for number, state, words, target in ROWS for bits in words}


@pytest.mark.parametrize(("state", "bits"), list(itertools.product(State, range(16))))
def test_every_state_with_every_command_does_what_the_standard_says(state: State, bits: int) -> None:
    assert on_controlword(state, bits) == EXPECTED.get((state, bits))


@given(st.sampled_from(State), st.integers(0, 0xFFFF))
def test_bits_of_mode_and_manufacturer_do_not_matter(state: State, controlword: int) -> None:
    assert on_controlword(state, controlword) == on_controlword(state, controlword & 0x8F)


@given(st.sampled_from(State), st.integers(0, 0xFFFF))
def test_fault_reset_bit_never_helps_to_power_but_never_keeps_from_losing_it(state: State, controlword: int) -> None:
    plain = on_controlword(state, controlword & ~0x80)
    with_reset = on_controlword(state, controlword | 0x80)
    if plain is not None and plain.number in (2, 3, 4, 16):
        assert with_reset is None
    else:
        assert with_reset == plain


def test_fault_states_obey_no_command() -> None:
    for state in (S.NOT_READY, S.FAULT, S.FAULT_REACTION_ACTIVE):
        assert all(on_controlword(state, word) is None for word in range(256))


@pytest.mark.parametrize(
    ("state", "event", "expected"),
    [
        (S.NOT_READY, Event.INITIALISED, (1, S.SWITCH_ON_DISABLED)),
        (S.QUICK_STOP_ACTIVE, Event.QUICK_STOP_DONE, (12, S.SWITCH_ON_DISABLED)),
        (S.FAULT_REACTION_ACTIVE, Event.REACTION_DONE, (14, S.FAULT)),
        (S.FAULT, Event.FAULT_RESET, (15, S.SWITCH_ON_DISABLED)),
        (S.OPERATION_ENABLED, Event.FAULT_RESET, None),
        (S.OPERATION_ENABLED, Event.INITIALISED, None),
        (S.FAULT, Event.FAULT, None),
        (S.FAULT_REACTION_ACTIVE, Event.FAULT, None),
    ],
)
def test_events(state: State, event: Event, expected: tuple[int, State] | None) -> None:
    assert on_event(state, event) == expected


def test_fault_takes_every_other_state_to_the_reaction_and_start_begins_anew() -> None:
    for state in set(State) - {S.FAULT, S.FAULT_REACTION_ACTIVE}:
        assert on_event(state, Event.FAULT) == (13, S.FAULT_REACTION_ACTIVE)
    for state in State:
        assert on_event(state, Event.START) == (0, S.NOT_READY)


def test_every_step_that_gives_power_is_held_up_by_the_fault_reset_bit() -> None:
    for state, word in (
        (S.SWITCH_ON_DISABLED, 0x06),
        (S.READY_TO_SWITCH_ON, 0x07),
        (S.SWITCHED_ON, 0x0F),
        (S.QUICK_STOP_ACTIVE, 0x0F),
    ):
        assert on_controlword(state, word) is not None
        assert on_controlword(state, 0x80 | word) is None
    for word in (0x80, 0x82, 0x86, 0x87):
        assert on_controlword(S.OPERATION_ENABLED, word) == on_controlword(S.OPERATION_ENABLED, word & 0x7F) is not None


def test_bits_and_numbers_are_those_of_the_standard() -> None:
    """CiA 402-2, controlword 6040h (bits 0 … 3, 4, 7, 8), statusword 6041h, modes of operation 6060h; lettered as in the manuals."""
    assert [
        Control.SWITCH_ON,
        Control.ENABLE_VOLTAGE,
        Control.QUICK_STOP,
        Control.ENABLE_OPERATION,
        Control.START_HOMING,
        Control.FAULT_RESET,
        Control.HALT,
    ] == [0x0001, 0x0002, 0x0004, 0x0008, 0x0010, 0x0080, 0x0100]
    assert [Status.VOLTAGE_ENABLED, Status.WARNING, Status.REMOTE, Status.TARGET_REACHED, Status.INTERNAL_LIMIT] == [
        0x0010,
        0x0080,
        0x0200,
        0x0400,
        0x0800,
    ]
    assert {Status.FOLLOWS_TARGET, Status.HOMING_ATTAINED} == {0x1000}
    assert {Status.FOLLOWING_ERROR, Status.HOMING_ERROR} == {0x2000}
    assert [int(mode) for mode in (Mode.NONE, *list(Mode)[1:])] == [0, 6, 8, 9, 10]
    assert (Mode.HOMING, Mode.CYCLIC_POSITION, Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE) == (6, 8, 9, 10)


@pytest.mark.parametrize(
    ("words", "command"),
    [
        (SHUTDOWN, Command.SHUTDOWN),
        (SWITCH_ON, Command.SWITCH_ON),
        (ENABLE, Command.ENABLE_OPERATION),
        (DISABLE_VOLTAGE, Command.DISABLE_VOLTAGE),
        (QUICK_STOP, Command.QUICK_STOP),
    ],
)
def test_commands_are_coded_as_the_standard_says(words: list[int], command: Command) -> None:
    assert {command_of(word) for word in words} == {command}


@given(st.sampled_from(State), st.integers(0, 0xFFFF))
def test_statusword_has_the_bits_it_was_given(state: State, extra: int) -> None:
    assert statusword_of(state, extra) == state.value | extra


# Statusword patterns from the Toshiba VF-S15 manual, x = do not care, bits 6 … 0.
PATTERNS = {
    S.NOT_READY: "0xx0000",
    S.SWITCH_ON_DISABLED: "1xx0000",
    S.READY_TO_SWITCH_ON: "01x0001",
    S.SWITCHED_ON: "01x0011",
    S.OPERATION_ENABLED: "01x0111",
    S.QUICK_STOP_ACTIVE: "00x0111",
    S.FAULT_REACTION_ACTIVE: "0xx1111",
    S.FAULT: "0xx1000",
}


def matches(word: int, pattern: str) -> bool:
    return all(bit in ("x", str(word >> place & 1)) for place, bit in enumerate(reversed(pattern)))


@given(st.integers(0, 0xFFFF))
def test_statusword_is_read_with_the_masks_of_the_standard(word: int) -> None:
    expected = [state for state, pattern in PATTERNS.items() if matches(word, pattern)]
    assert [state_of(word)] == (expected or [None])


@given(st.sampled_from(State), st.integers(0, 0xFFFF))
def test_composed_statusword_shows_its_state(state: State, extra: int) -> None:
    extra &= Status.VOLTAGE_ENABLED | Status.WARNING | 0xFF00
    assert matches(statusword_of(state, extra), PATTERNS[state])


def test_way_up_is_shutdown_switch_on_enable() -> None:
    state = S.SWITCH_ON_DISABLED
    for word, expected in ((0x06, S.READY_TO_SWITCH_ON), (0x07, S.SWITCHED_ON), (0x0F, S.OPERATION_ENABLED)):
        assert command_of(word) is not None
        step = on_controlword(state, word)
        assert step is not None
        state = step.target
        assert state is expected
