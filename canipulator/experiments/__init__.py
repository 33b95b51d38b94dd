"""Kinematic experiments: no physics, no bus, one robot description and a method of the stack; run by `canipulator.kinematic_run`."""

from __future__ import annotations

from canipulator.experiments.base import Experiment, Progress
from canipulator.experiments.semi_algorithmic import SemiAlgorithmic
from canipulator.experiments.wrist_singularity import WristSingularity
from config.kinematic import KinematicScenario, SemiAlgorithmicScenario, WristSingularityScenario


def build_experiment(scenario: KinematicScenario) -> Experiment:
    """The experiment of a scenario, ready to run. Raises ConfigError for values that do not fit the robot."""
    if isinstance(scenario, WristSingularityScenario):
        return WristSingularity(scenario)
    if isinstance(scenario, SemiAlgorithmicScenario):
        return SemiAlgorithmic(scenario)
    raise TypeError(f"no experiment for {type(scenario).__name__}")


__all__ = ["Experiment", "Progress", "build_experiment"]
