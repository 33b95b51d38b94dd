"""Named signals of a run: columns of values with their own times, and the table that holds a whole run of them.

Signals that the decoder makes from frames and truth, all in SI units. "cycle" rows are one per SYNC, NaN where a frame is missing.

| name | columns | time |
| --- | --- | --- |
| `sync` | number of the arm cycle, from 0 | SYNC |
| `joints/position/actual`, `joints/effort`, `drives/statusword` | one per drive | cycle; sampled at that SYNC |
| `joints/velocity/actual`, `wheels/velocity/actual` | one per drive | every tenth cycle |
| `joints/position/target`, `wheels/velocity/target`, `joints/effort/offset` | one per drive | SYNC + 2 T: when it is reached |
| `wheels/position/actual`, `wheels/effort` | left, right | cycle |
| `platform/velocity/commanded`, `platform/velocity/encoder` | v, ω | as the wheels' |
| `reference/pose` | x y z, rotation vector, in the frame R | SYNC + 2 T, valid ones only |
| `reference/segment` | counts from 1, one more for each time that references become valid | as `reference/pose` |
| `planner/state` | phase, status, restrictions, path scale | frame |
| `singularity/margins` | KS, AS, SS, SAS; kind, nearest manifold | frame |
| `slip/estimate` | slip ratio left, right; tracked poses taken in, rejected (modulo 256) | frame |
| `mission` | mode, step | frame |
| `twist/linear`, `twist/angular`, `wrench/force`, `wrench/torque` | x y z | frame |
| `tracker/position`, `tracker/rotation_vector`, `tracker/age` | x y z; s | frame |
| `bus/load`, `bus/frames` | share of the bit rate; frames | end of each 100 ms |
| `bus/load_by_class`, `bus/after_sync` | one per class of messages, see `logs.bus_timing` | as `bus/load`; SYNC |
| `bus/sync_error` | s later than due | SYNC |
| `cycle/computing` | s that the planner computed | SYNC |
| `truth/...` | as in `Truth`: `pose_WB`, `pose_WE` (n, 4, 4), `q`, `dq`, `effort`, … | truth sample |
| `truth/door`, `truth/handle_force`, `truth/hand`, `truth/body_poses` | as in `Truth`, where there is such a thing | truth sample |
| `tcp/error` | distance m, lateral m, rotation rad | truth sample with a valid reference |
| `tcp/commanded` | reference in the world: position, quaternion xyzw | as `tcp/error` |
| `manipulability`, `singular_values/…`, `ellipsoid/…` | see `logs.dexterity` | 20 Hz |
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from logs.events import Event
from logs.frame_batch import FrameBatch

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Signal:
    """Values (n, ...) of one name at the times `t_ns` (n,)."""

    t_ns: Ints
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        if len(self.t_ns) != len(self.values):
            raise ValueError(f"a signal of {len(self.values)} values has {len(self.t_ns)} times")

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Times in seconds."""
        return np.asarray(self.t_ns * 1e-9, np.float64)

    def complete(self) -> Signal:
        """The rows in which no value is missing."""
        missing = np.isnan(self.values).reshape(len(self), -1)
        return self.at(np.flatnonzero(~missing.any(axis=1)))

    def distinct(self) -> Signal:
        """The first row of each time: in real time, ticks that were late together are sampled at one, and nothing has a rate there."""
        return self.at(np.flatnonzero(np.diff(self.t_ns, prepend=self.t_ns[:1] - 1) > 0))

    def at(self, rows: Ints | slice | NDArray[np.bool_]) -> Signal:
        """Some of the rows."""
        return Signal(self.t_ns[rows], self.values[rows])


@dataclass(frozen=True, slots=True)
class StateChange:
    """A lane (a drive, the planner's phase …) takes a new state."""

    t_ns: int
    lane: str
    state: str


@dataclass(frozen=True, slots=True)
class DecodedBlock:
    """What a stretch of the run says: signals by name, state changes and events in the order of time, frames that were bad."""

    signals: Mapping[str, Signal]
    states: tuple[StateChange, ...] = ()
    events: tuple[Event, ...] = ()
    counts: Mapping[str, int] | None = None
    frames: FrameBatch | None = None


class SignalTable:
    """All signals of a run, joined from the blocks that were added."""

    def __init__(self, blocks: Iterable[DecodedBlock] = ()) -> None:
        self._parts: dict[str, list[Signal]] = {}
        self.states: list[StateChange] = []
        self.events: list[Event] = []
        self.counts: dict[str, int] = {}
        for block in blocks:
            self.add(block)

    def add(self, block: DecodedBlock) -> None:
        """Appends one block."""
        for name, signal in block.signals.items():
            if len(signal):
                self._parts.setdefault(name, []).append(signal)
        self.states.extend(block.states)
        self.events.extend(block.events)
        for name, count in (block.counts or {}).items():
            self.counts[name] = self.counts.get(name, 0) + count

    def __contains__(self, name: str) -> bool:
        return name in self._parts

    def __getitem__(self, name: str) -> Signal:
        """The whole signal. Raises KeyError that names the nearest one when nothing of that name was received."""
        parts = self._parts.get(name)
        if parts is None:
            near = difflib.get_close_matches(name, self._parts, 1)
            raise KeyError(f"no signal {name!r} in this run" + (f"; did you mean {near[0]!r}?" if near else ""))
        if len(parts) > 1:
            joined = Signal(np.concatenate([p.t_ns for p in parts]), np.concatenate([p.values for p in parts]))
            self._parts[name] = parts = [joined]
        return parts[0]

    def get(self, name: str) -> Signal | None:
        """The whole signal, or None when nothing of that name was received."""
        if name not in self._parts:
            return None
        return self[name]

    def names(self) -> list[str]:
        """Names of the signals that have values, sorted."""
        return sorted(self._parts)


class Decimation:
    """Picks rows at a fixed rate of run time: the first one in every step, over any number of blocks."""

    def __init__(self, rate_hz: float) -> None:
        self._step_ns = round(1e9 / rate_hz)
        self._next: int | None = None

    def due(self, t_ns: Ints) -> Ints:
        """Indices into `t_ns` (ascending) of the rows to take."""
        if not len(t_ns):
            return np.empty(0, np.int64)
        step = t_ns // self._step_ns
        new = np.append(self._next is None or int(step[0]) >= self._next, np.diff(step) > 0)
        self._next = int(step[-1]) + 1
        return np.flatnonzero(new)
