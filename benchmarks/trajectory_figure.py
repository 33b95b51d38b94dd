"""Draws docs/images/trajectory-lists.png, exact manifolds against the thesis's list: `python -m benchmarks.trajectory_figure`."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.trajectory_lists import CROSSED, Motion, motions

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "trajectory-lists.png"
LABELS = ("no potentials", "A1–A6 (thesis)", "F1–F3 (exact)")
STYLES = (("C7", ":"), ("C3", "--"), ("C0", "-"))


def draw(pairs: int, path: Path = PICTURE) -> Path:
    """Above: σ_min on the way of one pair for each of F1, F2, F3; below: how σ_min's least value is distributed over all of them.

    The pair above is the one whose gain by the exact potentials is the median. Prints the medians.
    """
    figure = Figure(figsize=(10.5, 5.6), layout="constrained")
    rows = figure.subplots(2, len(CROSSED), sharex="row", sharey="row")
    for column, name in enumerate(CROSSED):
        found = [each for each in (motions(name, seed) for seed in range(pairs)) if each is not None]
        least = np.array([[motion.least for motion in each] for each in found])
        gain = least[:, 2] - least[:, 1]
        _over_time(rows[0, column], found[int(np.argsort(gain)[len(gain) // 2])])
        rows[0, column].set_title(f"straight way across {name}", fontsize="medium")
        for values, label, (colour, line) in zip(least.T, LABELS, STYLES, strict=True):
            rows[1, column].ecdf(np.maximum(values, 1e-5), label=label, color=colour, ls=line)
        rows[1, column].set_xscale("log")
        rows[1, column].set_xlabel("least σ_min of a motion")
        medians = ", ".join(f"{label} {m:.4f}" for label, m in zip(LABELS, np.median(least, axis=0), strict=True))
        above = float((gain > 0.0).mean())
        print(
            f"{name}: {len(found)} of {pairs} pairs; median of the least σ_min: {medians}; exact above listed in {above:.0%}"
        )
    rows[0, 0].set_ylabel("σ_min of the Jacobian")
    rows[1, 0].set_ylabel(f"share of {pairs} pairs")
    rows[1, 0].legend(fontsize="small", loc="upper left")
    figure.suptitle("moma8: what the potentials of an incomplete list cost", fontsize="medium")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    return path


def _over_time(axes: Axes, each: list[Motion]) -> None:
    for motion, label, (colour, line) in zip(each, LABELS, STYLES, strict=True):
        axes.plot(motion.t, motion.sigma, label=label, color=colour, ls=line)
    axes.set_xlabel("time (s)")
    axes.set_ylim(bottom=0.0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=60)
    print(draw(parser.parse_args().pairs))
