"""Time that is skipped rather than waited for: nothing may change by it but the cost."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame


class Stepwise(LockstepClock):
    """A clock that has every event scheduled."""

    def skip_to(self, t_ns: int) -> bool:
        return False


def _traffic(clock: LockstepClock, requests: list[tuple[int, int, int]], answers: dict[int, int]) -> list[Frame]:
    """Frames on the wire: requests (µs, identifier, length) of one port, and answers (identifier to identifier) of another."""
    bus = LockstepBus(clock)
    seen: list[Frame] = []
    bus.observe(seen.append)
    port = bus.attach("asks", (), lambda frame: None)

    def answer(frame: Frame) -> None:
        if frame.can_id in answers:
            other.send(answers[frame.can_id], frame.data)

    other = bus.attach("answers", None, answer)
    for t_us, can_id, length in requests:
        clock.call_at(t_us * 1000, lambda can_id=can_id, length=length: port.send(can_id, bytes(length)))
    clock.run_until(2_000_000)
    clock.run_until(50_000_000)
    return seen


@given(
    st.lists(st.tuples(st.integers(0, 2500), st.integers(1, 20), st.integers(0, 8)), max_size=40),
    st.dictionaries(st.integers(1, 20), st.integers(21, 40), max_size=10),
)
def test_the_wire_is_the_same_with_and_without_skipping(requests, answers):
    assert _traffic(LockstepClock(), requests, answers) == _traffic(Stepwise(), requests, answers)


def test_time_is_not_skipped_over_an_event_nor_beyond_the_end_of_the_run_nor_after_a_stop():
    clock = LockstepClock()
    skipped: list[tuple[bool, int]] = []

    def skip(t_ns: int) -> None:
        skipped.append((clock.skip_to(t_ns), clock.now_ns()))

    clock.call_at(10, lambda: [skip(19), skip(20)])
    clock.call_at(20, lambda: [skip(31), skip(30), clock.stop(), skip(30)])
    clock.run_until(30)
    skip(40)
    assert skipped == [(True, 19), (False, 19), (False, 20), (True, 30), (False, 30), (False, 30)]
