"""Virtual time: the order of events and what may be done to them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import LAST, LockstepClock


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(-2, 2)), max_size=30))
def test_events_come_by_time_then_priority_then_order_of_request(requests):
    clock = LockstepClock()
    seen: list[int] = []
    for number, (t_ns, priority) in enumerate(requests):
        clock.call_at(t_ns, lambda number=number: seen.append(number), priority)
    clock.run_until(10)
    assert seen == sorted(range(len(requests)), key=lambda number: (*requests[number], number))
    assert clock.now_ns() == 10


def test_time_is_that_of_the_event():
    clock = LockstepClock(100)
    seen: list[int] = []
    clock.call_at(150, lambda: seen.append(clock.now_ns()))
    clock.call_at(300, lambda: seen.append(clock.now_ns()))
    clock.run_until(200)
    assert (seen, clock.now_ns()) == ([150], 200)


def test_an_event_of_the_present_instant_still_runs_and_the_past_is_refused():
    clock = LockstepClock()
    seen: list[str] = []
    clock.call_at(5, lambda: clock.call_at(5, lambda: seen.append("same instant")))
    clock.call_at(5, lambda: seen.append("last"), LAST)
    clock.run_until(5)
    assert seen == ["same instant", "last"]
    with pytest.raises(ValueError, match="1 ns in the past"):
        clock.call_at(4, lambda: None)


def test_a_cancelled_call_never_comes():
    clock = LockstepClock()
    seen: list[str] = []
    timer = clock.call_at(5, lambda: seen.append("cancelled"))
    later = clock.call_at(6, lambda: seen.append("called"))
    timer.cancel()
    clock.run_until(10)
    later.cancel()
    assert seen == ["called"]


def test_stop_keeps_the_time_of_the_event_and_what_is_still_to_come():
    clock = LockstepClock()
    seen: list[int] = []
    clock.call_at(3, clock.stop)
    clock.call_at(4, lambda: seen.append(clock.now_ns()))
    clock.run_until(10)
    assert (seen, clock.now_ns()) == ([], 3)
    clock.run_until(10)
    assert (seen, clock.now_ns()) == ([4], 10)


def test_an_exception_passes_and_leaves_the_clock_usable():
    clock = LockstepClock()
    seen: list[int] = []

    def fail() -> None:
        raise RuntimeError("from an event")

    clock.call_at(3, fail)
    clock.call_at(4, lambda: seen.append(clock.now_ns()))
    with pytest.raises(RuntimeError, match="from an event"):
        clock.run_until(10)
    assert clock.now_ns() == 3
    clock.run_until(10)
    assert seen == [4]
