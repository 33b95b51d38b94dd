"""Same seed, same bits, in any process; another seed slips otherwise; looking changes nothing."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.world import WorldParameters

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import sys, hashlib
import numpy as np
from sim.world import World, WorldParameters
from stack.kinematics.robot_file import robot_directory
world = World(robot_directory("moma8") / "robot.urdf", WorldParameters(), seed=int(sys.argv[1]))
world.plant.brake([False] * 10)
digest = hashlib.sha256()
position, velocity = np.zeros(10), np.zeros(10)
gravity = np.array([0.0, 243.3, -20.0, 0.0, 0.0, 0.0, 0.0, 0.0])
for tick in range(400):
    world.plant.read(position, velocity)
    digest.update(position.tobytes() + velocity.tobytes())
    world.plant.write(np.concatenate([[3.0, 2.0], gravity - 20.0 * velocity[2:]]))
    world.step()
truth = world.truth(0)
digest.update(truth.pose_WE.tobytes() + world.force_sensor.read().tobytes())
print(digest.hexdigest())
"""


def run_process(seed: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", SCRIPT, str(seed)], capture_output=True, text=True, cwd=ROOT, check=True, timeout=60
    )


@pytest.mark.slow
def test_processes_agree_to_the_bit_and_nothing_else_is_printed() -> None:
    first, second, other = run_process(1), run_process(1), run_process(2)
    assert first.stdout == second.stdout
    assert first.stdout != other.stdout
    assert len(first.stdout) == 65
    assert first.stderr == ""


def test_seeds_differ_by_their_slip_only(rig: Callable[..., Any]) -> None:
    def end(seed: int) -> Any:
        one = rig(WorldParameters(), seed=seed)
        for _ in range(100):
            one.cycle((3.0, 3.0))
        return one.world.truth(0)

    first, again, other = end(1), end(1), end(2)
    assert np.array_equal(first.pose_WE, again.pose_WE)
    assert not np.array_equal(first.pose_WB, other.pose_WB)
    assert not np.array_equal(first.wheel_slip, other.wheel_slip)


def test_looking_does_not_change_what_happens(rig: Callable[..., Any]) -> None:
    watched, alone = rig(WorldParameters()), rig(WorldParameters())
    for _ in range(60):
        watched.cycle((3.0, 2.0), after_tick=lambda: watched.world.truth(0))
        watched.world.physics.floor_loads()
        watched.world.force_sensor.read()
        alone.cycle((3.0, 2.0))
    assert np.array_equal(watched.position, alone.position)
    assert np.array_equal(watched.world.truth(0).pose_WE, alone.world.truth(0).pose_WE)
