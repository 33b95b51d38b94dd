"""What listening costs: the loop's share per frame and cycle, the thread's per second of run, megabytes per minute.

Run: python -m benchmarks.recorder [SECONDS]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.frame import Frame
from logs.run_log import RunInfo, RunLog
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Wire, motion


def main(seconds: int) -> None:
    run = motion(seconds * 100)
    wire = Wire(run)
    cycles = [wire.cycle(k) for k in range(len(run.truths))]
    frames = sum(len(cycle) for cycle in cycles)
    nothing: list[Frame] = []
    listening = _feed(cycles, run.truths, nothing.append, lambda truth: None)
    with TemporaryDirectory() as name:
        folder = Path(name)
        for title, recording in (("table only", None), ("table and recording", folder / "run.rrd")):
            cpu = time.process_time()
            log = RunLog(
                DEVICES.values(),
                "moma8",
                RunInfo("benchmark"),
                sync_period_ns=PERIOD_NS,
                recording=recording,
                event_log=folder / "events.log",
                wait=False,
                compact=False,
            )
            fed = _feed(cycles, run.truths, log.on_frame, log.on_truth)
            log.close()
            cpu = time.process_time() - cpu
            print(f"{title:<24}{cpu / seconds * 1e3:8.1f} ms of CPU per second of run")
            if recording is not None:
                _loop_cost(log, fed, listening, frames, len(cycles))
                size = recording.stat().st_size
                print(f"{'recording':<24}{size / 1e6 / seconds * 60:8.1f} MB a minute, {log.dropped_blocks} blocks dropped")
    print(f"{'one frame, alone':<24}{_one_frame_us():8.3f} µs")


def _feed(cycles, truths, on_frame, on_truth) -> list[float]:  # type: ignore[no-untyped-def]
    """Seconds that each cycle's frames and truth took, at the pace of one cycle a millisecond."""
    spent = []
    due = time.perf_counter()
    for cycle, truth in zip(cycles, truths, strict=True):
        due += 0.001
        while time.perf_counter() < due:
            pass
        start = time.perf_counter()
        on_truth(truth)
        for frame in cycle:
            on_frame(frame)
        spent.append(time.perf_counter() - start)
    return sorted(spent)


def _loop_cost(log: RunLog, fed: list[float], alone: list[float], frames: int, cycles: int) -> None:
    middle, high = fed[len(fed) // 2] - alone[len(alone) // 2], fed[int(len(fed) * 0.99)]
    print(f"{'in the loop':<24}{middle * 1e6:8.1f} µs a cycle of {frames // cycles} frames (median), p99 {high * 1e6:.0f} µs")


def _one_frame_us() -> float:
    """Best of five: the tape alone, no thread running beside it."""
    from logs.tape import Tape

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
