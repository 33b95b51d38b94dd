"""What holds for any traffic on the modelled bus."""

from __future__ import annotations

from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame, bit_length


class Request(NamedTuple):
    t_ns: int
    port: int
    can_id: int
    data: bytes


requests = st.lists(
    st.builds(
        Request,
        st.integers(0, 300).map(lambda step: step * 10_000),
        st.integers(0, 3),
        st.sampled_from([0x000, 0x080, 0x181, 0x182, 0x201, 0x601, 0x7FF]),
        st.binary(max_size=6),
    ),
    max_size=40,
)
bitrates = st.sampled_from([1_000_000, 500_000, 250_000, 125_000])


class Run(NamedTuple):
    frames: list[Frame]
    heard: list[list[Frame]]
    tagged: list[Request]
    bus: LockstepBus
    clock: LockstepClock


def run(traffic: list[Request], bitrate: int) -> Run:
    """Every request carries its number in its last two bytes, so that each can be found again."""
    clock = LockstepClock()
    bus = LockstepBus(clock, bitrate)
    frames: list[Frame] = []
    bus.observe(frames.append)
    heard: list[list[Frame]] = [[], [], [], []]
    ports = [bus.attach(str(number), None, heard[number].append) for number in range(4)]
    tagged = [r._replace(data=r.data + number.to_bytes(2, "big")) for number, r in enumerate(traffic)]
    for request in tagged:
        clock.call_at(request.t_ns, lambda r=request: ports[r.port].send(r.can_id, r.data))
    clock.run_until(1_000_000_000)
    return Run(frames, heard, tagged, bus, clock)


@given(requests, bitrates)
def test_no_frame_is_lost_doubled_or_changed(traffic, bitrate):
    result = run(traffic, bitrate)
    assert sorted((f.can_id, f.data) for f in result.frames) == sorted((r.can_id, r.data) for r in result.tagged)
    owner = {request.data: request.port for request in result.tagged}
    for port, heard in enumerate(result.heard):
        assert heard == [frame for frame in result.frames if owner[frame.data] != port]


@given(requests, bitrates)
def test_the_highest_priority_of_all_that_wait_goes_first(traffic, bitrate):
    result = run(traffic, bitrate)
    bit_ns = 1_000_000_000 // bitrate
    waiting = {request.data: (number, request) for number, request in enumerate(result.tagged)}
    for frame in result.frames:
        start_ns = frame.t_ns - (bit_length(frame.can_id, frame.data) - 3) * bit_ns
        present = [(r.can_id, r.t_ns, number, data) for data, (number, r) in waiting.items() if r.t_ns <= start_ns]
        assert min(present)[3] == frame.data  # lowest identifier; within one identifier the oldest
        del waiting[frame.data]


@given(requests, bitrates)
def test_frames_never_overlap_and_the_bus_never_rests_while_a_frame_waits(traffic, bitrate):
    result = run(traffic, bitrate)
    bit_ns = 1_000_000_000 // bitrate
    requested = {request.data: request.t_ns for request in result.tagged}
    free_ns = 0
    left = sorted(requested.values())
    for frame in result.frames:
        length_ns = bit_length(frame.can_id, frame.data) * bit_ns
        start_ns = frame.t_ns + 3 * bit_ns - length_ns
        assert start_ns == max(free_ns, left[0])
        free_ns = start_ns + length_ns
        left.remove(requested[frame.data])


@given(requests, bitrates)
def test_busy_time_is_the_sum_of_the_bits(traffic, bitrate):
    result = run(traffic, bitrate)
    statistics = result.bus.statistics()
    bits = sum(bit_length(request.can_id, request.data) for request in result.tagged)
    assert statistics.bits == bits
    assert statistics.busy_ns == bits * (1_000_000_000 // bitrate)
    assert statistics.frames == len(traffic)
    assert statistics.load_mean <= statistics.load_peak <= 1.0 or not traffic


@given(requests, bitrates)
def test_the_same_traffic_gives_the_same_frames(traffic, bitrate):
    assert run(traffic, bitrate).frames == run(traffic, bitrate).frames


@given(requests)
def test_latency_is_never_shorter_than_the_frame(traffic):
    result = run(traffic, 1_000_000)
    for can_id, latency in result.bus.statistics().latency.items():
        shortest = min(bit_length(r.can_id, r.data) for r in result.tagged if r.can_id == can_id)
        assert (shortest - 3) * 1000 <= latency.mean_ns <= latency.max_ns
        assert latency.count == sum(r.can_id == can_id for r in result.tagged)
