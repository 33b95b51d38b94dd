"""The folder of a campaign: one part file for each finished batch, from which it goes on after whatever killed it.

A part is written under another name, flushed to the disk, and renamed: it is there whole or not at all. Its name says which units it
holds, so what is missing is read off the folder; nothing is computed twice and counted twice.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from canipulator.campaigns.campaign import Batch, Campaign, Row, batches
from config.errors import ConfigError

_PART = re.compile(r"(?P<group>[a-z0-9_.-]+)--(?P<first>\d+)\+(?P<count>\d+)\.parquet")


class Store:
    """Opens `out` for one writer; `close` (or `with`) frees it again.

    Raises ConfigError if somebody else writes there, if it holds results and `resume` was not asked for, or if they belong to another
    campaign, seed or parameters; OSError where it cannot be written.
    """

    def __init__(self, out: Path, campaign: Campaign, seed: int, *, resume: bool) -> None:
        self.out, self.parts = out, out / "parts"
        self.parts.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(out)
        try:
            self._check(campaign, seed, resume=resume)
            for torn in self.parts.glob(".*.tmp"):
                torn.unlink()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Lets others write."""
        self._lock.close()

    def _check(self, campaign: Campaign, seed: int, *, resume: bool) -> None:
        path = self.out / "campaign.json"
        identity = {"campaign": campaign.name, "seed": seed, "parameters": dict(campaign.parameters())}
        identity = json.loads(json.dumps(identity))
        if not path.exists():
            if any(self._files()):
                raise ConfigError(f"{self.out}: has parts but no campaign.json; give another --out")
            _write_whole(path, json.dumps(identity, indent=1).encode())
            return
        found = json.loads(path.read_text(encoding="utf-8"))
        for key, value in identity.items():
            if found.get(key) != value:
                raise ConfigError(f"{self.out}: {_difference(key, found.get(key), value)}; give another --out")
        if not resume and any(self._files()):
            raise ConfigError(f"{self.out}: has results already; --resume goes on with them, or give another --out")

    def _files(self) -> Iterator[tuple[Path, Batch]]:
        for path in sorted(self.parts.iterdir()):
            if match := _PART.fullmatch(path.name):
                yield path, Batch(match["group"], int(match["first"]), int(match["count"]))

    def done(self) -> dict[str, set[int]]:
        """The units of each group that are on disk. ConfigError where two parts hold the same one: somebody has put them there."""
        found: dict[str, set[int]] = {}
        for path, batch in self._files():
            units = found.setdefault(batch.group, set())
            if not units.isdisjoint(batch.indices):
                raise ConfigError(f"{path}: holds units that another part holds, too; remove one of them")
            units.update(batch.indices)
        return found

    def missing(self, groups: Mapping[str, int], size: int) -> list[Batch]:
        """What is still to do for so many units of each group, the groups taking turns."""
        done = self.done()
        queues = [
            list(batches(group, (i for i in range(count) if i not in done.get(group, ())), size))
            for group, count in groups.items()
        ]
        longest = max((len(queue) for queue in queues), default=0)
        return [queue[i] for i in range(longest) for queue in queues if i < len(queue)]

    def keep(self, batch: Batch, rows: Sequence[Row]) -> None:
        """Makes the rows of a finished batch safe; when this returns they survive a crash."""
        sink = pa.BufferOutputStream()
        pq.write_table(pa.Table.from_pylist(list(rows)), sink, compression="zstd")
        name = f"{batch.group}--{batch.first}+{batch.count}.parquet"
        _write_whole(self.parts / name, sink.getvalue().to_pybytes())

    def results(self, groups: Mapping[str, int]) -> pa.Table:
        """All rows of the asked-for units, sorted by group and unit; also written to `results.parquet`.

        The order is that of `groups`, so the file does not depend on who computed what when.
        """
        order = {group: i for i, group in enumerate(groups)}
        files = sorted(
            ((path, batch) for path, batch in self._files() if batch.group in order),
            key=lambda found: (order[found[1].group], found[1].first),
        )
        tables = []
        for path, batch in files:
            table = pq.read_table(path)
            beyond = batch.first + batch.count - groups[batch.group]
            if beyond > 0:  # of a longer campaign that was in this folder before
                table = table.filter(pc.less(table["index"], groups[batch.group]))
            tables.append(table)
        merged = pa.concat_tables(tables, promote_options="permissive").combine_chunks() if tables else pa.table({})
        sink = pa.BufferOutputStream()
        pq.write_table(merged, sink, compression="zstd")
        _write_whole(self.out / "results.parquet", sink.getvalue().to_pybytes())
        return merged


def _locked(out: Path) -> TextIO:
    lock = (out / ".lock").open("a", encoding="utf-8")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        raise ConfigError(f"{out}: another campaign is writing there") from None
    return lock


def _write_whole(path: Path, content: bytes) -> None:
    temporary = path.with_name(f".{path.name}.tmp")
    with temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def _difference(key: str, found: Any, wanted: Any) -> str:
    if isinstance(found, dict) and isinstance(wanted, dict):
        for name in sorted({*found, *wanted}):
            if found.get(name) != wanted.get(name):
                return f"its results are for {name} = {found.get(name)}, not {wanted.get(name)}"
    return f"its results are for {key} {found}, not {wanted}"
