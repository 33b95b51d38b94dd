"""A stranger on the bus, in mid-motion: frames at random, and frames that are almost right. Nobody raises, nothing runs away."""

from __future__ import annotations

import gc
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from canipulator.roles import planner_role, simulated_robot, strategic_role
from config.robot import load_robot
from drivers.bus.lockstep import LockstepBus
from drivers.clock import LockstepClock
from drivers.frame import Frame
from tests.faults.harness import scenario_with

pytestmark = pytest.mark.slow

BEGIN_NS, GAP_NS, PAGE = 2_000_000_000, 300_000, 4096
MANY, FEW = 100_000, 6_000
Stranger = Callable[[random.Random, dict[int, bytes]], tuple[int, bytes]]


def anything(draw: random.Random, _: dict[int, bytes]) -> tuple[int, bytes]:
    return draw.randrange(0x800), draw.randbytes(draw.randrange(9))


def almost_right(draw: random.Random, heard: dict[int, bytes]) -> tuple[int, bytes]:
    """A frame that was on the wire just now with one to three bits turned over, cut or longer, or other data under its identifier."""
    can_id = draw.choice(list(heard))
    data = bytearray(heard[can_id])
    how = draw.randrange(10)
    if how < 6 and data:
        for _ in range(draw.randrange(1, 4)):
            data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif how < 8:
        data = data[: draw.randrange(len(data) + 1)] if draw.random() < 0.5 else (data + draw.randbytes(8))[:8]
    else:
        data = bytearray(draw.randbytes(len(data)))
    return can_id, bytes(data)


def resident() -> int:
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


@pytest.mark.parametrize("stranger", [anything, almost_right])
@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.faults)])
def test_a_stranger_on_the_bus(stranger: Stranger, count: int) -> None:
    scenario = scenario_with("drive-square", [])  # no logs here: what grows is what the nodes keep
    robot, clock = load_robot(scenario.robot), LockstepClock()
    bus = LockstepBus(clock, scenario.bus.bitrate, queue_limit=scenario.bus.queue_frames)
    sim = simulated_robot(robot, scenario, clock, bus)
    planner = planner_role(robot, scenario, clock, bus, lambda *_: None)
    strategic = strategic_role(robot, scenario, clock, bus, lambda *_: None)
    draw, heard, left = random.Random(20), {}, [count]
    port = bus.attach("stranger", [], lambda frame: None)

    def listen(frame: Frame) -> None:
        heard[frame.can_id] = frame.data

    def send() -> None:
        if left[0]:
            left[0] -= 1
            port.send(*stranger(draw, heard))
            clock.call_at(clock.now_ns() + GAP_NS, send)

    bus.observe(listen)
    clock.call_at(BEGIN_NS, send)
    fastest, physics, step = np.zeros(8), sim.world.physics, sim.world.step

    def watched() -> None:
        step()
        np.maximum(fastest, np.abs(physics.dq), out=fastest)

    sim.world.step = watched  # type: ignore[method-assign]
    sim.power_on()
    strategic.node.power_on()
    planner.power_on()
    try:
        clock.run_until(BEGIN_NS + count * GAP_NS // 3)
        before = resident()
        clock.run_until(BEGIN_NS + count * GAP_NS + 1_500_000_000)
        grown = resident() - before
        assert left == [0]
        assert (
            fastest / robot.arm.dq_max
        ).max() < 1.1  # whatever was injected, no joint got faster than its drive lets it
        assert np.all(physics.q > robot.arm.q_min - 1e-3)
        assert np.all(physics.q < robot.arm.q_max + 1e-3)
        assert np.isfinite(physics.q).all()
        assert grown < 8e6
    finally:
        sim.world.close()
