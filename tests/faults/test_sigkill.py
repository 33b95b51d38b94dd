"""SIGKILL at any moment: what is on the disk is whole, and lacks next to nothing."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from logs.bus_log import read_bus_log
from logs.columns import TIMELINE
from logs.optimise import optimise
from logs.viewer import is_torn

pytestmark = pytest.mark.slow

FEW, MANY = 2, 50
BUS_LOG_LACKS_S = 0.010
RECORDING_LACKS_S = 1.0


def progress_s(directory: Path) -> float:
    """Time of the last frame in bus.log."""
    try:
        with (directory / "bus.log").open("rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 200))
            lines = file.read().split(b"\n")
    except OSError:
        return 0.0
    return float(lines[-2][1:].split(b")")[0]) if len(lines) > 1 and lines[-2] else 0.0


def kill_somewhere(directory: Path, seed: int) -> float:
    """Kills a run of sliding-door at a random moment; the run's own time when it died, from a page of memory that outlives it."""
    wanted_s = random.Random(seed).uniform(0.3, 8.0)
    command = [sys.executable, "-c", _PROGRAM, str(directory), str(directory / "clock")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 300.0
        while progress_s(directory) < wanted_s:
            assert process.poll() is None, "it ended by itself"
            assert time.monotonic() < deadline
            time.sleep(0.001)
        time.sleep(random.Random(seed + 1).uniform(0.0, 0.05))
        process.send_signal(signal.SIGKILL)
        process.wait()
    return int.from_bytes((directory / "clock").read_bytes()[:8], "little") * 1e-9


_PROGRAM = """
import mmap, sys
from pathlib import Path
from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun
from config.load import load_scenario
from config.robot import load_robot
directory, clock_file = Path(sys.argv[1]), Path(sys.argv[2])
clock_file.write_bytes(bytes(8))
clock_fd = clock_file.open("r+b")
page = mmap.mmap(clock_fd.fileno(), 8)  # survives the process, costs nothing
scenario = load_scenario("sliding-door")
with LockstepRun(scenario, load_robot(scenario.robot), RunOptions(out=directory, quiet=True), directory) as run:
    step = run.sim.world.step
    def watched():
        page[:8] = run.clock.now_ns().to_bytes(8, "little")
        step()
    run.sim.world.step = watched
    run.go()
"""


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=() if seed < FEW else pytest.mark.faults) for seed in range(MANY)]
)
def test_killed_at_a_random_moment(seed: int, tmp_path: Path) -> None:
    died_s = kill_somewhere(tmp_path, seed)
    frames = list(read_bus_log(tmp_path / "bus.log"))
    assert died_s - frames[-1].t_ns * 1e-9 < BUS_LOG_LACKS_S
    recording = tmp_path / "run.rrd"
    if is_torn(recording):
        optimise(recording)  # what `canipulator view` does with it
    lacks_s = died_s - recorded_s(recording)
    assert lacks_s < RECORDING_LACKS_S
    for line in (tmp_path / "events.log").read_text(encoding="utf-8").splitlines():
        assert len(line) > 30  # whole lines only


def recorded_s(path: Path) -> float:
    """The last time in a recording, s."""
    last = 0
    for chunk in RrdReader(str(path)).stream():
        batch = None if chunk.is_static else chunk.to_record_batch()
        if batch is not None and TIMELINE in batch.schema.names and batch.num_rows:
            last = max(last, int(batch.column(TIMELINE).cast("int64").to_numpy(zero_copy_only=False).max()))
    return last * 1e-9
