"""The wrist-singularity experiments as they ship: what they promise, that the promise can be broken, and the files of such a run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from canipulator.kinematic_run import run_kinematic
from canipulator.outcome import Outcome, RunOptions
from config.errors import ConfigError
from config.load import load_scenario
from tests.scenarios.test_bus_of_a_run import CONTRACT_KEYS

pytestmark = pytest.mark.slow

NAMES = ("wrist-singularity-pass", "wrist-singularity-cross")
CLOSED_FORM = "experiment.optimisation.enabled=false"


def run(out: Path, name: str, *overrides: str, duration_s: float | None = None, record: bool = False) -> Outcome:
    options = RunOptions(out=out, duration_s=duration_s, record=record, quiet=True)
    return run_kinematic(load_scenario(name, overrides), options)


@pytest.fixture(scope="module", params=NAMES)
def shipped(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("kinematic"), request.param, record=True)


def verdicts(outcome: Outcome) -> dict[str, bool]:
    found: dict[str, bool] = {}
    for verdict in outcome.metrics["expectations"]:
        found[verdict["name"]] = found.get(verdict["name"], True) and verdict["ok"]
    return found


def test_the_experiment_meets_its_expectations(shipped: Outcome) -> None:
    assert shipped.exit_code == 0
    assert all(verdicts(shipped).values())


def test_the_hand_is_exact_and_every_limit_holds(shipped: Outcome) -> None:
    metrics = shipped.metrics
    assert metrics["tcp_error_max_m"] <= 1e-5
    assert metrics["velocity_share_max"] <= 1 + 1e-9
    assert metrics["acceleration_share_max"] <= 1 + 1e-9
    assert metrics["position_excess_max_rad"] <= 1e-9
    assert metrics["limit_violations"] == {"position": 0, "velocity": 0}


def test_passing_peaks_at_three_degrees_where_the_closed_form_needs_nearly_three_times_the_speed(
    tmp_path: Path,
) -> None:
    metrics = run(tmp_path, "wrist-singularity-pass").metrics
    assert metrics["tcp_orientation_error_max_rad"] == pytest.approx(0.0570, abs=0.002)
    assert metrics["closed_form_velocity_share_max"] == pytest.approx(2.7, abs=0.1)


def test_crossing_peaks_at_two_degrees_where_the_closed_form_steps_by_ninety(tmp_path: Path) -> None:
    metrics = run(tmp_path, "wrist-singularity-cross").metrics
    assert metrics["tcp_orientation_error_max_rad"] == pytest.approx(0.0341, abs=0.002)
    assert metrics["closed_form_step_max_rad"] == pytest.approx(1.5708, abs=0.001)
    assert metrics["step_max_rad"] < 0.06


@pytest.mark.parametrize("name", NAMES)
def test_without_the_optimisation_the_expectations_fail(tmp_path: Path, name: str) -> None:
    outcome = run(tmp_path, name, CLOSED_FORM)
    assert outcome.exit_code == 1
    assert outcome.metrics["method"] == "closed-form"
    kept = verdicts(outcome)
    assert not kept["velocity_share_max"]
    assert not kept["acceleration_share_max"]
    assert not kept["limit_violations.velocity"]
    assert kept["tcp_error_max_m"]


def test_without_damping_the_passage_is_worse(tmp_path: Path) -> None:
    outcome = run(tmp_path, "wrist-singularity-pass", "experiment.optimisation.beta=0.0")
    assert outcome.exit_code == 1
    assert not verdicts(outcome)["tcp_orientation_error_max_rad"]
    assert verdicts(outcome)["velocity_share_max"], "limits do not depend on weights"


def test_the_files_of_a_run(shipped: Outcome) -> None:
    directory = shipped.directory
    assert {path.name for path in directory.iterdir()} == {
        "run.rrd", "bus.log", "metrics.json", "scenario.toml", "events.log"
    }  # fmt: skip
    assert (directory / "bus.log").read_bytes() == b"", "no bus, no frames"
    metrics = json.loads((directory / "metrics.json").read_text())
    for key in CONTRACT_KEYS:
        assert key in metrics, key
    assert metrics["bus_load_mean"] is None
    assert metrics["frames"] == 0
    assert metrics["arm_cycles"] in (667, 250)
    assert metrics["recorder_fault"] is None
    assert load_scenario(str(directory / "scenario.toml")) == load_scenario(metrics["scenario"])
    events = (directory / "events.log").read_text()
    assert "takes over: the closed form would break a limit" in events
    assert "hands back" in events


def test_the_recording_has_robot_paths_plots_states_and_events(shipped: Outcome) -> None:
    entities = {str(chunk.entity_path) for chunk in RrdReader(shipped.directory / "run.rrd").stream()}
    for needed in (
        "/world/path", "/world/trail", "/world/tool", "/world/commanded", "/tf/joints/joint_4", "/states/method", "/states/status",
        "/events", "/plots/orientation_error_deg/00", "/plots/translation_error_um/00", "/plots/time_scaling_ϑ_1/00",
        "/plots/velocities_optimised_share/03", "/plots/velocities_optimised_share/limits", "/plots/velocities_closed_form_share/03",
        "/plots/joint_4_rad/00", "/plots/joint_4_rad/01",
    ):  # fmt: skip
        assert any(entity.replace("\\\\", "") == needed for entity in entities), needed


def test_the_same_numbers_every_time_and_from_the_resolved_file(tmp_path: Path) -> None:
    first = run(tmp_path / "1", "wrist-singularity-cross")
    second = run(tmp_path / "2", str(first.directory / "scenario.toml"))
    clocks = {"wall_time_s", "real_time_factor", "arm_cycle_us"}
    assert {k: v for k, v in first.metrics.items() if k not in clocks} == {
        k: v for k, v in second.metrics.items() if k not in clocks
    }


def test_a_run_cut_short_is_not_judged(tmp_path: Path) -> None:
    outcome = run(tmp_path, "wrist-singularity-pass", duration_s=1.0)
    assert outcome.exit_code == 0
    assert outcome.metrics["expectations"] == ()
    assert outcome.metrics["sim_time_s"] == pytest.approx(1.0, abs=0.012)


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("robot=panda", ["panda is no six-joint arm"]),
        ("robot=kr16", ["kr16", "kr15"]),
        ("experiment.start=[0.0]", ["experiment.start has 1 values, must have 6"]),
        ("experiment.start=[9.0, 1.0, 0.0, 0.0, 0.0, 0.0]", ["experiment.start.0 = 9 (joint_1)", "-3.229 to 3.229"]),
        ("experiment.leg.0.translation_m=[5.0, 0.0, 0.0]", ["out of reach of kr15"]),
        ("expect.0.metric=orientation_eror", ["orientation_eror", "did you mean"]),
    ],
)
def test_what_cannot_be_run_is_refused_in_one_line(tmp_path: Path, override: str, parts: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        run(tmp_path, "wrist-singularity-pass", override)
    assert "\n" not in str(caught.value)
    for part in parts:
        assert part in str(caught.value)


def test_the_command_line_runs_them_like_any_other_scenario(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "canipulator"]
    listed = subprocess.run([*command, "list"], capture_output=True, text=True, check=True).stdout
    assert all(name in listed for name in NAMES)
    arguments = ["run", NAMES[1], "--out", str(tmp_path), "--no-rerun", "--json", "--seed", "3"]
    answer = subprocess.run([*command, *arguments], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    assert json.loads(answer.stdout)["seed"] == 3
    assert not (tmp_path / "run.rrd").exists()
    missed = subprocess.run([*command, *arguments, "--set", CLOSED_FORM], capture_output=True, check=False)
    assert missed.returncode == 1
