"""One kinematic run: an experiment of the stack's methods on a robot description, with the files and the verdict of any other run."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from canipulator.experiments import Experiment, build_experiment
from canipulator.outcome import (
    EXPECTATION_MISSED,
    OK,
    Outcome,
    RunOptions,
    expectations,
    flat,
    progress_bar,
    revision,
    run_directory,
    show,
)
from config.errors import ConfigError
from config.kinematic import KinematicScenario
from config.load import dump_scenario
from logs.configuration_map import save_map
from logs.dexterity import Dexterity
from logs.events import EventLog
from logs.kinematic_recorder import record_kinematic
from logs.metrics import Metrics, RunFacts, evaluate
from logs.recorder import RunInfo
from logs.signals import DecodedBlock, Signal, SignalTable
from logs.traces import Recorded
from stack.kinematics import ArmModel
from stack.kinematics.se3 import pose_difference

LIMIT_METRICS = ("position_excess_max_rad", "velocity_share_max", "acceleration_share_max")
"""Of the judged trace, for every experiment: how far beyond a position limit (rad, m), and velocity and acceleration as shares of
their limits."""


def run_kinematic(scenario: KinematicScenario, options: RunOptions) -> Outcome:
    """Runs to the end, or for `options.duration_s`.

    Raises ConfigError for what cannot be run, OSError where files cannot be written.
    """
    try:
        arm = ArmModel.load(scenario.robot)
    except ValueError as error:
        raise ConfigError(f"{scenario.name}: {error}") from None
    experiment = build_experiment(scenario)
    _check_expectations(scenario, experiment, arm)
    directory = run_directory(scenario.name, options)
    (directory / "scenario.toml").write_text(dump_scenario(scenario), encoding="utf-8")
    (directory / "bus.log").write_bytes(b"")  # nothing was said on any bus
    began = time.perf_counter()
    with progress_bar(scenario.name, options.duration_s or experiment.duration_s, quiet=options.quiet) as advance:
        recorded = experiment.run(lambda t_s: advance(t_s, f"{t_s:.1f} s"), options.duration_s)
    wall_s = time.perf_counter() - began
    log = EventLog(directory / "events.log")
    for event in recorded.events:
        log.write(event)
    log.close()
    for plane in recorded.maps:
        save_map(plane, directory / f"{plane.name}.png")
    fault = None
    if options.record:
        info = RunInfo(
            scenario.name,
            scenario.seed,
            recorded.method,
            recorded.coordination,
            revision(),
            flat(scenario.model_dump(mode="json", exclude_none=True)),
        )
        fault = record_kinematic(directory / "run.rrd", recorded, info)
    metrics = measure(scenario, recorded, arm, wall_s)
    metrics = replace(metrics, recorder_fault=fault)
    if options.duration_s is None:
        metrics = metrics.judged(expectations(scenario.expect))
    (directory / "metrics.json").write_text(metrics.to_json(), encoding="utf-8")
    if not options.quiet:
        show(metrics, directory, options)
    return Outcome(directory, metrics.as_dict(), OK if metrics.ok else EXPECTATION_MISSED)


def measure(scenario: KinematicScenario, recorded: Recorded, arm: ArmModel, wall_s: float) -> Metrics:
    """The contract's numbers of the judged trace; null for all that has to do with a bus, a platform or physics."""
    trace = recorded.judged
    facts = RunFacts(
        scenario=scenario.name,
        seed=scenario.seed,
        method=recorded.method,
        coordination=recorded.coordination,
        sim_time_s=float(trace.t_s[-1]),
        wall_time_s=wall_s,
        arm_cycle_us=recorded.cycle_us,
        faults=recorded.faults,
        extra={**limit_metrics(recorded, arm), **recorded.metrics},
    )
    return replace(
        evaluate(_table(recorded, arm), arm, facts),
        arm_cycles=len(trace.t_s) - 1,
        platform_cycles=0,
        tcp_lateral_error_rms_m=None,  # rows are cycles of the path's own time: there is no telling across from along
        tcp_lateral_error_max_m=None,
    )


def limit_metrics(recorded: Recorded, arm: ArmModel) -> dict[str, float | None]:
    """See `LIMIT_METRICS`."""
    trace = recorded.judged
    values = (
        float(np.maximum(arm.q_min - trace.q, trace.q - arm.q_max).max(initial=0.0)),
        float((np.abs(trace.velocity) / arm.dq_max).max()),
        float((np.abs(trace.acceleration) / arm.ddq_max).max()),
    )
    return dict(zip(LIMIT_METRICS, values, strict=True))


def _table(recorded: Recorded, arm: ArmModel) -> SignalTable:
    """The judged trace under the names that the metrics know."""
    trace = recorded.judged
    t_ns = np.round(1e9 * trace.t_s).astype(np.int64)
    q, pose = Signal(t_ns, trace.q), Signal(t_ns, trace.pose)
    signals = {"truth/q": q, "truth/dq": Signal(t_ns, trace.velocity), "truth/pose_WE": pose}
    signals |= Dexterity(arm).add(q, pose)
    if recorded.commanded is not None:
        off = np.array([pose_difference(a, b) for a, b in zip(recorded.commanded, trace.pose, strict=True)])
        distance, rotation = np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)
        signals["tcp/error"] = Signal(t_ns, np.column_stack([distance, np.full(len(t_ns), np.nan), rotation]))
    return SignalTable([DecodedBlock(signals)])


def _check_expectations(scenario: KinematicScenario, experiment: Experiment, arm: ArmModel) -> None:
    """Whether every metric that is expected exists: better now than at the end of the run."""
    names = (*LIMIT_METRICS, *experiment.metric_names)
    facts = RunFacts(scenario.name, scenario.seed, "", "", 0.0, 0.0, extra=dict.fromkeys(names, 0.0))
    nothing = replace(evaluate(SignalTable(), arm, facts), joint_travel=dict.fromkeys(arm.joint_names, 0.0))
    try:
        nothing.judged(expectations(scenario.expect))
    except ValueError as error:
        raise ConfigError(f"{scenario.name}: {error}") from None
