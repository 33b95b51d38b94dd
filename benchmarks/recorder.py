"""What recording costs a run: its share of the wall time, in lockstep and per cycle of a loop in real time; megabytes per minute.

Run: python -m benchmarks.recorder [SECONDS [ROUNDS]]. Exit code 1 if a share is above its bound.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.load import load_scenario
from drivers.frame import Frame
from logs.detail import Detail
from logs.recorder import RunInfo
from logs.run_log import RunLog
from logs.tape import Tape
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Motion, Wire, motion

BOUNDS = {Detail.FULL: 0.15, Detail.MINIMAL: 0.05}
"""Largest share of a run's wall time."""
WAYS: tuple[Detail | None, ...] = (None, Detail.MINIMAL, Detail.FULL)


def main(seconds: float, rounds: int) -> int:
    print(f"{'one frame, alone':<24}{_one_frame_us():8.3f} µs")
    with TemporaryDirectory() as name:
        failed = _whole_runs(seconds, rounds, Path(name))
        run = motion(1000)
        wire = Wire(run)
        _paced([wire.cycle(k) for k in range(len(run.truths))], run, Path(name))
    return failed


def _whole_runs(seconds: float, rounds: int, folder: Path) -> int:
    """CPU time of the process (threads included) and wall time, from opening to closing; least of the rounds of each kind."""
    scenario = load_scenario("sliding-door")
    _timed(scenario, 1.0, None, folder / "warm")
    cpu: dict[Detail | None, list[float]] = {way: [] for way in WAYS}
    wall: dict[Detail | None, list[float]] = {way: [] for way in WAYS}
    size = {}
    for k in range(rounds):
        for way in WAYS:
            wall_s, cpu_s, mb = _timed(scenario, seconds, way, folder / f"{k}-{way}")
            wall[way].append(wall_s)
            cpu[way].append(cpu_s)
            size[way] = mb
    bare, failed = min(wall[None]), 0
    print(f"{'bare run':<24}{bare:8.2f} s of wall time, {min(cpu[None]):.2f} s of CPU for {seconds:g} s")
    for way, bound in BOUNDS.items():
        whole = min(wall[way])
        share, cpu_share = (whole - bare) / whole, 1.0 - min(cpu[None]) / min(cpu[way])
        verdict = "ok" if share <= bound else "TOO MUCH"
        failed |= share > bound
        text = (
            f"% of the wall time ({whole:.2f} s), at most {100 * bound:.0f}: {verdict}; {100 * cpu_share:.1f} % of CPU"
        )
        print(f"{'recording, ' + way.value:<24}{100 * share:8.1f} {text}, {size[way]:.1f} MB a minute")
    return failed


def _timed(scenario: object, seconds: float, way: Detail | None, folder: Path) -> tuple[float, float, float | None]:
    options = RunOptions(out=folder, duration_s=seconds, record=way is not None, detail=way or Detail.FULL, quiet=True)
    wall, cpu = time.perf_counter(), time.process_time()
    outcome = run_scenario(scenario, options)  # type: ignore[arg-type]
    return time.perf_counter() - wall, time.process_time() - cpu, outcome.metrics["recording_mb_per_minute"]


def _paced(cycles: list[list[Frame]], run: Motion, folder: Path) -> None:
    """The loop's share of each cycle while the thread writes, at five times real time, as a loop that sleeps in between."""
    log = RunLog(
        DEVICES.values(),
        "moma8",
        RunInfo("benchmark"),
        sync_period_ns=PERIOD_NS,
        recording=folder / "paced.rrd",
        event_log=folder / "events.log",
        wait=False,
        compact=False,
    )
    spent = []
    due = time.perf_counter()
    for cycle, truth in zip(cycles, run.truths, strict=True):
        due += 0.002
        time.sleep(max(0.0, due - time.perf_counter()))
        start = time.perf_counter()
        log.on_truth(truth)
        for frame in cycle:
            log.on_frame(frame)
        spent.append((time.perf_counter() - start) * 1e6)
    log.close()
    spent.sort()
    middle, high = spent[len(spent) // 2], spent[int(len(spent) * 0.99)]
    frames = sum(map(len, cycles)) // len(cycles)
    print(f"{'in a loop in real time':<24}{middle:8.1f} µs a cycle of {frames} frames (median), p99 {high:.0f} µs")
    print(f"{'':<24}{log.dropped_blocks:8d} of {log.dropped_blocks + log.written_blocks} blocks dropped")


def _one_frame_us() -> float:
    """Best of five: the tape alone, no thread running beside it."""
    best = float("inf")
    frame = Frame(0x181, bytes(8), 0)
    for _ in range(5):
        on_frame = Tape(lambda block: None).on_frame
        start = time.perf_counter()
        for _ in range(100_000):
            on_frame(frame)
        best = min(best, (time.perf_counter() - start) / 100_000)
    return best * 1e6


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else 24.0, int(sys.argv[2]) if len(sys.argv) > 2 else 3))
