"""The modelled wire: when frames arrive, who gets them, what is lost and what the statistics say."""

from __future__ import annotations

import pytest

from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame, bit_length

MS = 1_000_000


class Wire:
    """A bus with everything on it recorded, and a port that never speaks."""

    def __init__(self, bitrate: int = 1_000_000, **options) -> None:
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock, bitrate, **options)
        self.seen: list[Frame] = []
        self.bus.observe(self.seen.append)

    def port(self, name: str, can_ids=(), on_frame=lambda frame: None):
        return self.bus.attach(name, can_ids, on_frame)


def test_a_frame_arrives_at_its_end_before_the_inter_frame_space():
    wire = Wire(bitrate=500_000)
    sender = wire.port("a")
    assert sender.send(0x080, b"")
    wire.clock.run_until(MS)
    # SYNC has 51 bits with its 3 bits of inter-frame space (can-utils), 2 µs each
    assert wire.seen == [Frame(0x080, b"", 48 * 2000)]


def test_the_next_frame_starts_after_the_inter_frame_space():
    wire = Wire()
    sender = wire.port("a")
    sender.send(0x080, b"")
    sender.send(0x080, b"")
    wire.clock.run_until(MS)
    assert [frame.t_ns for frame in wire.seen] == [48_000, 51_000 + 48_000]


def test_a_request_in_the_inter_frame_space_waits_for_its_end():
    wire = Wire()
    sender = wire.port("a")
    sender.send(0x080, b"")
    wire.clock.call_at(49_000, lambda: sender.send(0x701, b"\x05"))
    wire.clock.run_until(MS)
    assert wire.seen[-1] == Frame(0x701, b"\x05", 51_000 + (58 - 3) * 1000)  # 58 bits: can-utils


def test_requests_of_one_instant_compete_whatever_their_order():
    wire = Wire()
    a, b = wire.port("a"), wire.port("b")
    wire.clock.call_at(MS, lambda: a.send(0x300, b""))
    wire.clock.call_at(MS, lambda: b.send(0x100, b""))
    wire.clock.call_at(MS, lambda: a.send(0x080, b""), priority=5)
    wire.clock.run_until(2 * MS)
    assert [frame.can_id for frame in wire.seen] == [0x080, 0x100, 0x300]


def test_a_frame_on_the_wire_is_not_interrupted():
    wire = Wire()
    a, b = wire.port("a"), wire.port("b")
    a.send(0x700, bytes(8))
    wire.clock.call_at(10_000, lambda: b.send(0x000, b""))
    wire.clock.run_until(MS)
    assert [frame.can_id for frame in wire.seen] == [0x700, 0x000]


def test_a_port_hears_what_it_asked_for_and_never_itself():
    wire = Wire()
    heard: dict[str, list[int]] = {"all": [], "some": [], "none": []}
    everything = wire.port("all", None, lambda frame: heard["all"].append(frame.can_id))
    some = wire.port("some", [0x100, 0x102], lambda frame: heard["some"].append(frame.can_id))
    wire.port("none", [], lambda frame: heard["none"].append(frame.can_id))
    for can_id in (0x100, 0x101):
        everything.send(can_id, b"")
    some.send(0x102, b"")
    wire.clock.run_until(MS)
    assert heard == {"all": [0x102], "some": [0x100], "none": []}
    assert [frame.can_id for frame in wire.seen] == [0x100, 0x101, 0x102]


def test_a_port_that_comes_late_hears_from_then_on():
    wire = Wire()
    sender = wire.port("a")
    sender.send(0x100, b"")
    wire.clock.run_until(MS)
    heard: list[Frame] = []
    wire.port("late", [0x100], heard.append)
    sender.send(0x100, b"\x01")
    wire.clock.run_until(2 * MS)
    assert [frame.data for frame in heard] == [b"\x01"]


def test_observers_come_before_the_nodes_in_the_order_of_the_wire():
    wire = Wire()
    order: list[str] = []
    wire.bus.observe(lambda frame: order.append(f"log {frame.can_id:03X}"))
    replying = wire.port("b", [0x100], lambda frame: (order.append("node"), replying.send(0x001, b"")))
    sender = wire.port("a")
    sender.send(0x100, b"")
    sender.send(0x101, b"")
    wire.clock.run_until(MS)
    assert order == ["log 100", "node", "log 001", "log 101"]


def test_a_full_queue_refuses_and_counts():
    wire = Wire(queue_limit=3)
    babbling, other = wire.port("babbling"), wire.port("other")
    assert [babbling.send(0x100, b"") for _ in range(5)] == [True, True, True, False, False]
    assert other.send(0x200, b"")
    wire.clock.run_until(MS)
    statistics = wire.bus.statistics()
    assert statistics.frames == len(wire.seen) == 4
    assert statistics.refused == {"babbling": 2, "other": 0}
    assert statistics.frames_lost == 2
    assert babbling.send(0x100, b"")  # room again


