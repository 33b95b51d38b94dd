"""What listening costs: the loop's share per frame and cycle, the thread's per second of run, megabytes per minute.

Run: python -m benchmarks.recorder [SECONDS]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.frame import Frame
from logs.recorder import RunInfo
from logs.run_log import RunLog
from logs.tape import Tape
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Motion, Wire, motion


def main(seconds: int) -> None:
    run = motion(seconds * 100)
    wire = Wire(run)
    cycles = [wire.cycle(k) for k in range(len(run.truths))]
    frames = sum(len(cycle) for cycle in cycles)
    print(f"{'one frame, alone':<24}{_one_frame_us():8.3f} µs")
    with TemporaryDirectory() as name:
        for title, recording in (("table only", None), ("table and recording", Path(name) / "run.rrd")):
            log = _log(Path(name), recording, wait=True)
            start = time.process_time()
            for cycle, truth in zip(cycles, run.truths, strict=True):
                log.on_truth(truth)
                for frame in cycle:
                    log.on_frame(frame)
            log.close()
            spent = (time.process_time() - start) / seconds
            print(f"{title:<24}{spent * 1e3:8.1f} ms of CPU per second of run")
        print(f"{'recording':<24}{(Path(name) / 'run.rrd').stat().st_size / 1e6 / seconds * 60:8.1f} MB a minute")
        _paced(cycles, run, frames, Path(name))


def _log(folder: Path, recording: Path | None, *, wait: bool) -> RunLog:
    return RunLog(
        DEVICES.values(),
        "moma8",
        RunInfo("benchmark"),
        sync_period_ns=PERIOD_NS,
        recording=recording,
        event_log=folder / "events.log",
        wait=wait,
        compact=False,
    )


def _paced(cycles: list[list[Frame]], run: Motion, frames: int, folder: Path) -> None:
    """The loop's share of each cycle while the thread writes, at five times real time, as a loop that sleeps in between."""
    log = _log(folder, folder / "paced.rrd", wait=False)
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
    print(f"{'in the loop':<24}{middle:8.1f} µs a cycle of {frames // len(cycles)} frames (median), p99 {high:.0f} µs")
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
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
