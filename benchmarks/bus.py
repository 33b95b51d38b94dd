"""What a frame costs: length, request + arbitration + delivery to one subscriber. Run: python -m benchmarks.bus"""

from __future__ import annotations

import random
import time
from collections.abc import Callable

from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame, bit_length

PAYLOADS = [random.Random(i).randbytes(8) for i in range(1000)]


def microseconds(work: Callable[[], int]) -> float:
    """Best of five, per unit of work; `work` returns how many units it did."""
    best = float("inf")
    for _ in range(5):
        start = time.perf_counter()
        done = work()
        best = min(best, (time.perf_counter() - start) / done)
    return best * 1e6


def lockstep_frames() -> int:
    """1000 cycles of SYNC + 10 + 10 frames at 100 Hz on 1 Mbit/s, each frame heard by one node."""
    clock = LockstepClock()
    bus = LockstepBus(clock)
    heard: list[Frame] = []
    drives = bus.attach("drives", [0x80, *range(0x201, 0x20B)], heard.append)
    planner = bus.attach("planner", range(0x181, 0x18B), heard.append)
    payload = random.Random(1).randbytes(8)
    for cycle in range(1000):
        planner.send(0x80, b"")
        for axis in range(10):
            planner.send(0x201 + axis, payload)
            drives.send(0x181 + axis, payload)
        clock.run_until((cycle + 1) * 10_000_000)
    assert len(heard) == 21_000
    return 21_000


def frame_lengths() -> int:
    for payload in PAYLOADS:
        bit_length(0x181, payload)
    return len(PAYLOADS)


def main() -> None:
    bit_length(0x80)
    print(f"bit_length                     {microseconds(frame_lengths):5.2f} µs/frame")
    print(f"lockstep request to delivery   {microseconds(lockstep_frames):5.2f} µs/frame")


if __name__ == "__main__":
    main()
