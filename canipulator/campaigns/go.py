"""One campaign from start to summary, going on with what an earlier one left behind."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from canipulator.campaigns.campaign import Campaign
from canipulator.campaigns.store import Store
from canipulator.campaigns.workers import Finished, cluster_workers, local_workers, run_batches
from canipulator.outcome import EXPECTATION_MISSED, OK, progress_bar

LEAST_BATCHES = 8
"""Batches for each core at least, so that none waits long for the last ones of a small campaign."""
FILE_WIDTH = 150
"""Characters in a line where the output is no terminal: tables unbroken."""


@dataclass(frozen=True)
class CampaignOptions:
    """`pairs`: units of each group; `jobs`: processes here; `cluster`: a scheduler's address instead of them."""

    out: Path
    pairs: int | None = None
    jobs: int | None = None
    cluster: str | None = None
    seed: int = 1
    resume: bool = False
    quiet: bool = False


@dataclass
class Tally:
    """What was done this time, and how fast: `busy_s` is the workers' time inside units."""

    workers: int = 0
    units: int = 0
    busy_s: float = 0.0
    wall_s: float = 0.0

    def line(self, unit_name: str) -> str:
        """One line for people."""
        if not self.units:
            return f"nothing left to compute: every one of the {unit_name} was there"
        per_core = self.units / self.busy_s if self.busy_s else float("inf")
        return (
            f"{self.units} {unit_name} in {self.wall_s:.1f} s: {self.units / self.wall_s:.3g} per second, "
            f"{per_core:.3g} per second and core (workers busy {100 * self.busy_s / (self.wall_s * self.workers):.0f} %)"
        )


def run_campaign(campaign: Campaign, options: CampaignOptions) -> int:
    """Computes what is missing, then merges and sums up; the exit code.

    Whatever ends it, every batch that was reported as done is on disk. Raises ConfigError and OSError as `Store` and `run_batches` do.
    """
    groups = campaign.groups(options.pairs)
    with Store(options.out, campaign, options.seed, resume=options.resume) as store:
        tally = _compute(campaign, options, store, groups)
        results = store.results(groups)
        failed = results.num_rows - results["error"].null_count
        summary = campaign.summarise(results, options.out)
        (options.out / "throughput.json").write_text(json.dumps(vars(tally)), encoding="utf-8")
    if not options.quiet:
        console = Console()
        if not console.is_terminal:
            console = Console(width=FILE_WIDTH)
        for shown in summary.shown:
            console.print(shown)
        console.print(tally.line(campaign.unit_name), highlight=False)
        if failed:
            first = next(error for error in results["error"].to_pylist() if error is not None)
            console.print(f"{failed} of {results.num_rows} rows failed, the first one: {first}", highlight=False)
        names = ", ".join(["results.parquet", *(path.name for path in summary.files)])
        console.print(f"files      {options.out}/  ({names})", highlight=False)
    return EXPECTATION_MISSED if failed or summary.holds is False else OK


def _compute(campaign: Campaign, options: CampaignOptions, store: Store, groups: Mapping[str, int]) -> Tally:
    total, cores = sum(groups.values()), options.jobs or os.cpu_count() or 1
    share = math.ceil(total / (LEAST_BATCHES * cores))
    todo, tally = store.missing(groups, min(campaign.batch, share)), Tally()
    if not todo:
        return tally
    done = total - sum(batch.count for batch in todo)
    jobs = min(cores, len(todo))
    workers = local_workers(jobs) if options.cluster is None else cluster_workers(options.cluster)
    with workers as client, progress_bar(campaign.name, total, quiet=options.quiet) as advance:

        def on_finished(finished: Finished) -> None:
            store.keep(finished.batch, finished.rows)
            tally.units += finished.batch.count
            tally.busy_s += finished.seconds
            rate = tally.units / (time.perf_counter() - began)
            here = done + tally.units
            left = (total - here) / rate
            advance(here, f"{here} of {total} {campaign.unit_name}, {rate:.3g}/s, {_clock(left)} left")

        advance(done, f"{done} of {total} {campaign.unit_name}")
        began = time.perf_counter()
        run_batches(client, campaign, options.seed, todo, on_finished)
        tally.wall_s = time.perf_counter() - began
        tally.workers = max(1, _worker_count(client))
    return tally


def _worker_count(client: Any) -> int:
    return len(client.scheduler_info(n_workers=-1)["workers"])


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}"
