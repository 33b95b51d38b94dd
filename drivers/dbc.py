"""The bus as a DBC file: frames, signals, units and names of values, for cantools, SavvyCAN and other listeners.

Written by hand rather than with cantools, which in the tests is the independent reader. Plain ASCII.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Signal:
    """One value of a frame; `start` in bits, little endian. Physical value = raw x scale, within low … high."""

    name: str
    start: int
    bits: int
    signed: bool = False
    scale: float = 1.0
    low: float = 0.0
    high: float = 0.0
    unit: str = ""
    comment: str = ""
    choices: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Message:
    """One frame; `cycle_ms` 0: not periodic."""

    can_id: int
    name: str
    length: int
    sender: str
    receivers: tuple[str, ...]
    signals: tuple[Signal, ...]
    comment: str = ""
    cycle_ms: int = 0


_HEAD = """VERSION "1.0"


NS_ :
\tCM_
\tBA_DEF_
\tBA_
\tVAL_
\tBA_DEF_DEF_

BS_:

"""

_ATTRIBUTES = """
BA_DEF_ BO_  "GenMsgCycleTime" INT 0 3600000;
BA_DEF_  "BusType" STRING ;
BA_DEF_  "Baudrate" INT 0 1000000;
BA_DEF_DEF_  "GenMsgCycleTime" 0;
BA_DEF_DEF_  "BusType" "CAN";
BA_DEF_DEF_  "Baudrate" 1000000;
"""


def dbc_text(nodes: Iterable[str], messages: Iterable[Message], comment: str) -> str:
    """The DBC file with frames in the order of their identifiers."""
    ordered = sorted(messages, key=lambda message: message.can_id)
    lines = [_HEAD + "BU_: " + " ".join(nodes), ""]
    for message in ordered:
        lines += ["", f"BO_ {message.can_id} {message.name}: {message.length} {message.sender}"]
        lines += [_signal_line(message, signal) for signal in message.signals]
    lines += ["", f'CM_ "{comment}";']
    for message in ordered:
        if message.comment:
            lines.append(f'CM_ BO_ {message.can_id} "{message.comment}";')
        lines += [f'CM_ SG_ {message.can_id} {s.name} "{s.comment}";' for s in message.signals if s.comment]
    lines.append(_ATTRIBUTES.rstrip("\n"))
    lines += [f'BA_ "GenMsgCycleTime" BO_ {m.can_id} {m.cycle_ms};' for m in ordered if m.cycle_ms]
    for message in ordered:
        lines += [_choices_line(message, signal) for signal in message.signals if signal.choices]
    return "\n".join(lines) + "\n"


def _signal_line(message: Message, signal: Signal) -> str:
    sign = "-" if signal.signed else "+"
    listeners = ",".join(message.receivers) or "Vector__XXX"
    return (
        f" SG_ {signal.name} : {signal.start}|{signal.bits}@1{sign} ({_number(signal.scale)},0)"
        f' [{_number(signal.low)}|{_number(signal.high)}] "{signal.unit}" {listeners}'
    )


def _choices_line(message: Message, signal: Signal) -> str:
    named = " ".join(f'{value} "{name}"' for value, name in sorted(signal.choices.items()))
    return f"VAL_ {message.can_id} {signal.name} {named} ;"


def _number(value: float) -> str:
    """Shortest text that reads back as the same number."""
    return str(int(value)) if value == int(value) else repr(float(value))
