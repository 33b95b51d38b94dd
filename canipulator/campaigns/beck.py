"""The campaign of Beck et al.: random pairs, three robots, three objectives; every pair is solved with each objective."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from canipulator.campaigns.beck_pairs import LEAST_MANIPULABILITY, Pair, draw_pair, measure
from canipulator.campaigns.beck_tables import OBJECTIVES, PAPER, summarise_pairs
from canipulator.campaigns.campaign import Row, Summary
from config.errors import ConfigError
from stack.kinematics import ArmModel

SOLVER = "stack.strategic.trajectory"
WARM_UP_SEED = 2**62
"""Pairs that no campaign draws: they bring the compiled code and the caches of a worker up to speed."""


@dataclass(frozen=True)
class BeckCampaign:
    """A unit is a pair: three rows, one for each objective. `weights`: as the solver states them, shown with every table."""

    weights: str
    name: str = "beck"
    batch: int = 20
    unit_name: str = "pairs"

    def groups(self, pairs: int | None) -> Mapping[str, int]:
        """As many pairs for each robot, 1000 by default (the paper: 10,000)."""
        return dict.fromkeys(PAPER, 1000 if pairs is None else pairs)

    def parameters(self) -> Mapping[str, Any]:
        return {"least_manipulability": LEAST_MANIPULABILITY, "weights": self.weights}

    def warm_up(self, group: str) -> None:
        """A pair is solved with each objective before anything is timed."""
        for _ in self.compute(group, 0, WARM_UP_SEED):
            pass

    def compute(self, group: str, index: int, seed: int) -> Iterable[Row]:
        """A row for each objective; the computing time is that of `solve` alone, on one core."""
        arm = _arm(group)
        pair = draw_pair(arm, seed, index)
        for objective in OBJECTIVES:
            yield _solved(arm, pair, objective)

    def summarise(self, results: pa.Table, out: Path) -> Summary:
        """The paper's three tables with ours beside them."""
        note = f"{self.weights}; ends below m = {LEAST_MANIPULABILITY:g} drawn again; computing time on one core of this machine."
        return summarise_pairs(results, out, note)


def beck_campaign(duration_s: float | None) -> BeckCampaign:
    """Raises ConfigError where there is no solver, and for a duration, which pairs do not have."""
    if duration_s is not None:
        raise ConfigError("--duration: only for slip, methods and soak")
    return BeckCampaign(str(_solver().WEIGHTS))


def _solved(arm: ArmModel, pair: Pair, objective: str) -> Row:
    solver = _solver()
    problem = solver.TrajectoryProblem(
        arm=arm, start=pair.start, target=pair.target, objective=solver.Objective[objective.upper()]
    )
    began = time.perf_counter()
    trajectory = solver.solve(problem)
    computing_s = time.perf_counter() - began
    return {
        "objective": objective,
        "solved": trajectory.status.name == "OK",
        "status": trajectory.status.name,
        "iterations": float(trajectory.iterations),
        "t_f": float(trajectory.t_f),
        "computing_s": computing_s,
        "end_points_m_min": pair.manipulability,
        "rejected": float(pair.rejected),
    } | asdict(measure(arm, trajectory.q))


@cache
def _arm(name: str) -> ArmModel:
    return ArmModel.load(name)


def _solver() -> Any:
    try:
        return importlib.import_module(SOLVER)
    except ModuleNotFoundError as missing:
        if missing.name != SOLVER:
            raise
        raise ConfigError(f"campaign beck: needs the trajectory solver {SOLVER}, which is not installed") from None
