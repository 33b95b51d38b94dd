"""What the force sensor does not take for a measurement, on the wire of its node."""

from __future__ import annotations

import math

import numpy as np
import pytest

from config.robot import load_robot
from drivers.bus.lockstep import LockstepBus
from drivers.catalogue import FORCE_SENSOR_ID
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.sensor_node import ForceSensorNode
from stack.messages import Vector

MS = 1_000_000
FORCE, EMCY = 0x180 + FORCE_SENSOR_ID, 0x080 + FORCE_SENSOR_ID
RESET = bytes(8)


class Bench:
    """The node on a bus with SYNC every 10 ms; `reads` is what it measures."""

    def __init__(self, *, flickers: bool) -> None:
        self.clock = LockstepClock()
        bus = LockstepBus(self.clock)
        self.heard: list[Frame] = []
        bus.observe(self.heard.append)
        self.port = bus.attach("master", [], lambda frame: None)
        self.reads: Vector = np.zeros(6)
        device = load_robot("moma8").devices[FORCE_SENSOR_ID]
        node = ForceSensorNode(device, self.clock, bus, lambda: self.reads.copy(), flickers=flickers)
        node.node.power_on()
        self.clock.run_until(20 * MS)
        self.port.send(0x000, b"\x01\x00")
        self.clock.run_until(40 * MS)
        self.heard.clear()

    def sync(self, reads: Vector) -> list[int]:
        """Identifiers of what the node says to one SYNC."""
        before, self.reads = len(self.heard), reads
        self.port.send(0x080, b"")
        self.clock.run_until(self.clock.now_ns() + 10 * MS)
        return [frame.can_id for frame in self.heard[before:] if frame.can_id in (FORCE, EMCY)]

    def emergencies(self) -> list[bytes]:
        return [frame.data for frame in self.heard if frame.can_id == EMCY]


PULL = np.array([3.0, -1.0, 0.5, 0.1, 0.0, -0.2])


def test_the_fifth_reading_without_any_change_is_none() -> None:
    bench = Bench(flickers=True)
    assert [bench.sync(PULL) for _ in range(4)] == [[FORCE]] * 4
    assert [bench.sync(PULL) for _ in range(3)] == [[EMCY], [], []]
    assert bench.sync(PULL + 1e-9) == [EMCY, FORCE]
    assert [data[:2].hex() for data in bench.emergencies()] == ["0073", "0000"]


def test_noise_of_any_size_is_a_change() -> None:
    bench, random = Bench(flickers=True), np.random.default_rng(3)
    assert all(bench.sync(PULL + 1e-6 * random.standard_normal(6)) == [FORCE] for _ in range(50))


def test_a_sensor_without_noise_may_show_the_same_for_ever() -> None:
    bench = Bench(flickers=False)
    assert all(bench.sync(PULL) == [FORCE] for _ in range(20))


@pytest.mark.parametrize("bad", [math.nan, math.inf, 327.67, -400.0])
def test_what_is_no_number_or_beyond_its_range_is_not_sent(bad: float) -> None:
    bench = Bench(flickers=True)
    assert bench.sync(PULL) == [FORCE]
    assert bench.sync(np.where(np.arange(6) == 1, bad, PULL)) == [EMCY]
    assert bench.sync(PULL)[-1] == FORCE
    assert bench.emergencies()[-1] == RESET
