"""What a tick costs: `python benchmarks/physics.py`.

Compares the bare stepSimulation of the robot in motion with whole ticks (plants, servo loops, encoders, and truth at
100 Hz). Both are timed in turns within the same run, so that a busy machine disturbs them alike: trust the ratio.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from sim.world import World, WorldParameters
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.servo import AxisMode, Servo, load_servo_parameters

ROBOT = "moma8"
PERIOD_S, TICKS = 0.01, 10


class Bench:
    """The robot drives a curve while all joints move; every tick is split at the physics step."""

    def __init__(self) -> None:
        self.arm = ArmModel.load(ROBOT)
        self.world = World(robot_directory(ROBOT) / "robot.urdf", WorldParameters())
        self.servo = Servo(load_servo_parameters(ROBOT), 1e-3)
        self.mode = np.array([AxisMode.VELOCITY] * 2 + [AxisMode.POSITION] * 8, dtype=np.int64)
        self.position, self.velocity, self.output = np.zeros(10), np.zeros(10), np.zeros(10)
        self.flags = np.zeros(10, dtype=np.int64)
        self.physics_ns: list[int] = []
        self.cycle = 0
        self.world.plant.read(self.position, self.velocity)
        off = np.zeros(10, dtype=np.int64)
        self.servo.tick(off, self.position, self.velocity, self.output, self.flags)
        self.home = self.position[2:].copy()
        self.world.plant.brake([False] * 10)
        self.world.physics_step = self._timed(self.world.physics.step)

    def _timed(self, step):  # type: ignore[no-untyped-def]
        def timed() -> None:
            start = time.perf_counter_ns()
            step()
            self.physics_ns.append(time.perf_counter_ns() - start)

        return timed

    def run_cycle(self) -> int:
        """One arm cycle; ns for its ticks, without computing the targets."""
        self.cycle += 1
        t = self.cycle * PERIOD_S
        grow = min(t, 1.0)
        q = self.home + 0.1 * grow * np.sin(2.0 * t) * np.array([1, 0.2, 1, 1, 1, 1, 1, 1])
        target, offset = np.concatenate([[2.0 * grow, 3.0 * grow], q]), np.zeros(10)
        offset[2:] = self.arm.gravity(q)
        received = np.ones(10, dtype=np.bool_)
        start = time.perf_counter_ns()
        self.servo.accept(self.mode, received, target, offset, PERIOD_S)
        for _ in range(TICKS):
            self.servo.tick(self.mode, self.position, self.velocity, self.output, self.flags)
            self.world.plant.write(self.output)
            self.world.step()
            self.world.plant.read(self.position, self.velocity)
        self.world.truth(0)
        return time.perf_counter_ns() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    seconds = parser.parse_args().seconds
    bench = Bench()
    whole_ns = np.array([bench.run_cycle() for _ in range(round(seconds / PERIOD_S))]) / TICKS
    physics_ns = np.array(bench.physics_ns).reshape(-1, TICKS).mean(axis=1)
    for name, values in (("physics step", physics_ns), ("whole tick", whole_ns), ("difference", whole_ns - physics_ns)):
        low, middle, high = np.percentile(values, [10, 50, 90]) / 1e3
        print(f"{name:13s} {middle:7.1f} us   (p10 {low:.1f}, p90 {high:.1f})")
    print(f"whole tick / physics step = {np.median(whole_ns) / np.median(physics_ns):.2f}")
    print(f"real-time factor: physics {1e6 / physics_ns.mean():.1f}, whole tick {1e6 / whole_ns.mean():.1f}")


if __name__ == "__main__":
    main()
