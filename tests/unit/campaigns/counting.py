"""A campaign whose units take a known time and whose results are known: random walks. Also a program, so that tests can kill it."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from canipulator.campaigns.campaign import Row, Summary, unit_generator
from canipulator.campaigns.go import CampaignOptions, run_campaign


@dataclass(frozen=True)
class Walks:
    """Two groups; a unit computes for `busy_s` at least. Row: where the walk ended, and which process walked."""

    busy_s: float = 0.01
    batch: int = 5
    name: str = "walks"
    unit_name: str = "walks"

    def groups(self, pairs: int | None) -> Mapping[str, int]:
        return {"left": pairs or 20, "right": pairs or 20}

    def parameters(self) -> Mapping[str, Any]:
        return {"steps": 1000}

    def warm_up(self, group: str) -> None:
        pass

    def compute(self, group: str, index: int, seed: int) -> Iterable[Row]:
        if index == 13_013:
            raise ArithmeticError("no walk of this number")
        until = time.process_time() + self.busy_s
        end = float(unit_generator(seed, group, index).normal(size=1000).sum())
        while time.process_time() < until:
            pass
        return [{"end": end, "pid": os.getpid()}]

    def summarise(self, results: pa.Table, out: Path) -> Summary:
        return Summary((), ())


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out", type=Path)
    parser.add_argument("--pairs", type=int)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--cluster")
    parser.add_argument("--busy", type=float, default=0.01)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    options = CampaignOptions(
        given.out, given.pairs, given.jobs, given.cluster, resume=given.resume, quiet=not given.verbose
    )
    raise SystemExit(run_campaign(Walks(given.busy), options))


if __name__ == "__main__":
    main()
