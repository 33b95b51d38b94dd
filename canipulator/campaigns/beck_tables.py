"""The three tables of Beck et al. with ours beside them, what must hold in them, and figures of the distributions."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.figure import Figure
from numpy.typing import NDArray

from canipulator.campaigns.campaign import Summary
from canipulator.campaigns.run_tables import column
from canipulator.campaigns.tables import Sheet, spread, write_sheets

OBJECTIVES = ("none", "manipulability", "potentials")


@dataclass(frozen=True)
class Published:
    """A column of the paper's table: t_F (s) and computing time (ms) as mean, std; m_min, m_max, m_avg over all its trajectories."""

    t_f: tuple[float, float]
    time_ms: tuple[float, float]
    m_min: float
    m_max: float
    m_avg: float


PAPER: Mapping[str, Mapping[str, Published]] = {
    "comau_racer7": {
        "none": Published((2.3174, 0.46), (10.4, 5.8), 2.0e-7, 0.466, 0.16),
        "manipulability": Published((3.82, 0.73), (27.3, 18.3), 6.6e-6, 0.466, 0.362),
        "potentials": Published((4.07, 2.15), (21.5, 15.8), 1.0e-4, 0.466, 0.19),
    },
    "iiwa14": {
        "none": Published((2.67, 0.48), (11.4, 6.3), 5.3e-8, 0.159, 0.061),
        "manipulability": Published((9.75, 1.73), (62.3, 26.7), 1.8e-7, 0.16, 0.142),
        "potentials": Published((5.03, 2.59), (43.8, 29.1), 1.0e-4, 0.159, 0.067),
    },
    "panda": {
        "none": Published((2.44, 0.29), (11.1, 5.5), 6.5e-6, 0.128, 0.04),
        "manipulability": Published((11.3, 2.29), (245.3, 377.0), 6.8e-5, 0.13, 0.112),
        "potentials": Published((4.96, 3.11), (72.3, 57.5), 3.1e-4, 0.129, 0.057),
    },
}
"""(i7 at 3.4 GHz, IPOPT with MA27 and CasADi, 10⁴ pairs for each robot.)"""

Columns = Mapping[str, NDArray[np.float64]]


def summarise_pairs(results: pa.Table, out: Path, note: str) -> Summary:
    """`summary.md`, `summary.csv`, a figure for each robot. `holds`: whether m_avg and computing time order as in the paper.

    The paper's ordering of m_min is shown, but decides nothing: where a motion's least manipulability is that of an end point, the draw has
    fixed it, not the objective (row "m_min is an end point's").

    Only pairs that all three objectives have solved count, so that the columns are about the same motions; how many each solved is shown.
    """
    if "objective" not in results.column_names:  # every unit failed
        return Summary((), ())
    robots = [robot for robot in PAPER if robot in set(results["group"].to_pylist())]
    sheets, figures, verdicts = [], [], []
    claims = Sheet("The paper's orderings", ["", "robot", "measured", "holds", "decides"])
    for robot in robots:
        found, solved = solved_by_all(results.filter(pc.equal(results["group"], robot)))
        sheets.append(_sheet(robot, found, solved, note))
        for claim in _claims(found):
            verdict = "yes" if claim.holds else "NO"
            claims.add(claim.text, robot, claim.measured, verdict, "yes" if claim.decides else "no: reported")
            if claim.decides:
                verdicts.append(claim.holds)
        figures.append(_draw(robot, found, out / f"{robot}.png"))
    shown = [*sheets, claims]
    files = (*write_sheets(shown, out / "summary"), *figures)
    return Summary(tuple(sheet.shown() for sheet in shown), files, all(verdicts) if verdicts else None)


def solved_by_all(table: pa.Table) -> tuple[dict[str, Columns], dict[str, tuple[int, int]]]:
    """For each objective: the columns of the pairs that all have solved, in the same order; and (solved, tried)."""
    ok = column(table, "solved") == 1.0
    index, objective = column(table, "index"), np.array(table["objective"].to_pylist(), dtype=object)
    solved = {name: (int(ok[objective == name].sum()), int((objective == name).sum())) for name in OBJECTIVES}
    common = set(index[ok & (objective == OBJECTIVES[0])])
    for name in OBJECTIVES[1:]:
        common &= set(index[ok & (objective == name)])
    of_all = np.isin(index, np.array(sorted(common)))
    names = [name for name in table.column_names if name not in ("group", "objective", "error", "status")]
    values = {name: column(table, name) for name in names}
    values["rough"] = np.array([float(status == "ACCEPTABLE") for status in table["status"].to_pylist()])
    return {
        name: {key: found[of_all & (objective == name)] for key, found in values.items()} for name in OBJECTIVES
    }, solved


