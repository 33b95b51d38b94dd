"""What a finished recording holds, back as arrays: the numbers, the platform's poses and the paths, without the viewer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader

from logs.columns import TIMELINE
from logs.signals import Signal
from stack.messages import Matrix

_SCALARS, _TRANSLATION, _QUATERNION, _STRIPS = (
    "Scalars:scalars",
    "Transform3D:translation",
    "Transform3D:quaternion",
    "LineStrips3D:strips",
)


@dataclass(frozen=True, slots=True, eq=False)
class Strips:
    """Pieces of a path: each ends at its time (n,), its points are (k, 3), evenly spaced in time from the end of the piece before."""

    t_ns: tuple[int, ...]
    points: tuple[Matrix, ...]

    def positions(self) -> Signal:
        """All points with their times; those where two pieces meet once. Empty where there is no path."""
        times, points, last_ns = [np.empty(0, np.int64)], [np.empty((0, 3))], None
        for t_ns, piece in zip(self.t_ns, self.points, strict=True):
            if last_ns is not None and len(piece) > 1 and t_ns > last_ns:
                times.append(np.linspace(last_ns, t_ns, len(piece)).astype(np.int64)[1:])
                points.append(piece[1:])
            last_ns = t_ns
        return Signal(np.concatenate(times), np.vstack(points))


@dataclass(frozen=True, slots=True)
class Recording:
    """By entity path without its first slash: `series` of numbers, transforms as (n, 7) position and quaternion xyzw; `paths`."""

    series: Mapping[str, Signal]
    paths: Mapping[str, Strips]


def read_recording(path: Path) -> Recording:
    """Raises OSError when the file cannot be read, ValueError when it is no recording of a run (or torn: see `optimise`)."""
    with path.open("rb"):  # an error of the file system names the file
        pass
    parts: dict[str, list[Signal]] = {}
    strips: dict[str, list[tuple[int, Matrix]]] = {}
    try:
        for chunk in RrdReader(str(path)).stream():
            batch = None if chunk.is_static else chunk.to_record_batch()
            if batch is not None and TIMELINE in batch.schema.names:
                _take(str(chunk.entity_path).lstrip("/"), batch, parts, strips)
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{path}: not a recording that can be read: {error}") from None
    return Recording(
        {name: _joined(signals) for name, signals in parts.items()},
        {name: _sorted(pieces) for name, pieces in strips.items()},
    )


def _take(name: str, batch: Any, parts: dict[str, list[Signal]], strips: dict[str, list[tuple[int, Matrix]]]) -> None:
    columns = batch.schema.names
    t_ns = batch.column(TIMELINE).to_numpy(zero_copy_only=False).astype(np.int64)
    if _SCALARS in columns:
        _keep(parts, name, t_ns, _rows(batch.column(_SCALARS), 0))
    elif _TRANSLATION in columns and _QUATERNION in columns:
        position, quaternion = _rows(batch.column(_TRANSLATION), 3), _rows(batch.column(_QUATERNION), 4)
        if position is not None and quaternion is not None:
            _keep(parts, name, t_ns, np.hstack([position, quaternion]))
    elif _STRIPS in columns:
        for t, row in zip(t_ns.tolist(), batch.column(_STRIPS).to_pylist(), strict=True):
            strips.setdefault(name, []).extend((t, np.array(piece, np.float64).reshape(-1, 3)) for piece in row or ())


def _rows(column: Any, inner: int) -> Matrix | None:
    """(n, k) of a column of equally long lists (of vectors of length `inner`); None where rows are missing or differ in length."""
    if column.null_count or not len(column):
        return None
    flat = column.flatten()
    if inner:
        flat = flat.flatten()
    values = np.asarray(flat.to_numpy(zero_copy_only=False), np.float64)
    return values.reshape(len(column), -1) if len(values) % len(column) == 0 else None


def _keep(parts: dict[str, list[Signal]], name: str, t_ns: np.ndarray, values: Matrix | None) -> None:
    if values is not None:
        parts.setdefault(name, []).append(Signal(t_ns, values))


def _joined(signals: list[Signal]) -> Signal:
    t_ns, values = np.concatenate([s.t_ns for s in signals]), np.vstack([s.values for s in signals])
    order = np.argsort(t_ns, kind="stable")
    return Signal(t_ns[order], values[order])


def _sorted(pieces: list[tuple[int, Matrix]]) -> Strips:
    ordered = sorted(pieces, key=lambda piece: piece[0])
    return Strips(tuple(t for t, _ in ordered), tuple(points for _, points in ordered))
