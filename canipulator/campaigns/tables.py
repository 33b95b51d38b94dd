"""A table once, in three dresses: for the terminal, as CSV, as Markdown."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table


class Sheet:
    """Column heads and rows of text; `title` and `note` (what the reader has to know) go with it."""

    def __init__(self, title: str, heads: Sequence[str], note: str = "") -> None:
        self.title, self.heads, self.note = title, tuple(heads), note
        self.rows: list[tuple[str, ...]] = []

    def add(self, *cells: str) -> None:
        """One row, a cell for each head; ValueError for another number of them."""
        if len(cells) != len(self.heads):
            raise ValueError(f"{len(cells)} cells, expected {len(self.heads)}")
        self.rows.append(cells)

    def shown(self) -> Table:
        """For the terminal."""
        table = Table(title=self.title, caption=self.note or None, title_justify="left", caption_justify="left")
        for i, head in enumerate(self.heads):
            table.add_column(head, justify="left" if i == 0 else "right", no_wrap=i == 0)
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        """A section with the table and its note."""
        lines = [f"## {self.title}", "", _line(self.heads), _line(["---"] * len(self.heads))]
        lines += [_line(row) for row in self.rows]
        return "\n".join([*lines, *(["", self.note] if self.note else []), ""])


def write_sheets(sheets: Sequence[Sheet], stem: Path) -> tuple[Path, Path]:
    """`stem`.md and `stem`.csv, the sheets one after the other (in the CSV with the title in the first column)."""
    text, numbers = stem.with_suffix(".md"), stem.with_suffix(".csv")
    text.write_text("\n".join(sheet.markdown() for sheet in sheets), encoding="utf-8")
    with numbers.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        for sheet in sheets:
            writer.writerow(("table", *sheet.heads))
            writer.writerows((sheet.title, *row) for row in sheet.rows)
    return text, numbers


def spread(values: NDArray[np.float64], digits: int = 3) -> str:
    """Mean ± standard deviation, numbers that are missing left out; "–" where there is none."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return "–"
    return f"{known.mean():.{digits}g} ± {known.std():.2g}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
