"""What is left of a run on a real wire: metrics where the truth is, timing where it is not, and the exit code."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from canipulator.judging import overload
from canipulator.outcome import EXPECTATION_MISSED, OK, Outcome, expectations, show
from logs.metrics import Metrics, RunFacts, evaluate
from logs.run_log import RunLog

if TYPE_CHECKING:
    from canipulator.realtime import WireRun


def report(run: WireRun, *, judged: bool) -> Outcome:
    """Writes what was measured and says how it went. Call after closing."""
    if run.log is None:
        timing = _timing(run)
        (run.directory / "timing.json").write_text(json.dumps(timing, indent=2) + "\n", encoding="utf-8")
        if not run.options.quiet:
            click.echo(f"files      {run.directory}/  (bus.log, events.log, timing.json, scenario.toml)")
        return Outcome(run.directory, timing, OK if run.failure is None else EXPECTATION_MISSED)
    metrics = _metrics(run, run.log, judged=judged)
    (run.directory / "metrics.json").write_text(metrics.to_json(), encoding="utf-8")
    if not run.options.quiet:
        show(metrics, run.directory, run.options)
    code = OK if metrics.ok and not (judged and run.failure) else EXPECTATION_MISSED
    return Outcome(run.directory, metrics.as_dict(), code)


def _metrics(run: WireRun, log: RunLog, *, judged: bool) -> Metrics:
    scenario, statistics = run.scenario, run.bus.statistics()
    bus_full = overload(log.table, statistics.frames_lost)
    facts = RunFacts(
        scenario=scenario.name,
        seed=scenario.seed,
        method=scenario.planner.method,
        coordination=scenario.planner.coordination,
        sim_time_s=run.elapsed_s,
        wall_time_s=run.elapsed_s / run.wire.pace,
        platform_ratio=run.platform_ratio,
        arm_cycle_us=_cycle_us(run),
        frames=statistics.frames,
        frames_lost=statistics.frames_lost,
        faults=(*bus_full, *run.faults),
        recorder_fault=log.recorder_fault,
        dropped_blocks=log.dropped_blocks,
        recording_bytes=log.recording_bytes,
        extra=_own_metrics(run),
        door=None if scenario.door is None else scenario.door.kind,
    )
    metrics = evaluate(log.table, run.robot.arm, facts)
    return metrics.judged(expectations(scenario.expect)) if judged else metrics


def _own_metrics(run: WireRun) -> dict[str, float | None]:
    assert run.first is not None and run.last is not None  # `power_on` samples at once
    moved = run.last.pose_WB[:2, 3] - run.first.pose_WB[:2, 3]
    planner = run.planner
    return {
        "mission_finished": float(run.watch.finished_ns is not None),
        "path_progress": None if planner is None else planner.path_progress,
        "incomplete_cycles": None if planner is None else float(planner.incomplete_cycles),
        "platform_return_error_m": float(np.hypot(*moved)),
        "collisions": None if run.sim is None else float(run.sim.world.collisions.ticks),
        **_lateness(run),
    }


def _lateness(run: WireRun) -> dict[str, float | None]:
    """How well this process kept to real time, since the planner was at work for the first time."""
    return {
        "missed_cycles": float(run.watch.missed_cycles),
        "overruns": float(run.clock.overruns),
        "max_lateness_us": run.clock.max_lateness_ns * 1e-3,
    }


def _timing(run: WireRun) -> dict[str, Any]:
    """What a role without the truth can say."""
    statistics, cycle_us = run.bus.statistics(), _cycle_us(run)
    timing: dict[str, Any] = {
        "roles": list(run.wire.roles),
        "failure": run.failure,
        "wall_time_s": run.elapsed_s / run.wire.pace,
        "frames": statistics.frames,
        "frames_lost": statistics.frames_lost,
        "bus_load_mean": statistics.load_mean,
        "bus_load_peak": statistics.load_peak,
        "faults": run.faults,
        **_lateness(run),
    }
    if run.planner is not None:
        timing["incomplete_cycles"] = run.planner.incomplete_cycles
        timing["path_progress"] = run.planner.path_progress
        if len(cycle_us):
            p50, p99 = np.percentile(cycle_us, [50, 99]).tolist()
            timing["arm_cycle_us"] = {"p50": p50, "p99": p99, "max": float(cycle_us.max())}
    return timing


def _cycle_us(run: WireRun) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([] if run.planner is None else run.planner.cycle_ns, dtype=np.float64) * 1e-3
