"""The workers of a campaign: processes here or on a Dask cluster, which may die and join at any time.

There is one way of running, Dask's `distributed`: on this machine the campaign starts a scheduler and one process for each core, on
127.0.0.1 only; with a cluster's address it uses that one's. The scheduler gives a dead worker's batches to others, and its nanny starts
it again. Only the client writes results, as they come in.
"""

from __future__ import annotations

import contextlib
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from canipulator.campaigns.campaign import Batch, Campaign, Row
from config.errors import ConfigError

ATTEMPTS = 4
"""A batch that has taken its worker with it so often does so for a reason of its own."""
QUEUED = 3
"""Batches under way for each worker: one that it computes and some that wait, so that it never does."""
CONNECT_S = 10.0
THREAD_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""A worker is one core: no library may take more."""

_ONE_AT_A_TIME = threading.Lock()
_warm: set[tuple[str, str]] = set()


@dataclass(frozen=True, slots=True)
class Finished:
    """What comes back from a worker: the rows of a batch and how long they took it, in seconds, warming up left out."""

    batch: Batch
    rows: list[Row]
    seconds: float


def compute_batch(campaign: Campaign, seed: int, batch: Batch) -> Finished:
    """Computes a batch in a worker, one at a time in each process.

    A unit that raises becomes a row that says so (column `error`); the others are not touched by it.
    """
    with _ONE_AT_A_TIME:
        _single_threaded()
        key = (f"{campaign.name} {campaign.parameters()}", batch.group)
        if key not in _warm:
            campaign.warm_up(batch.group)
            _warm.add(key)
        began = time.perf_counter()
        rows: list[Row] = []
        for index in batch.indices:
            unit: dict[str, Any] = {"group": batch.group, "index": index, "error": None}
            try:
                rows += [unit | row for row in campaign.compute(batch.group, index, seed)]
            except Exception as error:
                rows.append(unit | {"error": f"{type(error).__name__}: {error}"})
        return Finished(batch, rows, time.perf_counter() - began)


def _single_threaded() -> None:
    import numba

    numba.set_num_threads(1)


@contextlib.contextmanager
def local_cluster(jobs: int, *, host: str = "127.0.0.1", port: int = 0) -> Iterator[Any]:
    """A Dask cluster of `jobs` processes of this machine with one thread each; they end with this process, even if it is killed.

    Scheduler, workers and nannies listen at `host` alone, the status page, which cannot be turned off, at 127.0.0.1 in any case.
    """
    import dask
    from distributed import LocalCluster

    settings = {
        "distributed.scheduler.allowed-failures": ATTEMPTS,
        "distributed.worker.daemon": True,
        "distributed.admin.log-length": 0,
        "distributed.scheduler.http.routes": [],  # its status page has nothing to show that is not in the terminal
        "distributed.worker.http.routes": [],
        "distributed.nanny.pre-spawn-environ": dict.fromkeys(THREAD_LIMITS, 1),
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            processes=True,
            host=host,
            scheduler_port=port,
            dashboard_address="127.0.0.1:0",  # it listens whatever one says; here on a port that nobody else wants
            scheduler_kwargs={"dashboard": False},
            memory_limit=0,
            silence_logs="CRITICAL",
        ) as cluster,
    ):
        yield cluster


@contextlib.contextmanager
def local_workers(jobs: int) -> Iterator[Any]:
    """A client of such a cluster that only this machine can reach."""
    from distributed import Client

    with local_cluster(jobs) as cluster, Client(cluster) as client:
        yield client


@contextlib.contextmanager
def cluster_workers(address: str) -> Iterator[Any]:
    """A client of the cluster whose scheduler listens at `address`. ConfigError if nobody does."""
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_S)
    except (OSError, ValueError, TimeoutError) as error:
        raise ConfigError(f"--cluster {address}: no scheduler answers there ({error})") from None
    with client:
        yield client


def run_batches(
    client: Any, campaign: Campaign, seed: int, todo: Sequence[Batch], on_finished: Callable[[Finished], None]
) -> None:
    """Has all batches computed, in any order, and hands each to `on_finished` exactly once.

    Raises ConfigError for a batch that kills its workers again and again, and if the scheduler goes away.
    """
    from distributed import as_completed

    run, waiting, attempts = uuid.uuid4().hex[:8], iter(todo), dict.fromkeys(todo, 0)
    under_way: dict[str, Batch] = {}

    def submit(batch: Batch) -> Any:
        attempts[batch] += 1
        key = f"{campaign.name}-{run}-{batch.group}-{batch.first}-{attempts[batch]}"
        under_way[key] = batch
        return client.submit(compute_batch, campaign, seed, batch, key=key, pure=False)

    def refill(queue: Any) -> None:
        limit = QUEUED * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        while len(under_way) < limit:
            batch = next(waiting, None)
            if batch is None:
                return
            queue.add(submit(batch))

    queue = as_completed()
    refill(queue)
    while under_way:
        future = next(queue)
        batch = under_way.pop(future.key)
        if future.status == "finished":
            result = _result(future)
            if result is not None:
                on_finished(result)
            else:
                queue.add(submit(_again(batch, attempts, None)))
        elif client.status != "running":
            raise ConfigError("the scheduler has gone; --resume goes on with what is there")
        else:
            queue.add(submit(_again(batch, attempts, future.exception() if future.status == "error" else None)))
        refill(queue)


def _result(future: Any) -> Finished | None:
    """None where the worker died between finishing and handing over."""
    try:
        result = future.result()
    except Exception:
        return None
    return result if isinstance(result, Finished) else None


def _again(batch: Batch, attempts: dict[Batch, int], reason: BaseException | None) -> Batch:
    if attempts[batch] >= ATTEMPTS:
        last = batch.first + batch.count - 1
        raise ConfigError(f"units {batch.first} to {last} of {batch.group} fail on every worker: {reason!r}")
    return batch
