"""Columns of numbers and texts on their way to a recording, with every timeline, each index computed once per block."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from logs.signals import Ints, Signal

TIMELINE = "sim_time"
WALL_CLOCK = "wall_clock"
KEPT_CYCLES = 1024
_SCALARS = next(iter(rr.Scalars.columns(scalars=[0.0]))).component_descriptor()
_TEXT, _LEVEL = (column.component_descriptor() for column in rr.TextLog.columns(text=[""], level=["INFO"]))


@dataclass(frozen=True, slots=True)
class WallClock:
    """Unix time `epoch_ns` at time 0 of the run, which goes by at `pace` seconds per second of real time."""

    epoch_ns: int
    pace: float = 1.0


@dataclass(frozen=True, slots=True)
class _Times:
    """A finished column of times, as `send_columns` takes it."""

    name: str
    times: Any

    def timeline_name(self) -> str:
        return self.name

    def as_arrow_array(self) -> Any:
        return self.times


@dataclass(frozen=True, slots=True)
class _Values:
    """A finished column of lists, as `send_columns` takes it."""

    descriptor: Any
    values: Any

    def component_descriptor(self) -> Any:
        return self.descriptor

    def as_arrow_array(self) -> Any:
        return self.values


class ColumnSender:
    """Sends columns of one run to `stream`, on `sim_time`, `arm_cycle`, `platform_cycle` and, in real time, `wall_clock`."""

    def __init__(
        self, stream: rr.RecordingStream, period_ns: int, platform_ratio: int, wall_clock: WallClock | None = None
    ) -> None:
        self._stream, self._period_ns, self._ratio, self._wall_clock = stream, period_ns, platform_ratio, wall_clock
        self._sync_ns = np.empty(0, np.int64)
        self._sync_cycle = np.empty(0, np.int64)
        self._indexes: dict[bytes, list[_Times]] = {}

    def begin_block(self, sync: Signal | None) -> None:
        """Keeps the SYNC times of this block and those before it: rows may be older than their block."""
        self._indexes.clear()
        if sync is not None:
            keep = len(sync) + KEPT_CYCLES
            self._sync_ns = np.append(self._sync_ns, sync.t_ns)[-keep:]
            self._sync_cycle = np.append(self._sync_cycle, sync.values.astype(np.int64))[-keep:]

    def columns(self, path: str, t_ns: Ints, columns: Iterable[Any]) -> None:
        """Columns of one entity at the times `t_ns` (n,)."""
        self._stream.send_columns(path, indexes=self._index(t_ns), columns=columns)

    def scalars(self, path: str, t_ns: Ints, values: NDArray[np.float64]) -> None:
        """Values (n,) or (n, m): m series of one entity."""
        flat = pa.array(np.ascontiguousarray(values, np.float64).reshape(-1))
        lists = pa.ListArray.from_arrays(_offsets(len(t_ns), len(flat) // max(1, len(t_ns))), flat)
        self.columns(path, t_ns, [_Values(_SCALARS, lists)])

    def texts(self, path: str, t_ns: Ints, texts: Sequence[str], levels: Sequence[str] | None = None) -> None:
        """Lines of a log, with their levels if they have such."""
        ones = _offsets(len(t_ns), 1)
        lines = pa.ListArray.from_arrays(ones, pa.array(texts, pa.string()))
        columns = [_Values(_TEXT, lines)]
        if levels is not None:
            columns.append(_Values(_LEVEL, pa.ListArray.from_arrays(ones, pa.array(levels, pa.string()))))
        self.columns(path, t_ns, columns)

    def _index(self, t_ns: Ints) -> list[_Times]:
        key = t_ns.tobytes()
        found = self._indexes.get(key)
        if found is None:
            cycles = self._cycles(t_ns)
            found = [
                _Times(TIMELINE, pa.array(t_ns.astype("timedelta64[ns]"), pa.duration("ns"))),
                _Times("arm_cycle", pa.array(cycles, pa.int64())),
                _Times("platform_cycle", pa.array(cycles // self._ratio, pa.int64())),
            ]
            if (wall := self._wall_clock) is not None:
                unix_ns = wall.epoch_ns + (t_ns / wall.pace).astype(np.int64)
                found.append(_Times(WALL_CLOCK, pa.array(unix_ns.astype("datetime64[ns]"), pa.timestamp("ns"))))
            self._indexes[key] = found
        return found

    def _cycles(self, t_ns: Ints) -> Ints:
        """Arm cycle of each time: that of the last SYNC at or before it; counted on by the period after the last one."""
        if not len(self._sync_ns):
            return np.zeros(len(t_ns), np.int64)
        row = np.clip(np.searchsorted(self._sync_ns, t_ns, "right") - 1, 0, len(self._sync_ns) - 1)
        beyond = (t_ns - self._sync_ns[-1]) // self._period_ns
        return np.where(
            row == len(self._sync_ns) - 1, self._sync_cycle[-1] + np.maximum(beyond, 0), self._sync_cycle[row]
        )


@lru_cache(maxsize=256)
def _offsets(rows: int, width: int) -> Any:
    return pa.array(np.arange(rows + 1, dtype=np.int32) * width)