def _sheet(robot: str, found: Mapping[str, Columns], solved: Mapping[str, tuple[int, int]], note: str) -> Sheet:
    pairs = found[OBJECTIVES[0]]["index"].size
    sheet = Sheet(
        f"{robot}: {pairs} pairs", ["", *(f"{name}{of}" for name in OBJECTIVES for of in ("", " (paper)"))], note
    )
    paper = PAPER[robot]

    def add(text: str, ours: Sequence[str], theirs: Sequence[str]) -> None:
        sheet.add(text, *(cell for both in zip(ours, theirs, strict=True) for cell in both))

    columns = [found[name] for name in OBJECTIVES]
    published = [paper[name] for name in OBJECTIVES]
    nothing = ["–"] * len(OBJECTIVES)
    add("t_F (s)", [spread(c["t_f"]) for c in columns], [f"{p.t_f[0]:g} ± {p.t_f[1]:g}" for p in published])
    add(
        "computing time (ms)",
        [spread(1e3 * c["computing_s"]) for c in columns],
        [f"{p.time_ms[0]:g} ± {p.time_ms[1]:g}" for p in published],
    )
    add("m_min, of all nodes", [_least(c["m_min"]) for c in columns], [f"{p.m_min:.1e}" for p in published])
    add("m_min of the end points alone", [_least(c["end_points_m_min"]) for c in columns], nothing)
    add("m_min is an end point's (% of the pairs)", [_share(at_an_end(c)) for c in columns], nothing)
    add("m_min, median of the pairs", [_median(c["m_min"]) for c in columns], nothing)
    add("m_max", [f"{c['m_max'].max():.3g}" if pairs else "–" for c in columns], [f"{p.m_max:g}" for p in published])
    add("m_avg", [spread(c["m_avg"]) for c in columns], [f"{p.m_avg:g}" for p in published])
    add("path length (m)", [spread(c["path_m"]) for c in columns], nothing)
    add("rotation length (rad)", [spread(c["rotation_rad"]) for c in columns], nothing)
    add("iterations", [spread(c["iterations"]) for c in columns], nothing)
    add("solved", [f"{ok} of {tried}" for ok, tried in (solved[name] for name in OBJECTIVES)], nothing)
    add("of the pairs only roughly", [str(int(c["rough"].sum())) for c in columns], nothing)
    return sheet


@dataclass(frozen=True, slots=True)
class _Claim:
    """An ordering of the paper; `decides`: the campaign fails without it."""

    text: str
    measured: str
    holds: bool
    decides: bool = True


def _claims(found: Mapping[str, Columns]) -> list[_Claim]:
    none, manip, potentials = (found[name] for name in OBJECTIVES)
    if none["index"].size == 0:
        return []
    m_min = [float(c["m_min"].min()) for c in (none, manip, potentials)]
    m_avg = [float(c["m_avg"].mean()) for c in (none, potentials, manip)]
    times = [1e3 * float(c["computing_s"].mean()) for c in (potentials, manip)]
    return [
        _Claim("m_avg: none < potentials < manipulability", " < ".join(f"{m:.3f}" for m in m_avg), _rising(m_avg)),
        _Claim("computing time: potentials < manipulability", " < ".join(f"{t:.1f} ms" for t in times), _rising(times)),
        _Claim(
            "m_min: none < manipulability < potentials",
            " < ".join(f"{m:.2e}" for m in m_min),
            _rising(m_min),
            decides=False,
        ),
    ]


def at_an_end(columns: Columns) -> NDArray[np.bool_]:
    """(pairs,) Whether a motion's least manipulability is that of its start or target: no objective can raise it."""
    lowest: NDArray[np.bool_] = columns["m_min"] >= columns["end_points_m_min"] * (1.0 - 1e-6)
    return lowest


def _draw(robot: str, found: Mapping[str, Columns], path: Path) -> Path:
    figure = Figure(figsize=(10.0, 3.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for name in OBJECTIVES:
        columns = found[name]
        for axes, values in ((left, columns["m_min"]), (middle, columns["t_f"]), (right, 1e3 * columns["computing_s"])):
            axes.ecdf(values[np.isfinite(values)], label=name)
    for name, colour in zip(OBJECTIVES, ("C0", "C1", "C2"), strict=True):
        middle.axvline(PAPER[robot][name].t_f[0], color=colour, ls=":", lw=1.0)
        right.axvline(PAPER[robot][name].time_ms[0], color=colour, ls=":", lw=1.0)
    for axes, label in (
        (left, "least manipulability of a motion"),
        (middle, "t_F (s)"),
        (right, "computing time (ms)"),
    ):
        axes.set_xlabel(label)
    left.set_xscale("log")
    right.set_xscale("log")
    left.set_ylabel("share of the pairs")
    left.legend(fontsize="small")
    figure.suptitle(f"{robot}: {found[OBJECTIVES[0]]['index'].size} pairs (dotted: the paper's means)")
    figure.savefig(path, dpi=130)
    return path


def _least(values: NDArray[np.float64]) -> str:
    return f"{values.min():.1e}" if values.size else "–"


def _share(which: NDArray[np.bool_]) -> str:
    return f"{100.0 * which.mean():.1f}" if which.size else "–"


def _median(values: NDArray[np.float64]) -> str:
    return f"{np.median(values):.1e}" if values.size else "–"


def _rising(values: Sequence[float]) -> bool:
    return all(a < b for a, b in itertools.pairwise(values))
