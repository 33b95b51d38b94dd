"""What is left of many runs: a row for each variant, a figure of the first measure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.figure import Figure
from numpy.typing import NDArray

from canipulator.campaigns.campaign import Summary
from canipulator.campaigns.tables import Sheet, spread, write_sheets


@dataclass(frozen=True)
class Measure:
    """A metric (dotted into metrics.json) as a column: shown times `scale`."""

    metric: str
    title: str
    scale: float


def summarise_runs(name: str, results: pa.Table, measures: Sequence[Measure], out: Path) -> Summary:
    """`summary.md`, `summary.csv` and `<name>.png`; runs that ended with an error are counted, not averaged."""
    groups = list(dict.fromkeys(results["group"].to_pylist()))
    sheet = Sheet(f"{name}: mean ± standard deviation over seeds", ["", "runs", "failed", *(m.title for m in measures)])
    series: dict[str, list[NDArray[np.float64]]] = {}
    for group in groups:
        of_group = results.filter(pc.equal(results["group"], group))
        failed = of_group.num_rows - of_group["error"].null_count
        columns = [measure.scale * column(of_group, measure.metric) for measure in measures]
        series[group] = columns
        sheet.add(group, str(of_group.num_rows), str(failed), *(spread(values) for values in columns))
    figure = out / f"{name}.png"
    _draw(name, {group: columns[0] for group, columns in series.items()}, measures[0].title, figure)
    return Summary((sheet.shown(),), (*write_sheets([sheet], out / "summary"), figure))


def column(table: pa.Table, name: str) -> NDArray[np.float64]:
    """(rows,), NaN where a row has no such number."""
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    values = [np.nan if value is None else float(value) for value in table[name].to_pylist()]
    return np.array(values, dtype=np.float64)


def _draw(name: str, values: dict[str, NDArray[np.float64]], label: str, path: Path) -> None:
    figure = Figure(figsize=(max(5.0, 0.45 * len(values) + 2.0), 3.6), layout="constrained")
    axes = figure.subplots()
    for i, found in enumerate(values.values()):
        known = found[np.isfinite(found)]
        axes.plot(np.full(known.size, i), known, "o", ms=3, alpha=0.5, color="tab:blue")
        if known.size:
            axes.plot([i - 0.3, i + 0.3], [known.mean()] * 2, color="black", lw=1.5)
    axes.set_xticks(range(len(values)), list(values), rotation=60, ha="right")
    axes.set_ylabel(label)
    axes.set_ylim(bottom=0.0)
    axes.set_title(f"{name}: every run, and the mean")
    figure.savefig(path, dpi=130)
