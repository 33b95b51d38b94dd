"""What the drives cost: a bank's tick without physics, and one drive's share of a SYNC (RPDO in, state machine, TPDO out).

.venv/bin/python benchmarks/drives.py
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterable

import numpy as np

from drivers.bus.base import OnFrame
from drivers.catalogue import DRIVE_IDS, devices
from drivers.cia402.bank import DriveBank
from drivers.cia402.device import Drive
from drivers.cia402.states import State
from drivers.clock import LockstepClock
from drivers.frame import Frame
from stack.messages import Vector
from stack.servo.state import ServoParameters

TICK_NS, SYNC_NS = 1_000_000, 10_000_000
TICK_BUDGET_US, SYNC_BUDGET_US = 25.0, 10.0
ROUNDS, CYCLES = 7, 400


class StillPlant:
    """Encoders that show where the axes were put; no physics."""

    def __init__(self, position: Vector) -> None:
        self.position = position

    def read(self, position: Vector, velocity: Vector) -> None:
        position[:] = self.position

    def write(self, command: Vector) -> None:
        pass


class NullBus:
    """Takes every frame at no cost; `hear` hands one to the nodes."""

    def __init__(self) -> None:
        self.sent = 0
        self._routes: dict[int, list[OnFrame]] = {}

    def attach(self, name: str, can_ids: Iterable[int] | None, on_frame: OnFrame) -> NullBus:
        for can_id in can_ids or ():
            self._routes.setdefault(can_id, []).append(on_frame)
        return self

    def observe(self, on_frame: OnFrame) -> None:
        raise AssertionError("the drives of this benchmark observe nothing")

    def send(self, can_id: int, data: bytes) -> bool:
        self.sent += 1
        return True

    def hear(self, frame: Frame) -> None:
        for on_frame in self._routes.get(frame.can_id, ()):
            on_frame(frame)


def servo_parameters(count: int) -> ServoParameters:
    def every(value: float) -> Vector:
        return np.full(count, value)

    wheels = np.arange(count) < 2
    return ServoParameters(
        every(20.0), every(50.0), every(100.0), every(30.0), every(1.0), every(-3.0), every(3.0), every(1.5),
        every(6.0), every(12.0), every(100.0), wheels,
    )  # fmt: skip


def best_us(run: Callable[[], object], repeats: int) -> float:
    """Shortest mean of several rounds, in µs per call."""
    means = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        for _ in range(repeats):
            run()
        means.append((time.perf_counter() - begin) / repeats * 1e6)
    return min(means)


def main() -> None:
    clock, bus = LockstepClock(), NullBus()
    plant = StillPlant(np.array([0.0, 0.0, 0.1, 0.7, *(0.1 * i for i in range(6))]))
    bank = DriveBank(servo_parameters(len(DRIVE_IDS)), plant)
    drives = [Drive(devices()[node_id], clock, bus, bank, axis) for axis, node_id in enumerate(DRIVE_IDS)]
    for drive in drives:
        drive.power_on()
    bus.hear(Frame(0x000, b"\x01\x00"))
    bank.tick(0)
    frames = {
        word: [
            Frame(0x200 + node_id, struct.pack("<Hih", word, round(plant.position[axis] * 1e6) if axis > 1 else 0, 0))
            for axis, node_id in enumerate(DRIVE_IDS)
        ]
        for word in (0x06, 0x07, 0x0F)
    }
    sync = Frame(0x080)
    now_ns = 0

    def cycle(word: int = 0x0F) -> None:
        for frame in frames[word]:
            bus.hear(frame)
        bus.hear(sync)

    def with_ticks(word: int = 0x0F) -> None:
        nonlocal now_ns
        cycle(word)
        for _ in range(SYNC_NS // TICK_NS):
            now_ns += TICK_NS
            clock.run_until(now_ns)
            bank.tick(now_ns)

    for word in (0x06, 0x07, 0x0F, 0x0F):
        with_ticks(word)
    assert all(drive.state is State.OPERATION_ENABLED for drive in drives), [drive.state for drive in drives]
    sent = bus.sent
    with_ticks()
    assert bus.sent - sent in (10, 20), "one TPDO per drive and SYNC, two in every tenth"

    both = best_us(with_ticks, CYCLES)
    tick = best_us(lambda: bank.tick(now_ns), 10 * CYCLES)
    sync_us = best_us(cycle, CYCLES) / len(drives)
    assert all(drive.state is State.OPERATION_ENABLED for drive in drives)
    print(f"bank tick, 10 axes, no physics     {tick:6.1f} µs   (budget {TICK_BUDGET_US:g})")
    print(f"per drive and SYNC, bus excluded   {sync_us:6.1f} µs   (budget {SYNC_BUDGET_US:g})")
    print(f"10 drives, one 10 ms cycle         {both:6.1f} µs")
    print(f"TPDOs sent                         {bus.sent}")


if __name__ == "__main__":
    main()
