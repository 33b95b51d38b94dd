"""What is plotted: the entities of the recording that hold numbers, their series and colours, made from decoded signals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.tables.planner import MANIFOLD_NAMES
from logs import palette
from logs.bus_timing import ANSWERING, CLASSES
from logs.palette import Color
from logs.signals import Decimation, Signal
from stack.kinematics import ArmModel
from stack.planner.singularities import manifolds

XYZ = ("x", "y", "z")
WHEELS = ("left", "right")
# what is said first lies below and is drawn broader, so that all three are seen where they agree
PLATFORM_ROLES = (
    ("commanded", palette.COMMANDED, 4.0),
    ("encoder", palette.MEASURED, 2.5),
    ("true", palette.TRUE, 1.0),
)


@dataclass(frozen=True, slots=True)
class Series:
    """Names and colours of the columns of one entity; `widths` in points."""

    path: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    widths: tuple[float, ...] = ()

    @property
    def all_widths(self) -> tuple[float, ...]:
        return self.widths or (1.5,) * len(self.names)


def all_series(joint_names: Sequence[str]) -> tuple[Series, ...]:
    """Every plotted entity of a recording."""
    joints = tuple(joint_names)
    colors = palette.JOINTS[: len(joints)]
    per_joint = (
        "position_share",
        "velocity_share",
        "position_rad_or_m/actual",
        "position_rad_or_m/target",
        "effort_Nm_or_N/actual",
        "effort_Nm_or_N/offset",
    )
    limits = ("upper limit", "lower limit", "padding", "padding ")
    limit_colors = (palette.LIMIT, palette.LIMIT, palette.PADDING, palette.PADDING)
    detail = ("actual", "target", *limits)
    return (
        Series("tcp/error_mm", ("distance", "across the path"), (palette.LIMIT, palette.COMMANDED), (3.0, 1.2)),
        Series("tcp/rotation_error_mrad", ("rotation",), (palette.VIOLET,)),
        *(Series(f"joints/{name}", joints, colors) for name in per_joint),
        Series("joints/limits_share", ("limits, padding",) * 4, limit_colors, (1.0,) * 4),  # one entry of the legend
        *(
            Series(f"joints/each_rad_or_m/{joint}", detail, (palette.MEASURED, palette.COMMANDED, *limit_colors))
            for joint in joints
        ),
        *(Series(f"platform/v_m_per_s/{role}", (role,), (color,), (width,)) for role, color, width in PLATFORM_ROLES),
        *(
            Series(f"platform/omega_rad_per_s/{role}", (role,), (color,), (width,))
            for role, color, width in PLATFORM_ROLES
        ),
        *(Series(f"manipulability/{name}_SI", ("TCP", "wrist centre"), pair) for name, pair in _DEXTERITY_COLORS),
        Series("singular_values/arm_SI", tuple(f"σ{i}" for i in range(1, 7)), palette.JOINTS[:6]),
        Series("singular_values/robot_SI", tuple(f"σ{i}" for i in range(1, 7)), palette.JOINTS[:6]),
        Series("singularity/margins_1", ("KS", "AS", "SS", "SAS"), _KIND_COLORS),
        Series("singularity/manifolds_rad", MANIFOLD_NAMES, palette.JOINTS),
        Series("planner/path_scale_1", ("path scale",), (palette.TRUE,)),
        Series("bus/load_percent", ("bus load",), (palette.MEASURED,)),
        Series("bus/frames_per_s", ("frames",), (palette.NEUTRAL,)),
        Series("bus/load_by_class_percent", CLASSES, palette.JOINTS[: len(CLASSES)]),
        Series("bus/after_sync_ms", ANSWERING, palette.JOINTS[: len(ANSWERING)]),
        Series("bus/sync_error_us", ("later than due",), (palette.NEUTRAL,)),
        Series("cycle/computing_ms", ("planner",), (palette.TRUE,)),
        *(
            Series(f"wheels/velocity_rad_per_s/{side}/{role}", (role,), (color,), (width,))
            for side in WHEELS
            for role, color, width in PLATFORM_ROLES
        ),
        Series("wrench/force_N", XYZ, palette.AXES),
        Series("wrench/torque_Nm", XYZ, palette.AXES),
        Series("twist/linear_m_per_s", XYZ, palette.AXES),
        Series("twist/angular_rad_per_s", XYZ, palette.AXES),
        Series("wheels/slip_percent", ("left", "right"), (palette.MEASURED, palette.COMMANDED)),
        Series("wheels/slip_estimate_percent", ("left, estimate", "right, estimate"), (palette.TRUE, palette.VIOLET)),
        Series("tracker/position_error_mm", ("distance",), (palette.NEUTRAL,)),
    )


class Plots:
    """Turns the signals of a block into the values of the plotted entities. `arm` gives limits; it is only read."""

    def __init__(self, arm: ArmModel) -> None:
        self._arm, self._thin = arm, Decimation(_MANIFOLDS_HZ)
        self._names = arm.joint_names
        self._lower, self._upper, self._padding = arm.q_min, arm.q_max, arm.padding
        self._max_velocity = arm.dq_max
        self._padding_share = 1.0 - 2.0 * float(np.mean(self._padding / (self._upper - self._lower)))

    def values(self, signals: Mapping[str, Signal], only: frozenset[str] | None = None) -> Iterable[tuple[str, Signal]]:
        """Entity path and values, for every plotted entity (or those in `only`) that this block has something for."""
        if only is not None:
            signals = {name: signal for name, signal in signals.items() if name in _MINIMAL_SIGNALS}
        return (pair for pair in self._all(signals) if only is None or pair[0] in only)

    def _all(self, signals: Mapping[str, Signal]) -> Iterable[tuple[str, Signal]]:
        for path, name, scale in _DIRECT:
            if name in signals:
                yield path, _scaled(signals[name], scale)
        yield from self._error(signals)
        yield from self._joints(signals)
        yield from _platform(signals)
        yield from _wheels(signals)
        if "manipulability" in signals:
            both = signals["manipulability"]
            yield "manipulability/arm_SI", Signal(both.t_ns, both.values[:, 0::2])
            yield "manipulability/robot_SI", Signal(both.t_ns, both.values[:, 1::2])
        if "singularity/margins" in signals:
            margins = signals["singularity/margins"]
            yield "singularity/margins_1", Signal(margins.t_ns, margins.values[:, :4])
            yield from self._manifold_distances(signals)
        if "slip/estimate" in signals:
            slip = signals["slip/estimate"]
            yield "wheels/slip_estimate_percent", Signal(slip.t_ns, 100.0 * slip.values[:, :2])
        if "planner/state" in signals:
            state = signals["planner/state"]
            yield "planner/path_scale_1", Signal(state.t_ns, state.values[:, 3:4])

    def _manifold_distances(self, signals: Mapping[str, Signal]) -> Iterable[tuple[str, Signal]]:
        """Of the measured configuration, ten rows a second."""
        actual = signals.get("joints/position/actual")
        if actual is None:
            return
        whole = actual.complete()
        rows = self._thin.due(whole.t_ns)
        if len(rows):
            values = np.array([list(manifolds(self._arm, q).values()) for q in whole.values[rows]])
            yield "singularity/manifolds_rad", Signal(whole.t_ns[rows], values)

    def _error(self, signals: Mapping[str, Signal]) -> Iterable[tuple[str, Signal]]:
        error = signals.get("tcp/error")
        if error is not None:
            yield "tcp/error_mm", Signal(error.t_ns, 1e3 * error.values[:, :2])
            yield "tcp/rotation_error_mrad", Signal(error.t_ns, 1e3 * error.values[:, 2:3])
        tracker, pose = signals.get("tracker/position"), signals.get("truth/pose_WE")
        if tracker is not None and pose is not None:
            seen_ns = tracker.t_ns - (signals["tracker/age"].values[:, 0] * 1e9).astype(np.int64)
            true = np.column_stack([np.interp(seen_ns, pose.t_ns, pose.values[:, i, 3]) for i in range(3)])
            off = np.linalg.norm(tracker.values - true, axis=1, keepdims=True)
            inside = (seen_ns >= pose.t_ns[0]) & (seen_ns <= pose.t_ns[-1])
            yield "tracker/position_error_mm", Signal(tracker.t_ns, 1e3 * off).at(inside)

    def _joints(self, signals: Mapping[str, Signal]) -> Iterable[tuple[str, Signal]]:
        actual, velocity = signals.get("joints/position/actual"), signals.get("truth/dq")
        if velocity is not None:
            yield "joints/velocity_share", Signal(velocity.t_ns, velocity.values / self._max_velocity)
        if actual is None:
            return
        middle, half = 0.5 * (self._upper + self._lower), 0.5 * (self._upper - self._lower)
        yield "joints/position_share", Signal(actual.t_ns, (actual.values - middle) / half)
        ends = np.array([actual.t_ns[0], actual.t_ns[-1]])[: len(actual)]
        pad = self._padding_share
        yield "joints/limits_share", Signal(ends, np.tile([1.0, -1.0, pad, -pad], (len(ends), 1)))
        yield from self._each_joint(actual, signals.get("joints/position/target"))

    def _each_joint(self, actual: Signal, target: Signal | None) -> Iterable[tuple[str, Signal]]:
        """Twenty rows a second of every joint with its target and limits."""
        step = max(1, round(0.05e9 / max(1, np.median(np.diff(actual.t_ns))))) if len(actual) > 1 else 1
        thin = actual.at(slice(None, None, step))
        for i, name in enumerate(self._names):
            lower, upper, pad = self._lower[i], self._upper[i], self._padding[i]
            wanted = np.full(len(thin), np.nan)
            if target is not None:
                wanted = np.interp(thin.t_ns, target.t_ns, target.values[:, i], left=np.nan, right=np.nan)
            limits = np.tile([upper, lower, upper - pad, lower + pad], (len(thin), 1))
            yield (
                f"joints/each_rad_or_m/{name}",
                Signal(thin.t_ns, np.column_stack([thin.values[:, i], wanted, limits])),
            )


MINIMAL_PLOTS = frozenset(
    {
        "tcp/error_mm",
        "joints/position_rad_or_m/actual",
        "joints/position_share",
        "joints/limits_share",
        "platform/v_m_per_s/commanded",
        "platform/v_m_per_s/true",
        "platform/omega_rad_per_s/commanded",
        "platform/omega_rad_per_s/true",
        "manipulability/arm_SI",
        "manipulability/robot_SI",
        "bus/load_percent",
        "planner/path_scale_1",
    }
)
"""Plotted entities of a recording with `Detail.MINIMAL`."""
_MINIMAL_SIGNALS = frozenset(
    {
        "tcp/error",
        "joints/position/actual",
        "platform/velocity/commanded",
        "truth/base_twist",
        "manipulability",
        "bus/load",
        "planner/state",
    }
)
_MANIFOLDS_HZ = 10.0
_KIND_COLORS = (palette.LIMIT, palette.COMMANDED, palette.MEASURED, palette.VIOLET)
_DEXTERITY_COLORS = (
    ("arm", (palette.COMMANDED, palette.JOINTS[7])),
    ("robot", (palette.MEASURED, palette.VIOLET)),
)
_DIRECT = (
    ("joints/position_rad_or_m/actual", "joints/position/actual", 1.0),
    ("joints/position_rad_or_m/target", "joints/position/target", 1.0),
    ("joints/effort_Nm_or_N/actual", "joints/effort", 1.0),
    ("joints/effort_Nm_or_N/offset", "joints/effort/offset", 1.0),
    ("singular_values/arm_SI", "singular_values/arm", 1.0),
    ("singular_values/robot_SI", "singular_values/robot", 1.0),
    ("bus/load_percent", "bus/load", 100.0),
    ("bus/frames_per_s", "bus/frames", 10.0),
    ("bus/load_by_class_percent", "bus/load_by_class", 100.0),
    ("bus/after_sync_ms", "bus/after_sync", 1e3),
    ("bus/sync_error_us", "bus/sync_error", 1e6),
    ("cycle/computing_ms", "cycle/computing", 1e3),
    ("wrench/force_N", "wrench/force", 1.0),
    ("wrench/torque_Nm", "wrench/torque", 1.0),
    ("twist/linear_m_per_s", "twist/linear", 1.0),
    ("twist/angular_rad_per_s", "twist/angular", 1.0),
    ("wheels/slip_percent", "truth/wheel_slip", 100.0),
)


def _platform(signals: Mapping[str, Signal]) -> Iterable[tuple[str, Signal]]:
    sources = {
        "commanded": "platform/velocity/commanded",
        "encoder": "platform/velocity/encoder",
        "true": "truth/base_twist",
    }
    for role, name in sources.items():
        if name in signals:
            signal = signals[name]
            yield f"platform/v_m_per_s/{role}", Signal(signal.t_ns, signal.values[:, :1])
            yield f"platform/omega_rad_per_s/{role}", Signal(signal.t_ns, signal.values[:, 1:2])


def _wheels(signals: Mapping[str, Signal]) -> Iterable[tuple[str, Signal]]:
    sources = {
        "commanded": "wheels/velocity/target",
        "encoder": "wheels/velocity/actual",
        "true": "truth/wheel_velocity",
    }
    for role, name in sources.items():
        if name in signals:
            signal = signals[name]
            for i, side in enumerate(WHEELS):
                yield f"wheels/velocity_rad_per_s/{side}/{role}", Signal(signal.t_ns, signal.values[:, i : i + 1])


def _scaled(signal: Signal, scale: float) -> Signal:
    return signal if scale == 1.0 else Signal(signal.t_ns, signal.values * scale)
