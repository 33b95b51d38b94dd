"""Time that cannot be stopped: timers and frames in the order of time, lateness counted, nothing before its time."""

from __future__ import annotations

from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from drivers.realtime_clock import RealTimeClock


class Wire:
    """Frames at given times and a clock that only goes on when somebody waits, or is told to work."""

    def __init__(self, arrivals=()) -> None:
        self.present_ns = 0
        self.arrivals = deque(sorted(arrivals))
        self.taken: deque[int] = deque()
        self.asked = 0
        self.heard: list[tuple[str, int]] = []

    def now_ns(self) -> int:
        return self.present_ns

    def first_ns(self) -> int | None:
        self.asked += 1
        while self.arrivals and self.arrivals[0] <= self.present_ns:
            self.taken.append(self.arrivals.popleft())
        return self.waiting_ns()

    def waiting_ns(self) -> int | None:
        return self.taken[0] if self.taken else None

    def hand_out(self, t_ns: int) -> None:
        self.taken.popleft()
        self.heard.append(("frame", t_ns))

    def wait(self, timeout_ns: int) -> None:
        assert timeout_ns > 0, "waiting for nothing is a busy loop"
        until_ns = self.present_ns + timeout_ns
        if self.arrivals and self.arrivals[0] < until_ns:
            until_ns = max(self.arrivals[0], self.present_ns)
        self.present_ns = until_ns

    def work(self, ns: int) -> None:
        self.present_ns += ns


@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(-2, 2)), max_size=20),
    st.lists(st.integers(0, 60), max_size=20),
    st.integers(0, 40),
)
def test_events_come_in_the_order_of_their_time_however_late_the_loop_is(requests, arrivals, work):
    wire = Wire(arrivals)
    clock = RealTimeClock(wire.now_ns, wire, catch_up_ns=10**9)
    for number, (t_ns, priority) in enumerate(requests):

        def call(number=number):
            assert wire.present_ns >= requests[number][0], "before its time"
            wire.heard.append(("timer", number))
            wire.work(work)

        clock.call_at(t_ns, call, priority)
    clock.run_until(100)
    timers = [what[1] for what in wire.heard if what[0] == "timer"]
    assert timers == sorted(range(len(requests)), key=lambda number: (*requests[number], number))
    times = [requests[value][0] if kind == "timer" else value for kind, value in wire.heard]
    assert times == sorted(times)
    assert len(wire.heard) == len(requests) + len(arrivals)


def test_a_frame_that_came_in_time_is_heard_before_the_time_out_that_it_prevents():
    wire = Wire([500])
    clock = RealTimeClock(wire.now_ns, wire)
    clock.call_at(100, lambda: wire.work(10_000))  # the process is held up for longer than the time-out
    clock.call_at(1000, lambda: wire.heard.append(("time-out", 1000)))
    clock.run_until(20_000)
    assert wire.heard == [("frame", 500), ("time-out", 1000)]


def test_a_period_of_now_plus_period_keeps_its_grid():
    wire = Wire()
    clock = RealTimeClock(wire.now_ns, wire)
    seen: list[int] = []

    def cycle() -> None:
        seen.append(clock.now_ns())
        wire.work(300_000)
        clock.call_at(clock.now_ns() + 1_000_000, cycle)

    clock.call_at(1_000_000, lambda: wire.work(700_000))
    clock.call_at(1_000_000, cycle, 1)
    clock.run_until(5_500_000)
    assert seen == [1_000_000, 2_000_000, 3_000_000, 4_000_000, 5_000_000]


def test_what_is_too_late_is_told_the_present_and_counted():
    wire = Wire()
    clock = RealTimeClock(wire.now_ns, wire, catch_up_ns=2_000_000, late_ns=1_000_000)
    seen: list[int] = []
    clock.call_at(0, lambda: wire.work(30_000_000))
    for t_ns in (1_000_000, 29_500_000, 30_000_000):
        clock.call_at(t_ns, lambda: seen.append(clock.now_ns()))
    clock.run_until(40_000_000)
    assert seen[0] == 30_000_000
    assert seen == sorted(seen), "time never runs backwards"
    assert (clock.overruns, clock.max_lateness_ns) == (1, 29_000_000)
    clock.forget_lateness()
    assert (clock.overruns, clock.max_lateness_ns) == (0, 0)


def test_stop_returns_after_the_event_and_keeps_what_is_scheduled():
    wire = Wire()
    clock = RealTimeClock(wire.now_ns, wire)
    seen: list[str] = []
    clock.call_at(10, clock.stop)
    clock.call_at(20, lambda: seen.append("later"))
    clock.run_until(100)
    assert (seen, clock.now_ns()) == ([], 10)
    clock.run_until(100)
    assert seen == ["later"]


def test_a_cancelled_call_is_not_made_and_the_past_is_due_at_once():
    wire = Wire()
    wire.work(1000)
    clock = RealTimeClock(wire.now_ns, wire)
    seen: list[str] = []
    clock.call_at(2000, lambda: seen.append("cancelled")).cancel()
    clock.call_at(1, lambda: seen.append("past"))
    clock.run_until(3000)
    assert seen == ["past"]


def test_with_a_grain_nobody_is_woken_up_in_between_but_by_a_frame_and_every_timer_has_its_time():
    wire = Wire([1_234])
    clock = RealTimeClock(wire.now_ns, wire, grain_ns=1_000)
    called: list[tuple[int, int]] = []
    for due_ns in range(100, 3_000, 100):
        clock.call_at(due_ns, lambda: called.append((clock.now_ns(), wire.present_ns)))
    clock.run_until(5_000)
    assert [due_ns for due_ns, _ in called] == list(range(100, 3_000, 100))
    assert sorted({present_ns for _, present_ns in called}) == [1_000, 1_234, 2_000, 3_000]
    assert [due_ns for due_ns, present_ns in called if present_ns == 1_234] == [1_100, 1_200]
    assert clock.max_lateness_ns == 0, "late is what is later than the grain"


def test_what_has_piled_up_is_gone_through_without_asking_the_system_again():
    wire = Wire(range(1_000, 2_000, 10))
    clock = RealTimeClock(wire.now_ns, wire)
    clock.call_at(100, lambda: wire.work(5_000))
    for due_ns in range(1_000, 2_000, 7):
        clock.call_at(due_ns, lambda due_ns=due_ns: wire.heard.append(("timer", due_ns)))
    clock.run_until(4_000)
    assert [t_ns for _, t_ns in wire.heard] == sorted(t_ns for _, t_ns in wire.heard)
    assert len(wire.heard) == 100 + 143
    assert wire.asked < 6
