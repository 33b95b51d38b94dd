"""The numbers by which a run is judged: `metrics.json`, from signals and truth, never from the planner's own estimate."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from logs.around import around_metrics
from logs.expectations import Expectation, Verdict, judge
from logs.path_metrics import (
    acceleration_steps,
    driven_distances,
    largest_distance_to_curve,
    platform_path_deviation,
    standing_s,
)
from logs.signals import Signal, SignalTable
from logs.steady import steady_rows
from stack.kinematics import ArmModel
from stack.planner.platform_path import RelativePath

POSITION_TOLERANCE = 1e-6
"""rad or m beyond a limit that do not count: the resolution of the wire."""
VELOCITY_TOLERANCE = 1e-3
"""Share of the limit that does not count."""


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What the signals do not tell; measured by whoever ran the run.

    `arm_cycle_us` (n,): computing time of each arm cycle. `extra`: a scenario's own numbers, e.g. a door's angle.
    `platform_path`: what the platform's deviation is measured against. `door`: "hinged", "sliding", or None.
    """

    scenario: str
    seed: int
    method: str
    coordination: str
    sim_time_s: float
    wall_time_s: float
    platform_ratio: int = 5
    physics_only_real_time_factor: float | None = None
    arm_cycle_us: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    frames: int = 0
    frames_lost: int = 0
    faults: tuple[str, ...] = ()
    recorder_fault: str | None = None
    dropped_blocks: int = 0
    recording_bytes: int | None = None
    extra: Mapping[str, float | None] = field(default_factory=dict)
    platform_path: RelativePath | None = None
    door: str | None = None


@dataclass(frozen=True, slots=True)
class Percentiles:
    """µs; None when nothing was measured."""

    p50: float | None
    p99: float | None
    max: float | None


@dataclass(frozen=True, slots=True)
class LimitViolations:
    """Samples (joint x SYNC) of the true joint state beyond a limit of the robot's description."""

    position: int
    velocity: int


