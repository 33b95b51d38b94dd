"""What a frame costs: length, bus, codec, log. Run: python -m benchmarks.bus"""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from drivers.bus.lockstep import LockstepBus
from drivers.catalogue import devices
from drivers.clock import LockstepClock
from drivers.codec import TWIST
from drivers.drive_codec import DriveCodec
from drivers.frame import Frame, bit_length
from logs.bus_log import BusLogWriter
from stack.messages import TwistCommand

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


def encoded_frames() -> int:
    message = TwistCommand(np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6]), 7)
    for _ in range(1000):
        TWIST.encode(message)
    return 2000


def decoded_frames() -> int:
    assembler = TWIST.assembler()
    frames, _ = TWIST.encode(TwistCommand(np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6]), 7))
    for _ in range(1000):
        for can_id, data in frames:
            assembler.feed(can_id, data)
    return 2000


def set_points() -> int:
    codec = DriveCodec(devices()[21])
    for _ in range(10_000):
        codec.encode_set_point(0x0F, 1.2345, -6.789)
    return 10_000


def feedbacks() -> int:
    codec = DriveCodec(devices()[21])
    data = bytes.fromhex("371680a90300f401")
    for _ in range(10_000):
        codec.decode_feedback(data)
    return 10_000


def logged_frames() -> int:
    frames = [Frame(0x181, payload, i * 130_000) for i, payload in enumerate(PAYLOADS * 10)]
    with TemporaryDirectory() as folder, BusLogWriter(Path(folder) / "bus.log") as writer:
        for frame in frames:
            writer(frame)
    return len(frames)


ROWS: tuple[tuple[str, Callable[[], int], float], ...] = (
    ("bit_length", frame_lengths, 1.0),
    ("lockstep, request to delivery", lockstep_frames, 6.0),
    ("fast frame, encode", encoded_frames, 3.0),
    ("fast frame, decode", decoded_frames, 3.0),
    ("drive set point, encode", set_points, 3.0),
    ("drive feedback, decode", feedbacks, 3.0),
    ("bus log", logged_frames, 2.0),
)


def main() -> None:
    for name, work, goal in ROWS:
        print(f"{name:32s} {microseconds(work):5.2f} µs/frame   (goal {goal:.0f})")


if __name__ == "__main__":
    main()
