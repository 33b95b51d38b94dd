"""Signals are noted between two events; the second one goes where it went before."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from canipulator.ending import ended_by


def test_first_signal_is_noted_and_does_not_interrupt() -> None:
    called: list[int] = []
    with ended_by(signal.SIGINT, at_once=lambda: called.append(1)) as ending:
        assert ending.signal is None
        os.kill(os.getpid(), signal.SIGINT)
        assert ending.signal == signal.SIGINT
    assert called == [1]


def test_second_signal_does_what_it_did_before() -> None:
    with ended_by(signal.SIGINT) as ending:
        signal.raise_signal(signal.SIGINT)
        assert ending.signal == signal.SIGINT
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_handler_is_back_afterwards() -> None:
    before = signal.getsignal(signal.SIGINT)
    with ended_by(signal.SIGINT):
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before


def test_nothing_is_touched_outside_the_main_thread() -> None:
    before = signal.getsignal(signal.SIGINT)
    seen: list[object] = []

    def other() -> None:
        with ended_by(signal.SIGINT):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert seen == [before]


def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with ended_by(signal.SIGTERM) as ending:
            signal.raise_signal(signal.SIGTERM)
        assert ending.signal is None
    finally:
        signal.signal(signal.SIGTERM, before)
