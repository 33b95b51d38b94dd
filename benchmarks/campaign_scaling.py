"""How a campaign scales: the same pairs with 1, 2 and 4 workers, more than once; prints the efficiency against linear.

What the machine itself has to give is measured in the same run: as many processes with nothing between them that each solve their share
(cores that are hyper-threads, a clock that sinks, a neighbour's load). A campaign is judged against that: "as far as the cores go".

The wall clock runs from the first batch handed out to the last one written. Starting the processes, their imports and compiled code
(a warm-up unit of every robot in each worker) come before. Every worker is one process with one thread.

    python -m benchmarks.campaign_scaling [--pairs 200] [--workers 1 2 4] [--repeats 2]
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import tempfile
import time
from multiprocessing.synchronize import Barrier
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

from canipulator.campaigns.beck import beck_campaign  # noqa: E402
from canipulator.campaigns.campaign import Batch, Campaign  # noqa: E402
from canipulator.campaigns.store import Store  # noqa: E402
from canipulator.campaigns.workers import Finished, compute_batch, local_workers, run_batches  # noqa: E402

ALLOWED = 0.15
"""How far below linear."""
WARM_UP_SEED = 2**61


def measure(campaign: Campaign, pairs: int, batch: int, workers: int) -> tuple[float, float]:
    """(wall, time in units summed over the workers), s."""
    groups, busy = campaign.groups(pairs), 0.0
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder), campaign, 1, resume=False) as store:
        todo = store.missing(groups, batch)
        with local_workers(workers) as client:
            client.wait_for_workers(workers)
            for group in groups:
                client.run(compute_batch, campaign, WARM_UP_SEED, Batch(group, 0, 1))

            def on_finished(finished: Finished) -> None:
                nonlocal busy
                store.keep(finished.batch, finished.rows)
                busy += finished.seconds

            began = time.perf_counter()
            run_batches(client, campaign, 1, todo, on_finished)
            return time.perf_counter() - began, busy


def _solve_alone(barrier: Barrier, batches: list[Batch]) -> None:
    campaign = beck_campaign(None)
    for group in campaign.groups(1):
        compute_batch(campaign, WARM_UP_SEED, Batch(group, 0, 1))
    barrier.wait()
    for batch in batches:
        compute_batch(campaign, 1, batch)
    barrier.wait()


def measure_alone(campaign: Campaign, pairs: int, batch: int, processes: int) -> float:
    """Wall (s) of the same pairs in `processes` of their own, dealt out beforehand, one batch in turn to each."""
    batches = [
        Batch(group, start, min(batch, count - start))
        for group, count in campaign.groups(pairs).items()
        for start in range(0, count, batch)
    ]
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(processes + 1)
    workers = [context.Process(target=_solve_alone, args=(barrier, batches[i::processes])) for i in range(processes)]
    for worker in workers:
        worker.start()
    barrier.wait()
    began = time.perf_counter()
    barrier.wait()
    wall = time.perf_counter() - began
    for worker in workers:
        worker.join()
    return wall


def main() -> int:
    """Exit code 1 if a number of workers that the machine has cores for is more than `ALLOWED` below linear."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=200, help="for each robot")
    parser.add_argument("--batch", type=int, default=10)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--repeats", type=int, default=2)
    given = parser.parse_args()
    campaign, cores = beck_campaign(None), len(os.sched_getaffinity(0))
    units = sum(campaign.groups(given.pairs).values())
    print(f"{units} pairs, batches of {given.batch}, {cores} cores, load before {os.getloadavg()[0]:.1f}", flush=True)
    walls: dict[int, list[float]] = {workers: [] for workers in given.workers}
    alone: dict[int, list[float]] = {workers: [] for workers in given.workers}
    for repeat in range(given.repeats):  # in turn, so that a busy machine does not hit one number of workers alone
        for workers in given.workers:
            alone[workers].append(measure_alone(campaign, given.pairs, given.batch, workers))
            wall, busy = measure(campaign, given.pairs, given.batch, workers)
            walls[workers].append(wall)
            print(
                f"repeat {repeat + 1}, {workers} workers: {wall:7.2f} s, {units / wall:6.2f} pairs/s, "
                f"{units / busy:6.2f} per second of a worker's work, outside units {100 * (1 - busy / (wall * workers)):4.1f} %",
                flush=True,
            )
    fewest = min(given.workers)
    base, short = statistics.median(walls[fewest]) * fewest, False
    bare = statistics.median(alone[fewest]) * fewest
    for workers, taken in walls.items():
        efficiency = base / (workers * statistics.median(taken))
        machine = bare / (workers * statistics.median(alone[workers]))
        too_low = efficiency < (1.0 - ALLOWED) * min(1.0, machine) and workers <= cores
        short |= too_low
        verdict = "too low" if too_low else "ok" if workers <= cores else "more workers than cores: not judged"
        print(
            f"{workers} workers: {100 * efficiency:5.1f} % of linear, processes alone {100 * machine:5.1f} %: "
            f"{100 * efficiency / machine:5.1f} % of what the cores give  {verdict}",
            flush=True,
        )
    return 1 if short else 0


if __name__ == "__main__":
    raise SystemExit(main())