@dataclass(frozen=True, slots=True)
class Metrics:
    """As in metrics.json; None (null) where there was nothing to measure.

    TCP error: distance between the commanded path and the true TCP at the time that each reference is meant for, over all
    cycles with a valid reference; `lateral` leaves out the part along the path,
    `steady` all but steady motion (`logs.steady`). `reference_segments`: how often references
    became valid; each time the reference frame is placed anew. Manipulability (of the TCP's 6 rows, and of the wrist
    centre's 3) is sampled at 20 Hz. `bus_load_*`: per 100 ms. `joint_travel`: last minus first position.
    `tcp_path_error_max_m`, `platform_…`, `joint_acceleration_step_max` (while references are valid): see `logs.path_metrics`.
    """

    scenario: str
    seed: int
    method: str
    coordination: str
    sim_time_s: float
    wall_time_s: float
    real_time_factor: float | None
    physics_only_real_time_factor: float | None
    arm_cycles: int
    platform_cycles: int
    arm_cycle_us: Percentiles
    tcp_error_rms_m: float | None
    tcp_error_p99_m: float | None
    tcp_error_max_m: float | None
    tcp_error_final_m: float | None
    tcp_error_steady_rms_m: float | None
    tcp_error_steady_p99_m: float | None
    tcp_lateral_error_rms_m: float | None
    tcp_lateral_error_max_m: float | None
    tcp_orientation_error_max_rad: float | None
    reference_segments: int
    tcp_travel_m: float | None
    tcp_path_error_max_m: float | None
    bus_load_mean: float | None
    bus_load_peak: float | None
    frames: int
    frames_lost: int
    bad_checksums: int
    torn_references: int
    limit_violations: LimitViolations
    min_manipulability_arm: float | None
    min_manipulability_robot: float | None
    min_manipulability_arm_wrist_centre: float | None
    min_manipulability_robot_wrist_centre: float | None
    mean_manipulability_arm: float | None
    mean_manipulability_robot: float | None
    joint_travel: Mapping[str, float]
    joint_acceleration_step_max: Mapping[str, float]
    platform_travel_m: float | None
    platform_turn_rad: float | None
    platform_distance_forward_m: float | None
    platform_distance_backward_m: float | None
    platform_path_error_max_m: float | None
    platform_path_turn_max_rad: float | None
    max_contact_force_n: float | None
    max_wheel_slip: float | None
    min_path_scale: float | None
    recorder_fault: str | None
    dropped_blocks: int
    recording_mb_per_minute: float | None
    faults: tuple[str, ...]
    extra: Mapping[str, float | None]
    expectations: tuple[Verdict, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; the scenario's own numbers stand beside the others."""
        values = asdict(self)
        return {**values.pop("extra"), **values}

    def to_json(self) -> str:
        """The text of metrics.json: strict JSON, NaN as null."""
        return json.dumps(_plain(self.as_dict()), indent=2, allow_nan=False, ensure_ascii=False) + "\n"

    def judged(self, expectations: Iterable[Expectation]) -> Metrics:
        """The same with `expectations`. Raises ValueError for a metric that does not exist."""
        return replace(self, expectations=judge(_plain(self.as_dict()), expectations))

    @property
    def ok(self) -> bool:
        """Whether every expectation was met."""
        return all(verdict.ok for verdict in self.expectations)


def evaluate(table: SignalTable, arm: ArmModel, facts: RunFacts) -> Metrics:
    """The metrics of a whole run, from its signals. `arm` gives the limits."""
    error, dexterity, load = table.get("tcp/error"), table.get("manipulability"), table.get("bus/load")
    lowest, mean = _lowest(dexterity), _mean(dexterity)
    arm_cycles = len(table["sync"]) if "sync" in table else 0
    cycle_us = np.asarray(facts.arm_cycle_us, np.float64)
    segment, scale, slip, wrench = (
        table.get(name) for name in ("reference/segment", "planner/state", "truth/wheel_slip", "truth/contact_wrench")
    )
    pose_WB, dq = table.get("truth/pose_WB"), table.get("truth/dq")
    forward, backward = driven_distances(pose_WB)
    off_path, off_tangent = platform_path_deviation(pose_WB, table.get("mission"), facts.platform_path)
    judged_ns = None if error is None else (int(error.t_ns[0]), int(error.t_ns[-1]))
    distance, lateral, rotation = error.values.T if error is not None else (np.empty(0),) * 3
    commanded = table.get("tcp/commanded")
    steady = distance[steady_rows(commanded)] if commanded is not None and len(commanded) == len(distance) else ()
    return Metrics(
        scenario=facts.scenario,
        seed=facts.seed,
        method=facts.method,
        coordination=facts.coordination,
        sim_time_s=facts.sim_time_s,
        wall_time_s=facts.wall_time_s,
        real_time_factor=facts.sim_time_s / facts.wall_time_s if facts.wall_time_s > 0 else None,
        physics_only_real_time_factor=facts.physics_only_real_time_factor,
        arm_cycles=arm_cycles,
        platform_cycles=-(-arm_cycles // facts.platform_ratio),
        arm_cycle_us=Percentiles(_percentile(cycle_us, 50), _percentile(cycle_us, 99), _largest(cycle_us)),
        tcp_error_rms_m=_rms(distance),
        tcp_error_p99_m=_percentile(distance, 99),
        tcp_error_max_m=_largest(distance),
        tcp_error_final_m=float(distance[-1]) if len(distance) else None,
        tcp_error_steady_rms_m=_rms(steady),
        tcp_error_steady_p99_m=_percentile(steady, 99),
        tcp_lateral_error_rms_m=_rms(lateral),
        tcp_lateral_error_max_m=_largest(lateral),
        tcp_orientation_error_max_rad=_largest(rotation),
        reference_segments=int(segment.values.max()) if segment is not None else 0,
        tcp_travel_m=_travel(table.get("truth/pose_WE")),
        tcp_path_error_max_m=largest_distance_to_curve(table.get("truth/pose_WE"), table.get("tcp/commanded")),
        bus_load_mean=float(load.values.mean()) if load is not None else None,
        bus_load_peak=float(load.values.max()) if load is not None else None,
        frames=facts.frames,
        frames_lost=facts.frames_lost,
        bad_checksums=table.counts.get("bad_checksums", 0),
        torn_references=table.counts.get("torn_references", 0),
        limit_violations=limit_violations(table, arm),
        min_manipulability_arm=lowest[0],
        min_manipulability_robot=lowest[1],
        min_manipulability_arm_wrist_centre=lowest[2],
        min_manipulability_robot_wrist_centre=lowest[3],
        mean_manipulability_arm=mean[0],
        mean_manipulability_robot=mean[1],
        joint_travel=_joint_travel(table.get("truth/q"), arm),
        joint_acceleration_step_max=acceleration_steps(dq, judged_ns, arm.joint_names),
        platform_travel_m=_travel(pose_WB),
        platform_turn_rad=_turn(pose_WB),
        platform_distance_forward_m=forward,
        platform_distance_backward_m=backward,
        platform_path_error_max_m=off_path,
        platform_path_turn_max_rad=off_tangent,
        max_contact_force_n=_largest(np.linalg.norm(wrench.values[:, :3], axis=1)) if wrench is not None else None,
        max_wheel_slip=_largest(np.abs(slip.values)) if slip is not None else None,
        min_path_scale=float(scale.values[:, 3].min()) if scale is not None else None,
        recorder_fault=facts.recorder_fault,
        dropped_blocks=facts.dropped_blocks,
        recording_mb_per_minute=_mb_per_minute(facts.recording_bytes, facts.sim_time_s),
        faults=facts.faults,
        extra={"platform_standing_s": standing_s(pose_WB), **around_metrics(table, facts.door), **facts.extra},
    )


def limit_violations(table: SignalTable, arm: ArmModel) -> LimitViolations:
    """Counts samples of the true q and q̇ beyond `arm`'s limits and the tolerances of this module."""
    q, dq = table.get("truth/q"), table.get("truth/dq")
    position = velocity = 0
    if q is not None:
        low, high = arm.q_min - POSITION_TOLERANCE, arm.q_max + POSITION_TOLERANCE
        position = int(np.sum((q.values < low) | (q.values > high)))
    if dq is not None:
        velocity = int(np.sum(np.abs(dq.values) > arm.dq_max * (1.0 + VELOCITY_TOLERANCE)))
    return LimitViolations(position, velocity)


def _lowest(dexterity: Signal | None) -> tuple[float | None, ...]:
    if dexterity is None:
        return (None,) * 4
    return tuple(None if np.isnan(value) else value for value in dexterity.values.min(axis=0).tolist())


def _mean(dexterity: Signal | None) -> tuple[float | None, ...]:
    return (None,) * 4 if dexterity is None else tuple(dexterity.values.mean(axis=0).tolist())


def _joint_travel(q: Signal | None, arm: ArmModel) -> dict[str, float]:
    if q is None:
        return {}
    return dict(zip(arm.joint_names, (q.values[-1] - q.values[0]).tolist(), strict=True))


def _travel(pose: Signal | None) -> float | None:
    """Straight distance from the first to the last position."""
    return None if pose is None else float(np.linalg.norm(pose.values[-1, :3, 3] - pose.values[0, :3, 3]))


def _turn(pose: Signal | None) -> float | None:
    """Heading at the end against that at the start, turns counted."""
    if pose is None:
        return None
    heading = np.unwrap(np.arctan2(pose.values[:, 1, 0], pose.values[:, 0, 0]))
    return float(heading[-1] - heading[0])


def _mb_per_minute(size: int | None, seconds: float) -> float | None:
    return None if size is None or seconds <= 0.0 else size / 1e6 / seconds * 60.0


def _rms(values: ArrayLike) -> float | None:
    values = np.asarray(values)
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _percentile(values: ArrayLike, percent: float) -> float | None:
    values = np.asarray(values)
    return float(np.percentile(values, percent)) if values.size else None


def _largest(values: ArrayLike) -> float | None:
    values = np.asarray(values)
    return float(values.max()) if values.size else None


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
