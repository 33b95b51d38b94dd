"""Campaigns of whole runs in physics and over the bus: the sliding door under slip, and with each method in each case of preferences."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from canipulator.campaigns.campaign import Row, Summary, unit_generator
from canipulator.campaigns.run_tables import Measure, summarise_runs
from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.load import load_scenario
from config.scenario import Scenario

SCENARIO = "sliding-door"
SLIP_PERCENT = range(6)
COORDINATIONS = ("abc", "unified", "arm-only")
METHODS = ("pns", "fsp", "gradient", "qp")
CASES = range(1, 5)
ERRORS = (
    Measure("tcp_error_rms_m", "TCP error rms (mm)", 1e3),
    Measure("tcp_error_p99_m", "p99 (mm)", 1e3),
    Measure("tcp_error_max_m", "max (mm)", 1e3),
)
DEXTERITY = (
    Measure("min_manipulability_arm", "least manipulability, arm", 1.0),
    Measure("min_manipulability_robot", "robot", 1.0),
    Measure("arm_cycle_us.p50", "arm cycle, median (µs)", 1.0),
)


@dataclass(frozen=True)
class RunCampaign:
    """`variants`: scenario keys of each group. A unit is one run; run i has the same seed in every group, so that they can be compared.

    `duration_s`: cuts every run short, None: the scenario's own length. `runs`: how many seeds there are for each group by default.
    """

    name: str
    variants: Mapping[str, tuple[str, ...]]
    measures: tuple[Measure, ...]
    duration_s: float | None
    runs: int
    scenario: str = SCENARIO
    batch: int = 1
    unit_name: str = "runs"

    def groups(self, pairs: int | None) -> Mapping[str, int]:
        """As many runs of each variant."""
        return dict.fromkeys(self.variants, self.runs if pairs is None else pairs)

    def parameters(self) -> Mapping[str, Any]:
        return {"scenario": self.scenario, "duration_s": self.duration_s}

    def warm_up(self, group: str) -> None:
        """Nothing: every run warms up by itself before its clock starts."""

    def compute(self, group: str, index: int, seed: int) -> Iterable[Row]:
        """One row: the run's metrics.json with dotted names. Its files go when they have been read."""
        run_seed = int(unit_generator(seed, "runs", index).integers(1, 2**31))
        with tempfile.TemporaryDirectory(prefix="campaign-") as folder:
            options = RunOptions(out=Path(folder), duration_s=self.duration_s, record=False, quiet=True)
            outcome = run_scenario(self._scenario(group, run_seed), options)
        return [_row(outcome.metrics) | {"exit_code": outcome.exit_code}]

    def summarise(self, results: pa.Table, out: Path) -> Summary:
        """Mean ± standard deviation of the measures for each variant, as a table and a figure."""
        return summarise_runs(self.name, results, self.measures, out)

    def _scenario(self, group: str, seed: int) -> Scenario:
        scenario = load_scenario(self.scenario, [*self.variants[group], f"seed={seed}"])
        assert isinstance(scenario, Scenario)  # the ones of the variants are
        return scenario


def slip_campaign(duration_s: float | None) -> RunCampaign:
    """Slip of 0 to 5 %, each coordination."""
    variants = {
        f"{coordination}-{percent}": (f"slip.sigma={percent / 100}", f'planner.coordination="{coordination}"')
        for coordination in COORDINATIONS
        for percent in SLIP_PERCENT
    }
    return RunCampaign("slip", variants, ERRORS, duration_s, runs=10)


def methods_campaign(duration_s: float | None) -> RunCampaign:
    """Each method of resolution in each case of preferences."""
    variants = {
        f"{method}-case{case}": (f'planner.method="{method}"', f"planner.case={case}")
        for method in METHODS
        for case in CASES
    }
    return RunCampaign("methods", variants, (*ERRORS, *DEXTERITY), duration_s, runs=5)


def _row(metrics: Mapping[str, Any], prefix: str = "") -> Row:
    """Dotted names; lists (faults, expectations) as how many there are; numbers as floats, so that every part has the same types."""
    row: Row = {}
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            row |= _row(value, f"{prefix}{key}.")
        elif isinstance(value, list | tuple):
            row[prefix + key] = float(len(value))
        elif isinstance(value, bool) or not isinstance(value, int | float):
            row[prefix + key] = None if value is None else str(value)
        else:
            row[prefix + key] = float(value)
    return row
