"""The one place for injected faults: what each verdict does to a frame and to everybody's books."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.interception import Verdict
from drivers.bus.lockstep import ERROR_FRAME_BITS, LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame, bit_length

MS = 1_000_000


class Faulty:
    """Two ports on a bus whose frames are judged by a list of verdicts, one after the other, then None."""

    def __init__(self, *verdicts: Verdict | None) -> None:
        self.judged: list[tuple[str, int]] = []
        self._verdicts = list(verdicts)
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock, intercept=self._judge)
        self.seen: list[Frame] = []
        self.heard: list[Frame] = []
        self.bus.observe(self.seen.append)
        self.a = self.bus.attach("a", [], lambda frame: None)
        self.b = self.bus.attach("b", None, self.heard.append)

    def _judge(self, sender: str, frame: Frame) -> Verdict | None:
        self.judged.append((sender, frame.can_id))
        return self._verdicts.pop(0) if self._verdicts else None


def test_every_frame_is_judged_once_with_its_sender():
    wire = Faulty()
    wire.a.send(0x100, b"")
    wire.b.send(0x200, b"")
    wire.clock.run_until(MS)
    assert wire.judged == [("a", 0x100), ("b", 0x200)]
    assert [frame.can_id for frame in wire.seen] == [0x100, 0x200]


def test_a_dropped_frame_takes_its_time_and_reaches_nobody():
    wire = Faulty(Verdict(drop=True))
    wire.a.send(0x100, b"")
    wire.a.send(0x101, b"")
    wire.clock.run_until(MS)
    assert [frame.can_id for frame in wire.heard] == [frame.can_id for frame in wire.seen] == [0x101]
    assert wire.heard[0].t_ns == (bit_length(0x100) + bit_length(0x101) - 3) * 1000
    statistics = wire.bus.statistics()
    assert (statistics.frames, statistics.dropped["a"], statistics.frames_lost) == (1, 1, 1)
    assert wire.a.queued == 0


def test_a_delayed_frame_is_overtaken():
    wire = Faulty(Verdict(delay_ns=MS))
    wire.a.send(0x100, b"\x01")
    wire.a.send(0x101, b"")
    wire.clock.run_until(2 * MS)
    assert [frame.can_id for frame in wire.heard] == [0x101, 0x100]
    assert wire.heard[1] == Frame(0x100, b"\x01", MS + (bit_length(0x100, b"\x01") - 3) * 1000)
    assert wire.bus.statistics().latency[0x100].max_ns == wire.heard[1].t_ns


def test_a_changed_payload_reaches_everybody():
    wire = Faulty(Verdict(data=b"\xff"))
    wire.a.send(0x100, b"\x00")
    wire.clock.run_until(MS)
    assert [frame.data for frame in wire.heard] == [frame.data for frame in wire.seen] == [b"\xff"]


def test_after_an_error_on_the_wire_the_frame_is_repeated():
    wire = Faulty(Verdict(wire_error=True))
    wire.a.send(0x100, b"")
    wire.a.send(0x100, b"\x01")
    wire.clock.run_until(MS)
    assert [frame.data for frame in wire.heard] == [b"", b"\x01"]
    assert wire.heard[0].t_ns == (2 * bit_length(0x100) + ERROR_FRAME_BITS - 3) * 1000
    statistics = wire.bus.statistics()
    assert (statistics.error_frames, statistics.frames_lost) == (1, 0)
    assert statistics.busy_ns == 1000 * (2 * bit_length(0x100) + bit_length(0x100, b"\x01") + ERROR_FRAME_BITS)


def test_a_port_that_is_bus_off_is_deaf_and_dumb_until_it_is_back():
    wire = Faulty(Verdict(bus_off=True))
    wire.b.send(0x100, b"")
    wire.b.send(0x101, b"")
    wire.b.send(0x102, b"")
    wire.clock.run_until(MS)
    assert [frame.can_id for frame in wire.seen] == [0x100]  # the one with the verdict was still sent
    assert wire.b.send(0x103, b"") is False
    wire.a.send(0x200, b"")
    wire.clock.run_until(2 * MS)
    assert wire.heard == []
    statistics = wire.bus.statistics()
    assert (statistics.dropped["b"], statistics.refused["b"], statistics.frames_lost) == (2, 1, 3)
    wire.bus.reconnect("b")
    wire.a.send(0x201, b"")
    assert wire.b.send(0x104, b"")
    wire.clock.run_until(3 * MS)
    assert [frame.can_id for frame in wire.heard] == [0x201]
    assert [frame.can_id for frame in wire.seen] == [0x100, 0x200, 0x104, 0x201]


def test_a_cable_cut_in_mid_frame_spoils_that_frame_only():
    wire = Faulty()
    wire.a.send(0x100, bytes(8))
    wire.b.send(0x300, b"")
    wire.clock.call_at(50_000, lambda: wire.bus.disconnect("a"))
    wire.clock.run_until(MS)
    assert [frame.can_id for frame in wire.seen] == [0x300]
    assert wire.bus.statistics().dropped == {"a": 1, "b": 0}
    assert wire.a.queued == 0


def test_disconnecting_the_only_sender_before_its_frame_starts_leaves_the_bus_usable():
    wire = Faulty()
    wire.a.send(0x100, b"")
    wire.bus.disconnect("a")
    wire.clock.run_until(MS)
    wire.b.send(0x200, b"")
    wire.clock.run_until(2 * MS)
    assert [frame.can_id for frame in wire.seen] == [0x200]


def test_a_queue_that_was_lost_with_its_port_is_empty_afterwards():
    clock = LockstepClock()
    bus = LockstepBus(clock, queue_limit=2)
    port = bus.attach("a", [], lambda frame: None)
    assert [port.send(0x100, b"") for _ in range(3)] == [True, True, False]
    bus.disconnect("a")
    bus.reconnect("a")
    assert [port.send(0x100, b"") for _ in range(3)] == [True, True, False]


@given(st.permutations(range(12)), st.sets(st.integers(0, 11)))
def test_what_others_have_queued_keeps_its_order_when_a_port_goes(identifiers, of_the_lost):
    wire = Faulty()
    for can_id in identifiers:
        (wire.b if can_id in of_the_lost else wire.a).send(can_id, b"")
    wire.bus.disconnect("b")
    wire.clock.run_until(2 * MS)
    assert [frame.can_id for frame in wire.seen] == [i for i in range(12) if i not in of_the_lost]


def test_a_frame_without_acknowledgement_is_sent_twice_and_judged_once():
    wire = Faulty(Verdict(repeat=True))
    wire.a.send(0x100, b"\x07")
    wire.a.send(0x101, b"")
    wire.clock.run_until(MS)
    assert [frame.can_id for frame in wire.heard] == [0x100, 0x100, 0x101]
    assert wire.heard[1].t_ns - wire.heard[0].t_ns == bit_length(0x100, b"\x07") * 1000
    assert wire.judged == [("a", 0x100), ("a", 0x101)]
    assert wire.a.queued == 0
