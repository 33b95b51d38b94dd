"""What a campaign is: groups of numbered units, each computed on its own from a seed of its own."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
from rich.console import RenderableType

Row = dict[str, str | int | float | bool | None]
"""One line of the results; the columns `group` and `index` are added to it."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Units `first` … `first + count − 1` of a group: what is sent to a worker, and what one part file holds."""

    group: str
    first: int
    count: int

    @property
    def indices(self) -> range:
        """The numbers of its units."""
        return range(self.first, self.first + self.count)


@dataclass(frozen=True)
class Summary:
    """What a finished campaign shows: things for the terminal, files that were written. `holds`: None where nothing was to be judged."""

    shown: tuple[RenderableType, ...]
    files: tuple[Path, ...]
    holds: bool | None = None


class Campaign(Protocol):
    """A picklable description (workers get a copy) of what to compute and how to sum it up.

    `name`: as on the command line. `batch`: units in one task, some seconds of work, so that handing them out costs nothing.
    `unit_name`: what a unit is called in counts ("pairs", "runs").
    """

    @property
    def name(self) -> str: ...
    @property
    def batch(self) -> int: ...
    @property
    def unit_name(self) -> str: ...

    def groups(self, pairs: int | None) -> Mapping[str, int]:
        """How many units there are of each group for `--pairs`; None: the campaign's own number. Names are lower case, digits, `_.-`."""

    def parameters(self) -> Mapping[str, Any]:
        """Everything beside the seed that the numbers depend on, for JSON: parts with other parameters are never mixed."""

    def warm_up(self, group: str) -> None:
        """Runs once in each worker and group, before the first unit: whatever must not show up in a unit's computing time."""

    def compute(self, group: str, index: int, seed: int) -> Iterable[Row]:
        """The rows of one unit, from nothing but its arguments (`unit_generator`): the same on every worker and in every order."""

    def summarise(self, results: pa.Table, out: Path) -> Summary:
        """Tables and figures of all rows into `out`."""


def unit_generator(seed: int, stream: str, index: int) -> np.random.Generator:
    """The random numbers of one unit: Philox with the campaign's seed and the stream's name as its key, the unit's number in its counter.

    No unit depends on how many others there are or on which were drawn before; streams are 2¹²⁸ draws apart, so they never meet.
    """
    stream_key = int.from_bytes(hashlib.sha256(stream.encode()).digest()[:8], "little")
    bits = np.random.Philox(
        key=np.array([seed, stream_key], dtype=np.uint64), counter=np.array([0, 0, index, 0], dtype=np.uint64)
    )
    return np.random.Generator(bits)


def batches(group: str, missing: Iterable[int], size: int) -> Iterator[Batch]:
    """The units of ascending numbers `missing` in stretches without gaps, none longer than `size`."""
    first: int | None = None
    count = 0
    for index in missing:
        if first is not None and index == first + count and count < size:
            count += 1
            continue
        if first is not None:
            yield Batch(group, first, count)
        first, count = index, 1
    if first is not None:
        yield Batch(group, first, count)
