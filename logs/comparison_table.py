"""The metrics of several runs side by side, for the terminal and (Markdown) for the recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table
from rich.text import Text

_MACHINE = ("wall_time_s", "real_time_factor", "physics_only_real_time_factor", "arm_cycle_us")
"""Metrics of the machine, not of the robot: they differ from run to run, and are not marked."""
SAME_SHARE = 1e-9
TEXT_LENGTH = 26


@dataclass(frozen=True, slots=True)
class Row:
    """One metric: its values in the order of the runs, None where a run does not have it."""

    name: str
    values: tuple[Any, ...]
    differs: bool

    def change(self, i: int) -> str:
        """Of value `i` against the first, for numbers that differ: in per cent, or as a difference where the first is 0."""
        first, other = self.values[0], self.values[i]
        if self.name == "seed" or not self.differs or not _is_number(first) or not _is_number(other) or first == other:
            return ""
        return f"{100.0 * (other - first) / abs(first):+.1f} %" if first else f"{other - first:+.4g}"


def metric_rows(metrics: Sequence[Mapping[str, Any]]) -> list[Row]:
    """All metrics of all runs, nested ones under dotted names, in the order of the first run that has them."""
    flat = [_flat(values) for values in metrics]
    names = dict.fromkeys(name for values in flat for name in values)
    return [_row(name, tuple(values.get(name) for values in flat)) for name in names]


def comparison_table(labels: Sequence[str], titles: Sequence[str], rows: Sequence[Row]) -> Table:
    """For `console.print`: differences in bold with their size, what is the same in grey."""
    table = Table(box=None, padding=(0, 1), show_edge=False)
    table.add_column("metric", overflow="fold")
    for label, title in zip(labels, titles, strict=True):
        table.add_column(f"{label}  {title}", justify="right", no_wrap=True)
        if label != labels[0]:
            table.add_column("", justify="right", style="yellow", no_wrap=True)
    for row in rows:
        cells: list[Text] = [Text("* " + row.name if row.differs else "  " + row.name)]
        for i, value in enumerate(row.values):
            cells.append(Text(_cut(shown(value))))
            if i:
                cells.append(Text(row.change(i)))
        table.add_row(*cells, style="bold" if row.differs else "dim")
    return table


def markdown(labels: Sequence[str], titles: Sequence[str], rows: Sequence[Row]) -> str:
    """The same table for a text view."""
    head = ["metric", *(f"{label}: {title}" for label, title in zip(labels, titles, strict=True))]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        changes = [row.change(i) for i in range(len(row.values))]
        cells = [shown(value) + (f" ({text})" if text else "") for value, text in zip(row.values, changes, strict=True)]
        lines.append("| " + " | ".join([f"**{row.name}**" if row.differs else row.name, *cells]) + " |")
    return "\n".join(lines)


def shown(value: Any) -> str:
    """A value in few characters."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.5g}"
    return str(value)


def _cut(text: str) -> str:
    """Lists of faults and the like, so that the numbers keep their room."""
    return text if len(text) <= TEXT_LENGTH else text[: TEXT_LENGTH - 1] + "…"


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{key}.")
        elif key == "expectations" and isinstance(value, list):
            missed = [str(verdict.get("name")) for verdict in value if not verdict.get("ok")]
            found["expectations_missed"] = ", ".join(missed) or ("none" if value else None)
        elif isinstance(value, list):
            found[prefix + key] = "; ".join(map(str, value)) or "none"
        else:
            found[prefix + key] = value
    return found


def _row(name: str, values: tuple[Any, ...]) -> Row:
    machine = name.split(".")[0] in _MACHINE
    return Row(name, values, not machine and any(not _same(values[0], value) for value in values[1:]))


def _same(a: Any, b: Any) -> bool:
    if _is_number(a) and _is_number(b):
        return bool(abs(a - b) <= SAME_SHARE * max(abs(a), abs(b)))
    return bool(a == b)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