def test_a_sent_buffer_may_be_changed_afterwards():
    wire = Wire()
    buffer = bytearray(b"\x01")
    wire.port("a").send(0x100, buffer)
    buffer[0] = 2
    wire.clock.run_until(MS)
    assert wire.seen[0].data == b"\x01"


def test_latency_counts_the_waiting():
    wire = Wire()
    sender = wire.port("a")
    sender.send(0x300, bytes(8))
    sender.send(0x100, b"")
    sender.send(0x300, bytes(8))
    wire.clock.run_until(MS)
    short, long = bit_length(0x100) * 1000, bit_length(0x300, bytes(8)) * 1000
    latency = wire.bus.statistics().latency
    assert (latency[0x100].count, latency[0x100].max_ns) == (1, short - 3000)
    assert (latency[0x300].count, latency[0x300].max_ns) == (2, short + 2 * long - 3000)
    assert latency[0x300].mean_ns == (2 * short + 3 * long - 6000) / 2


def burst(bitrate: int, cycle_ns: int, cycles: int) -> Wire:
    """SYNC + 10 + 10 frames of eight bytes per cycle, the traffic of the drives."""
    wire = Wire(bitrate)
    planner = wire.port("planner")
    drives = [wire.port(f"drive {axis}") for axis in range(10)]
    for cycle in range(cycles):
        payload = bytes([0x37, 0x16, cycle & 0xFF, 0x5A, 0xFF, 0xFF, 0x21, 0x01])
        planner.send(0x080, b"")
        for axis, drive in enumerate(drives):
            planner.send(0x201 + axis, payload)
            drive.send(0x181 + axis, payload)
        wire.clock.run_until((cycle + 1) * cycle_ns)
    return wire


def test_load_of_the_drives_at_100_hz_and_one_megabit():
    statistics = burst(1_000_000, 10 * MS, 50).bus.statistics()
    # 51 + 20 x (111 … 135) bits in 10,000
    assert 0.227 <= statistics.load_mean <= 0.275
    assert statistics.load_peak == pytest.approx(statistics.load_mean, rel=0.02)
    assert statistics.frames == 21 * 50
    assert statistics.frames_lost == 0


def test_overload_at_250_kilobit_is_seen_as_loss_load_and_latency():
    calm = burst(1_000_000, 5 * MS, 100).bus.statistics()
    overloaded = burst(250_000, 5 * MS, 100).bus.statistics()
    assert calm.frames_lost == 0
    assert overloaded.load_mean > 0.99
    assert overloaded.load_peak <= 1.0
    assert overloaded.frames_lost > 100
    # the lowest identifiers still get through, the highest starve
    assert overloaded.latency[0x080].max_ns < 2 * MS
    assert max(entry.max_ns for entry in overloaded.latency.values()) > 20 * MS


def test_an_idle_bus_has_no_load_and_peaks_are_of_whole_windows():
    wire = Wire(load_window_ns=10 * MS)
    sender = wire.port("a")
    assert wire.bus.statistics().load_mean == wire.bus.statistics().load_peak == 0.0
    wire.clock.run_until(10 * MS)
    for _ in range(40):
        sender.send(0x100, bytes(8))
    wire.clock.run_until(100 * MS)
    statistics = wire.bus.statistics()
    busy = 40 * bit_length(0x100, bytes(8)) * 1000
    assert statistics.busy_ns == busy
    assert statistics.load_mean == busy / (100 * MS)
    assert statistics.load_peak == busy / (10 * MS)


def test_a_frame_over_the_border_of_two_windows_is_split():
    wire = Wire(load_window_ns=100_000)
    sender = wire.port("a")
    wire.clock.call_at(80_000, lambda: sender.send(0x080, b""))  # 51 µs: 20 in the first window, 31 in the second
    wire.clock.run_until(MS)
    assert wire.bus.statistics().load_peak == 0.31


@pytest.mark.parametrize("bitrate", [0, -1, 3_000_000, 300_007])
def test_a_bit_rate_that_is_none_is_refused(bitrate):
    with pytest.raises(ValueError, match=f"bitrate {bitrate}"):
        LockstepBus(LockstepClock(), bitrate)


def test_what_is_no_frame_and_a_name_that_is_taken_are_refused():
    wire = Wire()
    port = wire.port("a")
    with pytest.raises(ValueError, match="11 bits"):
        port.send(0x800, b"")
    with pytest.raises(ValueError, match="at most 8"):
        port.send(0x100, bytes(9))
    with pytest.raises(ValueError, match="'a' is taken"):
        wire.port("a")
    with pytest.raises(ValueError, match="queue_limit 0"):
        LockstepBus(LockstepClock(), queue_limit=0)
