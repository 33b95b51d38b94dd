"""What the whole stack costs beside the bare physics: `python -m benchmarks.stack [SECONDS]`.

A lockstep run of the sliding-door scenario in turns with bare stepSimulation calls of the same robot in motion, so that a busy machine
disturbs both alike: trust the ratios. Beside each arm cycle of the run NumPy takes the SVD of an arm Jacobian of the same shape.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.physics import Bench
from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario

SCENARIO = "sliding-door"
MOVING_NS = 2_500_000_000
"""From here on the drives are enabled and the robot moves."""
CHUNK_NS, PERIOD_NS, TICK_NS = 100_000_000, 10_000_000, 1_000_000
SVD_AT_NS = 7_000_000
"""After each SYNC; the planner is done by then, and its caches are as cold as they were for it."""
REAL_TIME_GOAL, CYCLE_GOAL = 0.5, 4.0


@dataclass
class Stopwatch:
    """Sums up what calls take."""

    spent_ns: int = 0
    calls: list[int] = field(default_factory=list)

    def around(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            began = time.perf_counter_ns()
            result = call(*arguments)
            self.calls.append(time.perf_counter_ns() - began)
            return result

        return timed

    @property
    def mean_us(self) -> float:
        return float(np.mean(self.calls)) * 1e-3


class Measurement:
    """One run with stop watches in it."""

    def __init__(self, scenario: Scenario, folder: Path, *, record: bool) -> None:
        robot = load_robot(scenario.robot)
        self.run = LockstepRun(scenario, robot, RunOptions(folder, record=record, quiet=True), folder)
        self.step, self.bank, self.svd = Stopwatch(), Stopwatch(), Stopwatch()
        self.wall_ns: list[int] = []
        self.bare_ns: list[int] = []
        self.jacobian = robot.arm.end_point_jacobian(robot.arm.home)

    def go(self, seconds: float) -> None:
        run, bare = self.run, Bench()
        run.power_on()
        run.clock.run_until(MOVING_NS)
        world, bank = run.sim.world, run.sim.bank
        world.step = self.step.around(world.step)  # type: ignore[method-assign]
        bank.tick = self.bank.around(bank.tick)  # type: ignore[method-assign]
        run.clock.call_at(MOVING_NS + SVD_AT_NS, self._decompose)
        self.first_cycle, self.physics_s, self.frames = len(run.planner.cycle_ns), run.physics_s, self._frames()
        for end_ns in range(MOVING_NS + CHUNK_NS, MOVING_NS + round(seconds * 1e9), CHUNK_NS):
            began = time.perf_counter_ns()
            run.clock.run_until(end_ns)
            self.wall_ns.append(time.perf_counter_ns() - began)
            for _ in range(CHUNK_NS // PERIOD_NS // 2):
                bare.run_cycle()
            self.bare_ns.append(int(np.mean(bare.physics_ns)) * (CHUNK_NS // TICK_NS))
            bare.physics_ns.clear()
        bare.world.close()

    def _frames(self) -> int:
        return self.run.bus.statistics().frames

    def _decompose(self) -> None:
        self.svd.around(np.linalg.svd)(self.jacobian)
        self.run.clock.call_at(self.run.clock.now_ns() + PERIOD_NS, self._decompose)

    def report(self) -> None:
        """Medians over the chunks of 100 ms; shares are means over all of them."""
        wall, bare = np.array(self.wall_ns), np.array(self.bare_ns)
        ratio = float(np.median(bare / wall))
        print(f"  real-time factor   stack {CHUNK_NS / np.median(wall):5.1f}   bare {CHUNK_NS / np.median(bare):5.1f}")
        print(f"  stack / bare       {ratio:5.2f}   (goal {REAL_TIME_GOAL:g})")
        cycle = np.array(self.run.planner.cycle_ns[self.first_cycle :]) * 1e-3
        svd = np.array(self.svd.calls) * 1e-3
        for name, values in (("arm cycle", cycle), ("SVD 6x8, NumPy", svd)):
            print(f"  {name:16s} {np.median(values):7.1f} µs median, {np.percentile(values, 99):7.1f} p99")
        print(f"  arm cycle / SVD    {np.median(cycle) / np.median(svd):5.2f}   (goal {CYCLE_GOAL:g})")
        self._shares(float(cycle.sum()))

    def _shares(self, cycles_us: float) -> None:
        ticks, chunks = len(self.step.calls), len(self.wall_ns)
        frames = self._frames() - self.frames
        physics_us = (self.run.physics_s - self.physics_s) * 1e6
        total_us = sum(self.wall_ns) * 1e-3
        step_us, bank_us = sum(self.step.calls) * 1e-3, sum(self.bank.calls) * 1e-3
        rest_us = total_us - step_us - bank_us - cycles_us
        print(
            f"  per tick           {physics_us / ticks:5.1f} µs stepSimulation, {(step_us - physics_us) / ticks:5.1f} µs plants",
            end="",
        )
        print(f" and sensors, {bank_us / ticks:5.1f} µs drive loops")
        print(
            f"  per frame          {rest_us / frames:5.1f} µs bus, nodes and logs ({frames / chunks / 10:.0f} frames a cycle)"
        )


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    scenario = load_scenario(SCENARIO)
    for title, record in (("without recording", False), ("with recording", True)):
        print(f"{title}:")
        with TemporaryDirectory() as name:
            measurement = Measurement(scenario, Path(name), record=record)
            gc.disable()
            try:
                with measurement.run:
                    measurement.go(seconds)
                    measurement.report()
            finally:
                gc.enable()


if __name__ == "__main__":
    main()
