"""Random tasks with random faults, a case for each unit; what must hold is that of `canipulator soak`."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from canipulator.campaigns.campaign import Row, Summary, unit_generator
from canipulator.campaigns.tables import Sheet, write_sheets
from canipulator.soak import minimise, random_case, run_case
from config.load import dump_scenario


@dataclass(frozen=True)
class SoakCampaign:
    """`duration_s`: cuts every case short. A case that breaks what must hold is made as small as it goes, by the worker that found it."""

    duration_s: float | None
    name: str = "soak"
    batch: int = 1
    unit_name: str = "cases"

    def groups(self, pairs: int | None) -> Mapping[str, int]:
        """So many cases, 100 by default."""
        return {"cases": 100 if pairs is None else pairs}

    def parameters(self) -> Mapping[str, Any]:
        return {"duration_s": self.duration_s}

    def warm_up(self, group: str) -> None:
        """Nothing: every run warms up by itself before its clock starts."""

    def compute(self, group: str, index: int, seed: int) -> Iterable[Row]:
        """One row; `failure`: what did not hold, `smallest`: the scenario that still shows it, as TOML."""
        case = random_case(random.Random(int(unit_generator(seed, group, index).integers(2**62))))
        if self.duration_s is not None:
            case = replace(case, duration_s=min(case.duration_s, self.duration_s))
        failure = run_case(case)
        row: Row = {
            "task": case.scenario.name,
            "kinds": " ".join(fault.kind for fault in case.scenario.fault),
            "case": case.text,
            "failure": None,
            "smallest": None,
        }
        if failure is not None:
            small, failure = minimise(case, failure)
            scenario = small.scenario.model_copy(update={"duration_s": small.duration_s, "expect": ()})
            row |= {"failure": failure.what, "smallest": dump_scenario(scenario)}
        return [row]

    def summarise(self, results: pa.Table, out: Path) -> Summary:
        """Cases and failures for each task and each kind of fault, and `soak-<unit>.toml` for each that failed. `holds`: none did."""
        rows = [row for row in results.to_pylist() if row["error"] is None]
        failed = [row for row in rows if row["failure"] is not None]
        sheet = Sheet(f"soak: {len(rows)} cases, {len(failed)} failures", ["", "cases", "failures"])
        for name in sorted({row["task"] for row in rows}):
            sheet.add(name, *(str(sum(row["task"] == name for row in among)) for among in (rows, failed)))
        for kind in sorted({kind for row in rows for kind in row["kinds"].split()}):
            sheet.add(kind, *(str(sum(kind in row["kinds"].split() for row in among)) for among in (rows, failed)))
        files = [*write_sheets([sheet], out / "summary")]
        for row in failed:
            path = out / f"soak-{row['index']}.toml"
            path.write_text(f"# {' '.join(row['failure'].split())}\n{row['smallest']}", encoding="utf-8")
            files.append(path)
        return Summary((sheet.shown(),), tuple(files), not failed)


def soak_campaign(duration_s: float | None) -> SoakCampaign:
    """Random cases, each at most `duration_s` long."""
    return SoakCampaign(duration_s)
