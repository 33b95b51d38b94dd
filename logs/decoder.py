"""Frames and truth samples in, signals out: block by block, vectorised, off the control path."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.catalogue import DRIVE_IDS, FORCE_SENSOR_ID, PLANNER_ID, STRATEGIC_ID, TRACKER_ID
from drivers.frame import Frame, bit_length
from drivers.objects import DeviceDef, PdoKind
from logs.bus_timing import CLASSES, after_sync, classes, load_by_class, sync_error
from logs.events import Event
from logs.frame_batch import FrameBatch, Ints, PdoLayout, checksum_ok, pdo_layouts
from logs.signals import DecodedBlock, Signal
from logs.states import StateDecoder
from logs.tape import SYNC_ID, Block
from stack.messages import Matrix, Truth

LOAD_WINDOW_NS = 100_000_000
_RESTART = 10  # references whose cycle count is further off than this come from a planner that counts anew

_TRUTH_FIELDS = (
    "pose_WB",
    "pose_WE",
    "q",
    "dq",
    "effort",
    "wheel_velocity",
    "wheel_slip",
    "base_twist",
    "contact_wrench",
)
_TRUTH_OPTIONS = ("door", "handle_force", "hand", "body_poses")


class SignalDecoder:
    """Decodes the blocks of one run, in their order.

    Frames of the arm cycle that is still open are kept for the next block, so that no cycle is torn apart. Layouts and
    scales come from `devices`. `wheel_radius` and `track` (m) turn wheel velocities into those of the platform.
    """

    def __init__(
        self,
        devices: Iterable[DeviceDef],
        *,
        sync_period_ns: int,
        bitrate: int = 1_000_000,
        wheel_radius: float,
        track: float,
    ) -> None:
        devices = tuple(devices)
        self._layouts = pdo_layouts(devices)
        self._period_ns = sync_period_ns
        self._bits_per_window = bitrate * LOAD_WINDOW_NS / 1e9
        self._to_platform = np.array([[0.5, -1.0 / track], [0.5, 1.0 / track]]) * wheel_radius
        self._open: list[Frame] = []
        self._cycle = -1
        self._anchor: int | None = None
        self._segment = 0
        self._was_valid = False
        self._window: int | None = None
        self._window_bits, self._window_frames = np.zeros(len(CLASSES)), 0.0
        self._class_of = classes(devices)
        self._last_sync_ns: int | None = None
        self._last_wheels: Signal | None = None
        self._states = StateDecoder({device.node_id: device.name for device in devices})

    def decode(self, block: Block, *, last: bool = False) -> DecodedBlock:
        """Signals, state changes and events of `block`; with `last` also those of the cycle that is still open."""
        frames = self._open + block.frames
        closed = len(frames) if last else _last_sync(frames)
        frames, self._open = frames[:closed], frames[closed:]
        signals: dict[str, Signal] = {}
        counts = {"bad_checksums": 0, "torn_references": 0}
        batch = FrameBatch.of(frames)
        cycles = self._cycle + np.cumsum(batch.can_id == SYNC_ID)
        sync_ns = batch.sync_times()
        first = self._cycle + 1
        self._cycle += len(sync_ns)
        if len(sync_ns):
            signals["sync"] = Signal(sync_ns, np.arange(first, self._cycle + 1, dtype=np.float64))
            rows = cycles - first
            self._timing(batch, rows, sync_ns, signals)
            self._drives(batch, rows, sync_ns, signals)
            self._reference(batch, rows, sync_ns, signals, counts)
        self._plain_frames(batch, signals, counts)
        self._load(frames, batch, signals)
        _truth(block.truths, signals)
        if block.timings:
            t_ns, computing_ns = np.array(block.timings, np.int64).T
            signals["cycle/computing"] = Signal(t_ns, computing_ns[:, None] * 1e-9)
        states, events = self._states.decode(batch, signals)
        ordered = sorted([*block.events, *events], key=_time_of)
        return DecodedBlock(signals, states, tuple(ordered), counts, batch)

    def _per_cycle(
        self,
        batch: FrameBatch,
        rows: Ints,
        cycles: int,
        nodes: Sequence[int],
        kind: PdoKind,
        number: int,
        positions: Sequence[int],
    ) -> Matrix:
        """(cycles, nodes, positions) values of a PDO that every node sends once per cycle; NaN where none came."""
        out = np.full((cycles, len(nodes), len(positions)), np.nan)
        for column, node in enumerate(nodes):
            layout = self._layouts.get((node, kind, number))
            if layout is None:
                continue
            found = batch.rows(layout.can_id, layout.length)
            found = found[rows[found] >= 0]
            out[rows[found], column] = layout.values(batch.payload[found], positions)
        return out

    def _drives(self, batch: FrameBatch, rows: Ints, sync_ns: Ints, signals: dict[str, Signal]) -> None:
        due_ns = sync_ns + 2 * self._period_ns
        n = len(sync_ns)
        tpdo = self._per_cycle(batch, rows, n, DRIVE_IDS, PdoKind.TPDO, 1, (0, 1, 2))
        rpdo = self._per_cycle(batch, rows, n, DRIVE_IDS, PdoKind.RPDO, 1, (1, 2))
        speed = self._per_cycle(batch, rows, n, DRIVE_IDS, PdoKind.TPDO, 2, (0,))[..., 0]
        _keep(signals, "drives/statusword", sync_ns, tpdo[..., 0])
        _keep(signals, "wheels/position/actual", sync_ns, tpdo[:, :2, 1])
        _keep(signals, "wheels/effort", sync_ns, tpdo[:, :2, 2])
        _keep(signals, "wheels/velocity/actual", sync_ns, speed[:, :2])
        _keep(signals, "wheels/velocity/target", due_ns, rpdo[:, :2, 0])
        _keep(signals, "joints/position/actual", sync_ns, tpdo[:, 2:, 1])
        _keep(signals, "joints/effort", sync_ns, tpdo[:, 2:, 2])
        _keep(signals, "joints/velocity/actual", sync_ns, speed[:, 2:])
        _keep(signals, "joints/position/target", due_ns, rpdo[:, 2:, 0])
        _keep(signals, "joints/effort/offset", due_ns, rpdo[:, 2:, 1])
        _keep(signals, "platform/velocity/commanded", due_ns, rpdo[:, :2, 0] @ self._to_platform)
        self._encoder_velocity(signals)

    def _encoder_velocity(self, signals: dict[str, Signal]) -> None:
        """Platform velocity from the wheels' positions of successive cycles, at the middle of the interval."""
        wheels = signals.get("wheels/position/actual")
        if wheels is None:
            return
        whole = wheels.complete()
        if self._last_wheels is not None:
            before = self._last_wheels
            whole = Signal(np.append(before.t_ns, whole.t_ns), np.vstack([before.values, whole.values]))
        whole = whole.distinct()
        if not len(whole):
            return
        t_ns, position = whole.t_ns, whole.values
        self._last_wheels = whole.at(slice(-1, None))
        step_s = np.diff(t_ns)[:, None] * 1e-9
        velocity = (np.diff(position, axis=0) / step_s) @ self._to_platform
        _keep(signals, "platform/velocity/encoder", (t_ns[1:] + t_ns[:-1]) // 2, velocity)

    def _reference(
        self,
        batch: FrameBatch,
        rows: Ints,
        sync_ns: Ints,
        signals: dict[str, Signal],
        counts: dict[str, int],
    ) -> None:
        """Joins the three frames of each cycle's reference (same counter) and gives them the time that they are meant for."""
        n = len(sync_ns)
        parts = []
        for number, positions in ((2, (0, 1, 2)), (3, (0, 1, 2, 3)), (4, (0, 1, 2, 3))):
            layout = self._layouts.get((PLANNER_ID, PdoKind.TPDO, number))
            if layout is None:
                return
            found = self._checked(batch, layout, counts)
            found = found[rows[found] >= 0]
            part = np.full((n, len(positions)), np.nan)
            part[rows[found]] = layout.values(batch.payload[found], positions)
            parts.append(part)
        xy, z, rotation = parts
        whole = (xy[:, 2] == z[:, 3]) & (z[:, 3] == rotation[:, 3])
        any_part = ~(np.isnan(xy[:, 2]) & np.isnan(z[:, 3]) & np.isnan(rotation[:, 3]))
        counts["torn_references"] += int(np.sum(any_part & ~whole))
        found = np.flatnonzero(whole)
        if not len(found):
            return
        # numbered by their time, not one by one: a SYNC that got lost has its number all the same
        cycles = np.rint(sync_ns[found] / self._period_ns).astype(np.int64)
        due_ns = sync_ns[found] + (2 + self._lag(cycles, z[found, 2].astype(np.int64))) * self._period_ns
        valid = z[found, 1] > 0
        rises = valid & ~np.append(self._was_valid, valid[:-1])
        segment = self._segment + np.cumsum(rises)
        self._segment, self._was_valid = int(segment[-1]), bool(valid[-1])
        pose = np.hstack([xy[found, :2], z[found, :1], rotation[found, :3]])
        _keep(signals, "reference/pose", due_ns[valid], pose[valid])
        _keep(signals, "reference/segment", due_ns[valid], segment[valid, None].astype(np.float64))

    def _lag(self, cycles: Ints, sync_count: Ints) -> Ints:
        """By how many cycles the planner's own count differs from the SYNC that a reference came after: 0 if it was in time."""
        offset = sync_count - cycles
        if self._anchor is None:
            # in real time the first ones may have been late: the count of most of them holds
            self._anchor = int(offset[0]) + int(np.median(_wrap16(offset - offset[0])))
        lag = _wrap16(offset - self._anchor)
        if np.any(np.abs(lag) > _RESTART):
            self._anchor = int(offset[-1])
            lag = np.where(np.abs(lag) > _RESTART, _wrap16(offset - self._anchor), lag)
            lag = np.where(np.abs(lag) > _RESTART, 0, lag)
        return lag

    def _plain_frames(self, batch: FrameBatch, signals: dict[str, Signal], counts: dict[str, int]) -> None:
        """Frames that mean something each by itself: at their own time, those with a wrong checksum left out."""
        plain = (
            ("planner/state", PLANNER_ID, 1, (0, 1, 2, 3)),
            ("singularity/margins", PLANNER_ID, 5, (2, 3, 4, 5, 0, 1)),
            ("slip/estimate", PLANNER_ID, 6, (0, 1, 2, 3)),
            ("mission", STRATEGIC_ID, 4, (0, 1)),
            ("twist/linear", STRATEGIC_ID, 1, (0, 1, 2)),
            ("twist/angular", STRATEGIC_ID, 2, (0, 1, 2)),
            ("wrench/force", FORCE_SENSOR_ID, 1, (0, 1, 2)),
            ("wrench/torque", FORCE_SENSOR_ID, 2, (0, 1, 2)),
            ("tracker/xy", TRACKER_ID, 1, (0, 1, 2)),
            ("tracker/z", TRACKER_ID, 2, (0, 1, 2, 3)),
            ("tracker/rotation_vector", TRACKER_ID, 3, (0, 1, 2)),
        )
        for name, node, number, positions in plain:
            layout = self._layouts.get((node, PdoKind.TPDO, number))
            if layout is not None:
                found = self._checked(batch, layout, counts)
                _keep(signals, name, batch.t_ns[found], layout.values(batch.payload[found], positions))
        xy, z = signals.pop("tracker/xy", None), signals.pop("tracker/z", None)
        if xy is not None and z is not None:
            _tracker(xy, z, signals)

    def _checked(self, batch: FrameBatch, layout: PdoLayout, counts: dict[str, int]) -> Ints:
        found = batch.rows(layout.can_id, layout.length)
        good = checksum_ok(layout.can_id, batch.payload[found])
        counts["bad_checksums"] += int(np.sum(~good))
        return found[good]

    def _timing(self, batch: FrameBatch, rows: Ints, sync_ns: Ints, signals: dict[str, Signal]) -> None:
        signals["bus/after_sync"] = after_sync(batch, self._class_of, rows, sync_ns)
        late = sync_error(sync_ns, self._last_sync_ns, self._period_ns)
        if late is not None:
            signals["bus/sync_error"] = late
        self._last_sync_ns = int(sync_ns[-1])

    def _load(self, frames: Sequence[Frame], batch: FrameBatch, signals: dict[str, Signal]) -> None:
        """Bits of each window of 100 ms against the bit rate; the window that is still open is carried along."""
        if not len(frames):
            return
        bits = np.array([bit_length(frame.can_id, frame.data) for frame in frames], np.float64)
        window = batch.t_ns // LOAD_WINDOW_NS
        first = int(window[0]) if self._window is None else self._window
        index = np.maximum(window - first, 0)
        number = np.bincount(index).astype(np.float64)
        sums = load_by_class(self._class_of[batch.can_id], index, bits, len(number))
        sums[0] += self._window_bits
        number[0] += self._window_frames
        self._window, self._window_bits, self._window_frames = first + len(sums) - 1, sums[-1], number[-1]
        end_ns = (first + 1 + np.arange(len(sums))) * LOAD_WINDOW_NS
        share = sums[:-1] / self._bits_per_window
        _keep(signals, "bus/load", end_ns[:-1], share.sum(axis=1, keepdims=True))
        _keep(signals, "bus/load_by_class", end_ns[:-1], share)
        _keep(signals, "bus/frames", end_ns[:-1], number[:-1, None])


def _tracker(xy: Signal, z: Signal, signals: dict[str, Signal]) -> None:
    """Joins the two position frames of a sample: the nearest in time that carries the same counter."""
    if not len(xy) or not len(z):
        return
    after = np.clip(np.searchsorted(z.t_ns, xy.t_ns), 0, len(z) - 1)
    same = z.values[after, 3] == xy.values[:, 2]
    valid = same & (z.values[after, 1] > 0)
    rows = after[valid]
    _keep(signals, "tracker/position", xy.t_ns[valid], np.hstack([xy.values[valid, :2], z.values[rows, :1]]))
    _keep(signals, "tracker/age", xy.t_ns[valid], z.values[rows, 2:3])


def _truth(truths: Sequence[Truth], signals: dict[str, Signal]) -> None:
    if truths:
        t_ns = np.array([truth.t_ns for truth in truths], np.int64)
        for name in _TRUTH_FIELDS:
            signals[f"truth/{name}"] = Signal(t_ns, np.array([getattr(truth, name) for truth in truths], np.float64))
        for name in _TRUTH_OPTIONS:
            if getattr(truths[0], name) is not None:
                values = np.array([getattr(truth, name) for truth in truths], np.float64)
                signals[f"truth/{name}"] = Signal(t_ns, values)


def _last_sync(frames: Sequence[Frame]) -> int:
    """Index of the last SYNC; all frames when there is none, so that a bus without SYNC does not pile up."""
    for i in range(len(frames) - 1, -1, -1):
        if frames[i].can_id == SYNC_ID:
            return i
    return len(frames)


def _keep(signals: dict[str, Signal], name: str, t_ns: Ints, values: NDArray[np.float64]) -> None:
    """Adds a signal without the rows in which nothing was received."""
    received = ~np.isnan(values).all(axis=1)
    if received.any():
        signals[name] = Signal(t_ns[received], values[received])


def _wrap16(count: Ints) -> Ints:
    return (count + 32768) % 65536 - 32768


def _time_of(event: Event) -> int:
    return event.t_ns
