"""Kinematic scenarios (`kind = "kinematic"`): a robot description and an experiment with it, without physics and bus."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from config.errors import ConfigError, nearest
from config.scenario import ExpectTable
from config.table import Finite, NotNegative, Positive, Table, Vector3


class LegTable(Table):
    """One leg of a path, from rest to rest: the TCP moves by `translation_m` (base axes) and turns by `rotation_rad`
    (rotation vector, base axes) in `duration_s`."""

    duration_s: Positive
    translation_m: Vector3 = (0.0, 0.0, 0.0)
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)


class OptimisationTable(Table):
    """Weights and switches of the constraint optimisation. `enabled = false`: the closed form alone, limited by nothing.
    `switching = false`: the optimisation in every cycle, not only where the closed form breaks a bound."""

    enabled: bool = True
    alpha: Positive = 1.0
    beta: NotNegative = 3.0
    gamma: Positive = 1.0
    iterations: Annotated[int, Field(ge=1, le=10)] = 2
    error_bound_rad: Positive | None = None
    switching: bool = True


class WristSingularityTable(Table):
    """A path close by or through the wrist singularity, under the constraint optimisation and in closed form beside it.

    `start` (n,): joint angles in rad; `settle_s`: standstill of the command at the end.
    """

    type: Literal["wrist-singularity"]
    start: tuple[Finite, ...]
    leg: tuple[LegTable, ...]
    settle_s: NotNegative = 0.0
    optimisation: OptimisationTable = OptimisationTable()

    @model_validator(mode="after")
    def _moves(self) -> WristSingularityTable:
        if not self.leg:
            raise ValueError("needs at least one [[experiment.leg]]")
        return self


class SemiAlgorithmicTable(Table):
    """Park's test case: a planar arm draws a circle while its redundancy follows the largest and the smallest manipulability.

    The TCP begins at the point of the circle with the smallest x and goes round once in `lap_s`. `start_…_deg` (3,): near the optima to
    begin from. `gain` of the velocity QP's null-space motion, which takes `steps_per_cycle` steps in each cycle.
    `limits = false`: without joint limits.
    """

    type: Literal["semi-algorithmic"]
    centre_m: tuple[Finite, Finite]
    radius_m: Positive
    lap_s: Positive = 1.0
    start_maximise_deg: Vector3
    start_minimise_deg: Vector3
    gain: Positive = 50.0
    steps_per_cycle: Annotated[int, Field(ge=1, le=100)] = 5
    limits: bool = True


class KinematicScenario(Table):
    """A whole scenario file of this kind; what [experiment] takes is up to the experiment, see `KINEMATIC_SCENARIOS`."""

    kind: Literal["kinematic"]
    name: str
    title: str
    robot: str
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    cycle_s: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
    experiment: Table
    expect: tuple[ExpectTable, ...] = ()


class WristSingularityScenario(KinematicScenario):
    """`experiment.type = "wrist-singularity"`."""

    experiment: WristSingularityTable


class SemiAlgorithmicScenario(KinematicScenario):
    """`experiment.type = "semi-algorithmic"`."""

    experiment: SemiAlgorithmicTable


KINEMATIC_SCENARIOS: dict[str, type[KinematicScenario]] = {
    "wrist-singularity": WristSingularityScenario,
    "semi-algorithmic": SemiAlgorithmicScenario,
}
"""By `experiment.type`: the model of the whole file."""


def kinematic_model(data: Mapping[str, Any], source: Path | str) -> type[KinematicScenario]:
    """The model for a scenario file with `kind = "kinematic"`. Raises ConfigError for an experiment that does not exist."""
    experiment = data.get("experiment")
    if not isinstance(experiment, Mapping) or "type" not in experiment:
        raise ConfigError(f"{source}: key 'experiment.type' is missing")
    chosen = experiment["type"]
    if not isinstance(chosen, str) or chosen not in KINEMATIC_SCENARIOS:
        raise ConfigError(f"{source}: unknown experiment.type {chosen!r}, {nearest(str(chosen), KINEMATIC_SCENARIOS)}")
    return KINEMATIC_SCENARIOS[chosen]
