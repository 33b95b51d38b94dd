"""SDO requests leave one by one, in order, none lost, and never closer than the gap."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.pacer import Pacer
from drivers.clock import LockstepClock


@given(st.lists(st.integers(0, 5_000), min_size=1, max_size=40), st.integers(1, 3_000), st.sets(st.integers(0, 60)))
def test_order_and_gap(waits: list[int], gap_ns: int, refusals: set[int]) -> None:
    clock, sent, offers = LockstepClock(), [], []

    def send(can_id: int, data: bytes) -> bool:
        offers.append(clock.now_ns())
        # the first offer is answered to the caller, who would repeat it; later ones are the pacer's to repeat
        if len(offers) - 1 in refusals and len(offers) > 1 and pacer._waiting:
            return False
        sent.append((clock.now_ns(), data))
        return True

    pacer = Pacer(send, clock, gap_ns)
    at = 0
    for i, wait in enumerate(waits):
        at += wait
        clock.call_at(at, lambda i=i: pacer.send(0x600, bytes((i,))))
    clock.run_until(at + 200 * gap_ns)
    assert [data[0] for _, data in sent] == list(range(len(waits)))
    assert all(b - a >= gap_ns for a, b in pairwise(offers))


def test_no_gap_passes_everything_at_once() -> None:
    clock, sent = LockstepClock(), []
    pacer = Pacer(lambda can_id, data: sent.append(data) is None, clock, 0)
    assert all(pacer.send(0x601, bytes((i,))) for i in range(5))
    assert len(sent) == 5
