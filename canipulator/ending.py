"""Signals that end a loop between two events rather than in the middle of one."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import FrameType


@dataclass(slots=True)
class Ending:
    """What the loop looks at."""

    signal: int | None = None
    """The first that came, None as long as none did."""


@contextlib.contextmanager
def ended_by(*numbers: signal.Signals, at_once: Callable[[], None] | None = None) -> Iterator[Ending]:
    """While open, the first signal of `numbers` is only noted (and `at_once` called); a second one does what it did before.

    A signal that is ignored (a script's background job and Ctrl-C) stays ignored.

    Where an event counts a frame in one place and logs it in another, no signal comes between the two. Outside the main thread,
    which alone gets signals, nothing is changed.
    """
    ending = Ending()
    if threading.current_thread() is not threading.main_thread():
        yield ending
        return

    def note(number: int, _: FrameType | None) -> None:
        ending.signal = number
        restore()
        if at_once is not None:
            at_once()

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    heard = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heard}
    try:
        yield ending
    finally:
        restore()
