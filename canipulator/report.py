"""`canipulator report`: named sets of runs of the sliding door, and one HTML page that puts them beside what the thesis says."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canipulator.compare import read_recorded
from canipulator.outcome import RunOptions, progress_bar
from canipulator.run import run_scenario
from config.errors import ConfigError, nearest
from config.load import load_scenario
from config.scenario import Scenario
from logs.figures import FigureRun
from logs.report_page import Claim, Column, Section, write_page
from stack.kinematics import ArmModel

SCENARIO = "sliding-door"
_ERROR = Column("tcp_error_rms_m", "TCP error rms", 1e3, "mm")
_P99 = Column("tcp_error_p99_m", "p99", 1e3, "mm")
_MOST = Column("tcp_error_max_m", "max", 1e3, "mm")
_ARM = Column("min_manipulability_arm", "least manipulability, arm", 1.0, "")
_ROBOT = Column("min_manipulability_robot", "robot", 1.0, "")
_LOAD = Column("bus_load_mean", "bus load", 1e2, "%")
_CYCLE = Column("arm_cycle_us.p50", "arm cycle, median", 1.0, "µs")


@dataclass(frozen=True)
class Variant:
    """One run of a set: its name in tables and legends, and the scenario keys that make it."""

    name: str
    sets: tuple[str, ...]


@dataclass(frozen=True)
class RunSet:
    """Runs that belong together. `thesis`: what the source says about them; `claims`: what of it is checked here."""

    title: str
    thesis: str
    variants: tuple[Variant, ...]
    columns: tuple[Column, ...]
    claims: tuple[Claim, ...]
    figures: tuple[str, ...]


def _slip_runs() -> Iterator[Variant]:
    for percent in range(6):
        for coordination in ("abc", "unified"):
            keys = (f"slip.sigma={percent / 100}", f'planner.coordination="{coordination}"')
            yield Variant(f"{percent} % {coordination}", keys)


SETS: dict[str, RunSet] = {
    "cases": RunSet(
        "Four cases of preferences",
        "Chapter 4: without preferences (case 1) the arm is stretched out and its own manipulability falls; with preferences for the "
        "first five joints and the platform's orientation (case 2) it stays, best overall. The ordering of cases 2 to 4 depends on the "
        "preferred configuration, whose numbers are lost; ours is the robot's (config/robots/moma8/robot.toml), the same for all cases.",
        tuple(Variant(f"case {case}", (f"planner.case={case}",)) for case in range(1, 5)),
        (_ARM, _ROBOT, _ERROR, _P99, _MOST),
        (Claim("case 1 stretches the arm more than case 2", "min_manipulability_arm", "case 1", "<", "case 2"),),
        ("manipulability", "path"),
    ),
    "coordination": RunSet(
        "Who moves what: coordinated, unified, arm only",
        "Section 4.2: sending the whole robot's solution to all drives at once leaves the platform's lower bandwidth and its dead time in "
        "the TCP's error; arm cycles that take the platform's real motion into account take it out. Slip off, so that only this shows.",
        tuple(
            Variant(name, (f'planner.coordination="{name}"', "slip.sigma=0.0"))
            for name in ("abc", "unified", "arm-only")
        ),
        (_ERROR, _P99, _MOST, _ARM),
        (
            Claim(
                "the coordinated error is at most a fifth of the unified one",
                "tcp_error_rms_m",
                "abc",
                "<",
                "unified",
                0.2,
            ),
        ),
        ("error", "platform"),
    ),
    "cycles": RunSet(
        "Arm cycles in a platform cycle: 1, 2, 5, 10",
        "Figures 4.6 and 4.8: the more arm cycles there are in one platform cycle (20 Hz), the better the arm compensates.",
        tuple(
            Variant(f"{n} (arm {20 * n} Hz)", (f"planner.arm_cycle_hz={20.0 * n}", "planner.platform_cycle_hz=20.0"))
            for n in (1, 2, 5, 10)
        ),
        (_ERROR, _P99, _MOST, _LOAD, _CYCLE),
        (Claim("five arm cycles are better than one", "tcp_error_rms_m", "5 (arm 100 Hz)", "<", "1 (arm 20 Hz)"),),
        ("error",),
    ),
    "slip": RunSet(
        "Slip of 0 to 5 %",
        "Slip that the wheels cannot see comes back through the TCP's own sensors; unified commands leave it, and the platform's lag, in.",
        tuple(_slip_runs()),
        (_ERROR, _P99, _MOST),
        (
            Claim(
                "at 5 % the coordinated error is below the unified one",
                "tcp_error_rms_m",
                "5 % abc",
                "<",
                "5 % unified",
            ),
        ),
        ("error",),
    ),
    "methods": RunSet(
        "Redundancy resolution: PNS, FSP, gradient, QP",
        "Chapter 2: PNS and FSP are the same optimum, reached by projection and by a full-space problem; the QP is the same with "
        "inequalities.",
        tuple(Variant(name, (f'planner.method="{name}"',)) for name in ("pns", "fsp", "gradient", "qp")),
        (_ERROR, _P99, _ARM, _ROBOT, _CYCLE),
        (Claim("PNS and FSP keep the same manipulability", "min_manipulability_arm", "pns", "~", "fsp", 0.02),),
        ("manipulability",),
    ),
}


def write_report(names: Sequence[str], out: Path, *, jobs: int, duration_s: float | None, quiet: bool) -> Path:
    """Runs the sets and writes `out`/report.html, `out`/report.json and the runs' folders; the page's path.

    Raises ConfigError for a set that does not exist, OSError where files cannot be written.
    """
    for name in names:
        if name not in SETS:
            raise ConfigError(f"unknown set {name!r}, {nearest(name, SETS)}")
    chosen = [SETS[name] for name in names or SETS]
    out.mkdir(parents=True, exist_ok=True)
    tasks = {(run_set.title, variant.name): variant for run_set in chosen for variant in run_set.variants}
    folders = {key: out / "runs" / f"{i:02d}" for i, key in enumerate(tasks)}
    metrics: dict[tuple[str, str], dict[str, Any]] = {}
    with progress_bar("report", len(tasks), quiet=quiet) as advance, _workers(jobs) as pool:
        waiting = {pool.submit(_run, variant.sets, folders[key], duration_s): key for key, variant in tasks.items()}
        for done, future in enumerate(as_completed(waiting), start=1):
            metrics[waiting[future]] = future.result()
            advance(done, f"{done} of {len(tasks)} runs")
    sections = [_section(run_set, metrics, folders) for run_set in chosen]
    (out / "report.json").write_text(
        json.dumps({f"{a}: {b}": m for (a, b), m in metrics.items()}, indent=1), encoding="utf-8"
    )
    return write_page(out / "report.html", sections, ArmModel.load("moma8"))


def _section(
    run_set: RunSet, metrics: dict[tuple[str, str], dict[str, Any]], folders: dict[tuple[str, str], Path]
) -> Section:
    rows = [(variant.name, metrics[run_set.title, variant.name]) for variant in run_set.variants]
    runs = [
        FigureRun(variant.name, read_recorded(folders[run_set.title, variant.name])) for variant in run_set.variants
    ]
    return Section(run_set.title, run_set.thesis, rows, run_set.columns, run_set.claims, run_set.figures, runs)


def _workers(jobs: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(jobs or os.cpu_count(), mp_context=multiprocessing.get_context("spawn"))


def _run(sets: tuple[str, ...], folder: Path, duration_s: float | None) -> dict[str, Any]:
    """One run in a worker; its metrics."""
    scenario = load_scenario(SCENARIO, sets)
    assert isinstance(scenario, Scenario)  # the sliding door is one
    return run_scenario(scenario, RunOptions(out=folder, duration_s=duration_s, quiet=True)).metrics
