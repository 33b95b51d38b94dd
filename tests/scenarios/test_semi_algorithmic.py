"""Park's test case as a scenario: four runs, their picture, the recording; and that the expectations notice what is missing."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from rerun.chunk import RrdReader

from canipulator.experiments.semi_algorithmic import SemiAlgorithmic
from canipulator.kinematic_run import run_kinematic
from canipulator.outcome import Outcome, RunOptions
from config.errors import ConfigError
from config.load import load_scenario

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("park")]
T_REACHED, T_PA = 0.19204352833375593, 0.40958282927576846


def run(out: Path, *overrides: str, record: bool = False, duration_s: float | None = None) -> Outcome:
    scenario = load_scenario("semi-algorithmic", overrides)
    return run_kinematic(scenario, RunOptions(out=out, record=record, quiet=True, duration_s=duration_s))


@pytest.fixture(scope="module")
def standard(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    return run(tmp_path_factory.mktemp("park"), record=True)


def test_all_expectations_hold(standard: Outcome) -> None:
    assert standard.exit_code == 0
    metrics = standard.metrics
    assert metrics["maximise_reaches_limit_s"] == pytest.approx(T_REACHED, abs=1e-12)
    assert metrics["maximise_stops_s"] == pytest.approx(T_PA, abs=1e-12)
    assert metrics["minimise_reaches_limit_s"] == pytest.approx(T_PA, abs=1e-12)
    assert metrics["minimise_leaves_limit_s"] == pytest.approx(1.0 - T_PA, abs=1e-12)
    assert metrics["minimise_closure_rad"] < 1e-12
    assert metrics["qp_maximise_velocity_max_rad_s"] == pytest.approx(174.5, abs=0.5)


def test_events_name_what_happened(standard: Outcome) -> None:
    lines = (standard.directory / "events.log").read_text().splitlines()
    stop = next(line for line in lines if "stopped" in line)
    assert "WARN" in stop
    assert stop.endswith("kind: semi algorithmic")
    assert sum("left a limit" in line for line in lines) == 1


def test_the_picture_shows_something(standard: Outcome) -> None:
    picture = imread(standard.directory / "configuration.png")
    assert picture.shape[0] > 800
    assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 500


def test_the_recording_has_the_map_with_its_places(standard: Outcome) -> None:
    rows: Counter[str] = Counter()
    for chunk in RrdReader(str(standard.directory / "run.rrd")).stream():
        rows[str(chunk.entity_path).lstrip("/")] += chunk.num_rows
    places = [n for name, n in rows.items() if name.startswith("maps/configuration/places/")]
    assert len(places) == 4
    assert min(places) > 10
    for part in ("limits", "loci/0", "loci/1", "marks/0", "ways/3", "ticks"):
        assert rows[f"maps/configuration/{part}"] == 1, part


def test_without_the_limit_there_is_no_semi_algorithmic_singularity(tmp_path: Path) -> None:
    outcome = run(tmp_path, "experiment.limits=false")
    assert outcome.exit_code == 1
    failed = {verdict["name"] for verdict in outcome.metrics["expectations"] if not verdict["ok"]}
    assert {"maximise_reaches_limit_s", "maximise_stops_s", "maximise_stop_kind", "minimise_leaves_limit_s"} <= failed
    assert {"qp_maximise_jump_s", "limit_violations.position"} <= failed
    # The maximum ends on the algorithmic singularity that lies beyond the limit.
    assert outcome.metrics["maximise_stop_kind"] == 2
    assert outcome.metrics["maximise_stops_s"] == pytest.approx(0.19905664391944639, abs=1e-6)


@pytest.mark.parametrize(("gain", "jump_s"), [(20.0, 0.43), (5.0, 0.475)])
def test_the_smaller_the_gain_the_later_and_the_gentler_is_the_jump(
    tmp_path: Path, standard: Outcome, gain: float, jump_s: float
) -> None:
    metrics = run(tmp_path, f"experiment.gain={gain}").metrics
    assert metrics["qp_maximise_jump_s"] == pytest.approx(jump_s, abs=0.01)
    assert metrics["qp_maximise_jump_s"] > standard.metrics["qp_maximise_jump_s"]
    assert metrics["qp_maximise_velocity_max_rad_s"] < 100.0


def test_a_part_of_the_lap_is_not_judged(tmp_path: Path) -> None:
    outcome = run(tmp_path, duration_s=0.3)
    assert outcome.exit_code == 0
    assert not outcome.metrics["expectations"]
    assert outcome.metrics["maximise_stops_s"] is None


def test_other_robots_and_starts_are_refused_with_a_reason() -> None:
    with pytest.raises(ConfigError, match="planar arm of three joints"):
        SemiAlgorithmic(load_scenario("semi-algorithmic", ["robot=moma8"]))  # type: ignore[arg-type]
    away = SemiAlgorithmic(
        load_scenario("semi-algorithmic", ["experiment.start_maximise_deg=[90.0, 100.0, 0.0]"])  # type: ignore[arg-type]
    )
    with pytest.raises(ConfigError, match="no maximum of H near"):
        away.run(lambda _: None)
