"""Draws docs/images/trajectory-lists.png, exact manifolds against the thesis's list: `python -m benchmarks.trajectory_figure`."""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from stack.strategic.trajectory.lists_compared import compare_lists

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "trajectory-lists.png"


def draw(pairs: int, path: Path = PICTURE) -> Path:
    """Distribution of the least σ_min on the way over pairs of moma8 that cross F1 away from A1–A6."""
    least = compare_lists(pairs)
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axes = figure.subplots()
    labels = ("no potentials", "potentials of A1–A6", "potentials of F1–F3")
    for column, label, style in zip(least.T, labels, ("-", "--", "-"), strict=True):
        axes.ecdf(column, label=label, ls=style)
    axes.set_xscale("log")
    axes.set_xlabel("least singular value of the Jacobian on the way")
    axes.set_ylabel("share of the pairs")
    axes.set_title(f"moma8: {pairs} motions across F1", fontsize="medium")
    axes.legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    return path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=60)
    print(draw(parser.parse_args().pairs))
