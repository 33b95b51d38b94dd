"""The campaign of Beck et al.: random pairs, three robots, three objectives; every pair is solved with each objective."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa

import stack.strategic.trajectory as solver
from canipulator.campaigns.beck_pairs import LEAST_MANIPULABILITY, Pair, draw_pair, measure
from canipulator.campaigns.beck_tables import OBJECTIVES, PAPER, summarise_pairs
from canipulator.campaigns.campaign import Row, Summary
from config.errors import ConfigError
from stack.kinematics import ArmModel
from stack.strategic.trajectory import Objective, TrajectoryProblem, Weights, solve

WARM_UP_SEED = 2**62
"""Pairs that no campaign draws: they bring the compiled code and the caches of a worker up to speed."""


@dataclass(frozen=True)
class BeckCampaign:
    """A unit is a pair: three rows, one for each objective. `solver`: digest of the solver's sources; results of two are never mixed."""

    solver: str
    weights: Weights = Weights()
    name: str = "beck"
    batch: int = 50
    unit_name: str = "pairs"

    def groups(self, pairs: int | None) -> Mapping[str, int]:
        """As many pairs for each robot, 1000 by default (the paper: 10,000)."""
        return dict.fromkeys(PAPER, 1000 if pairs is None else pairs)

    def parameters(self) -> Mapping[str, Any]:
        return {"least_manipulability": LEAST_MANIPULABILITY, "weights": asdict(self.weights), "solver": self.solver}

    def warm_up(self, group: str) -> None:
        """A pair is solved with each objective before anything is timed."""
        for _ in self.compute(group, 0, WARM_UP_SEED):
            pass

    def compute(self, group: str, index: int, seed: int) -> Iterable[Row]:
        """A row for each objective; the computing time is the processor's time in `solve` alone."""
        arm = _arm(group)
        pair = draw_pair(arm, seed, index)
        for objective in OBJECTIVES:
            yield self._solved(arm, pair, objective)

    def summarise(self, results: pa.Table, out: Path) -> Summary:
        """The paper's three tables with ours beside them."""
        w = self.weights
        note = (
            f"Weights: {w.time:g} on t_F (the paper prints 1; 556 was fitted on its first column), {w.acceleration:g} on accelerations, "
            f"w_m = {w.singularity:g}, ε = {w.epsilon:g}, exp η₁ = {w.height:g}, η₂ = {w.steepness:g}. Ends below m = "
            f"{LEAST_MANIPULABILITY:g} drawn again. m_min and m_max over all pairs. Computing time: the processor's, of one solve."
        )
        return summarise_pairs(results, out, note)

    def _solved(self, arm: ArmModel, pair: Pair, objective: str) -> Row:
        problem = TrajectoryProblem(
            arm.name, pair.start, pair.target, objective=Objective(objective), weights=self.weights
        )
        began = time.thread_time()  # not the clock on the wall: other workers may share the core
        trajectory = solve(problem)
        computing_s = time.thread_time() - began
        return {
            "objective": objective,
            "solved": trajectory.status.usable,
            "status": trajectory.status.name,
            "iterations": float(trajectory.iterations),
            "t_f": float(trajectory.t_f),
            "computing_s": computing_s,
            "value": float(trajectory.objective),
            "end_points_m_min": pair.manipulability,
            "rejected": float(pair.rejected),
            **asdict(measure(arm, trajectory.q)),
        }


def beck_campaign(duration_s: float | None) -> BeckCampaign:
    """Raises ConfigError for a duration, which pairs do not have."""
    if duration_s is not None:
        raise ConfigError("--duration: only for slip, methods and soak")
    digest = hashlib.sha256()
    for source in sorted(Path(str(solver.__file__)).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return BeckCampaign(digest.hexdigest()[:16])


@cache
def _arm(name: str) -> ArmModel:
    return ArmModel.load(name)
