"""A person leads the hand, in physics and over the bus: forces of the hand, no limit cycle, limits, and what happens without guidance."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from canipulator.outcome import RunOptions
from canipulator.run import LockstepRun
from config.load import load_scenario
from config.robot import load_robot
from config.scenario import Scenario

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("guided")]
RESTS_S = 15.8
"""When the recorded hand has come to rest: grips at 1.5, moves for 14.2 s."""
SHORT = ("step.0.duration_s=3.5", "duration_s=5.0")


@dataclass
class Watched:
    """A run with the truth of every SYNC: times (n,), the hand's force and the TCP's position (n, 3)."""

    metrics: dict[str, Any]
    verdicts: dict[str, bool]
    t: NDArray[np.float64]
    force: NDArray[np.float64]
    tcp: NDArray[np.float64]
    directory: Path


def watch(directory: Path, *overrides: str, name: str = "force-guided") -> Watched:
    scenario = load_scenario(name, overrides)
    assert isinstance(scenario, Scenario)
    directory.mkdir(parents=True)
    options = RunOptions(out=directory, record=False, quiet=True)
    rows: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = []
    with LockstepRun(scenario, load_robot(scenario.robot), options, directory) as run:
        on_truth = run.log.on_truth

        def listen(truth: Any) -> None:
            rows.append((truth.t_ns * 1e-9, truth.hand[3:].copy(), truth.pose_WE[:3, 3].copy()))
            on_truth(truth)

        run.log.on_truth = listen  # type: ignore[method-assign]
        run.go()
    metrics = run.metrics(judged=True).as_dict()
    verdicts = {f"{v['name']} {v['op']} {v['bound']:g}": bool(v["ok"]) for v in metrics["expectations"]}
    t, force, tcp = (np.array(column) for column in zip(*rows, strict=True))
    return Watched(metrics, verdicts, t, force, tcp, directory)


def swing(values: NDArray[np.float64]) -> float:
    """Root mean square distance of the rows from their mean."""
    return float(np.sqrt(((values - values.mean(axis=0)) ** 2).sum(axis=1).mean()))


@pytest.fixture(scope="module")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    return watch(tmp_path_factory.mktemp("guided") / "standard")


def test_all_expectations_hold(standard: Watched) -> None:
    assert all(standard.verdicts.values()), standard.verdicts
    assert standard.metrics["faults"] == ()


def test_the_tcp_went_where_the_hand_went(standard: Watched) -> None:
    way = standard.tcp - standard.tcp[0]
    assert way[:, 0].max() > 0.7
    assert way[:, 1].min() < -0.3
    np.testing.assert_allclose(way[-60], [0.08, 0.0, 0.06], atol=0.01)


@pytest.mark.parametrize("stiffness", [*(pytest.param(k, marks=pytest.mark.faults) for k in (200.0, 1000.0)), 5000.0])
def test_soft_and_stiff_hands_feel_at_most_25_newtons_and_come_to_rest(tmp_path: Path, stiffness: float) -> None:
    """No limit cycle: once the hand rests, force and TCP swing less and less, and by less than half a newton and a millimetre."""
    seen = watch(tmp_path / "run", f"person.stiffness_n_m={stiffness}", "step.0.duration_s=22.0", "duration_s=25.0")
    force = np.linalg.norm(seen.force, axis=1)
    assert force.max() <= 25.0
    first = (seen.t > RESTS_S) & (seen.t < RESTS_S + 2.0)
    last = (seen.t > RESTS_S + 4.0) & (seen.t < RESTS_S + 6.0)
    assert swing(seen.force[last]) < 0.5
    assert swing(seen.tcp[last]) < 0.001
    assert swing(seen.force[last]) < max(swing(seen.force[first]), 0.3)
    assert force[last].max() < 1.5


def test_without_the_lead_a_stiff_hand_swings(tmp_path: Path) -> None:
    """What the test above measures is there when the cause of stability is taken away."""
    seen = watch(tmp_path / "run", "person.stiffness_n_m=5000.0", "step.0.guidance.lead_s=0.0")
    last = (seen.t > RESTS_S + 1.0) & (seen.t < RESTS_S + 3.0)
    assert swing(seen.force[last]) > 5.0


def test_without_guidance_the_scenario_fails(tmp_path: Path) -> None:
    seen = watch(tmp_path / "run", "step.0.guidance.gain=0.0")
    assert not seen.verdicts["hand_force_max_n <= 25"]
    assert np.linalg.norm(seen.force, axis=1).max() > 50.0


@pytest.mark.parametrize("seed", [11, *(pytest.param(seed, marks=pytest.mark.faults) for seed in (12, 13))])
def test_wherever_a_random_hand_leads_no_limit_is_passed(tmp_path: Path, seed: int) -> None:
    """Three of them here; docs/force-guidance.md says what two hundred gave."""
    wide = ("person.wander.box_m=[2.0, 2.0, 1.4]", "person.wander.duration_s=30.0", "person.lets_go_s=6.4")
    seen = watch(
        tmp_path / "run", f"seed={seed}", 'person.path="random"', *wide, "step.0.duration_s=6.0", "duration_s=8.0"
    )
    assert seen.metrics["limit_violations"] == {"position": 0, "velocity": 0}
    assert seen.metrics["min_manipulability_arm"] > 0.02
    assert np.linalg.norm(seen.force, axis=1).max() <= 25.0
    assert np.linalg.norm(seen.tcp[-1] - seen.tcp[0]) > 0.1


def test_a_raw_sensor_needs_the_tools_weight(tmp_path: Path) -> None:
    raw = 'force_sensor.compensation="none"'
    tool = "step.0.guidance.tool={mass_kg=1.0,centre_m=[0.0,0.0,0.1]}"
    sinks = watch(tmp_path / "sinks", raw, "person.grips_s=3.0", *SHORT)
    stays = watch(tmp_path / "stays", raw, tool, "person.grips_s=3.0", *SHORT)
    before = sinks.t < 3.0
    assert sinks.tcp[before][-1, 2] - sinks.tcp[0, 2] < -0.05
    assert abs(stays.tcp[before][-1, 2] - stays.tcp[0, 2]) < 0.003


def test_the_same_seed_gives_the_same_frames_and_another_one_does_not(tmp_path: Path) -> None:
    logs = [
        (watch(tmp_path / name, f"seed={seed}", *SHORT).directory / "bus.log").read_bytes()
        for name, seed in (("a", 5), ("b", 5), ("c", 6))
    ]
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]
