"""What a person sees who opens a recording: every view of the overview is there and shows something, without complaints."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from canipulator.compare import compare_runs
from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.load import load_scenario
from logs import palette
from logs.comparison_blueprint import PLOTS
from logs.detail import Detail
from tests.viewer.headless import HeadlessViewer, headless_viewer, share_like, spread

pytestmark = [pytest.mark.slow, pytest.mark.viewer]
OVERVIEW = (
    "TCP error [mm]",
    "Joint positions [share of range, limits at ±1]",
    "Manipulability, arm [SI]",
    "Manipulability, robot [SI]",
    "Platform v [m/s]",
    "Platform ω [rad/s]",
    "Bus load [%]",
    "Path scale ϑ [1]",
    "States",
    "Events",
)
SCENE = "moma8, ellipsoids 0.25 m per m/s"
LIVELY = 2.0
"""Least `spread` of a view with something in it; an empty one has axes at most: below 1."""


def lane(color: palette.Color) -> palette.Color:
    """As the viewer draws it behind a lane's text: darker."""
    r, g, b = (round(0.785 * part) for part in color)
    return (r, g, b)


@pytest.fixture
def viewer() -> Iterator[HeadlessViewer]:
    with headless_viewer() as opened:
        yield opened


def recorded(folder: Path, name: str, duration_s: float, *faults: str, detail: Detail = Detail.FULL) -> Path:
    options = RunOptions(out=folder, duration_s=duration_s, quiet=True, detail=detail)
    run_scenario(load_scenario(name, (), faults), options)
    return folder / "run.rrd"


def keep(picture: np.ndarray, name: str) -> None:
    """Into the folder CANIPULATOR_SCREENSHOTS, if there is one: to be looked at."""
    folder = os.environ.get("CANIPULATOR_SCREENSHOTS")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        Image.fromarray(picture).save(Path(folder) / f"{name}.png")


def assert_all_lively(viewer: HeadlessViewer, titles: tuple[str, ...]) -> None:
    empty = [title for title in titles if spread(viewer.picture(title)) < LIVELY]
    assert not empty, f"nothing to be seen in {empty}"
    assert viewer.complaints() == []


@pytest.mark.parametrize("name", ["sliding-door", "force-guided", pytest.param("hold-still", marks=pytest.mark.faults)])
def test_the_overview_of_a_run(name: str, viewer: HeadlessViewer, tmp_path: Path) -> None:
    viewer.open(recorded(tmp_path, name, 6.0))
    viewer.go_to(5.0)
    assert_all_lively(viewer, (SCENE, *OVERVIEW))
    window = viewer.picture()
    keep(window, name)
    assert window.shape == (1080, 1920, 3)
    scene = viewer.picture(SCENE)
    assert share_like(scene, palette.COMMANDED) > 5e-4, "orange of the robot and of the arm's ellipsoid"
    assert share_like(scene, palette.MEASURED, 60) > 2e-4, "blue of the robot's ellipsoid"
    assert share_like(viewer.picture("States"), lane(palette.GOOD), 12) > 0.05, "lanes of states that are well"
    assert share_like(viewer.picture("States"), lane(palette.BAD), 12) < 1e-3, "and none that is not"


def test_a_faulted_run_shows_its_fault_beside_the_states(viewer: HeadlessViewer, tmp_path: Path) -> None:
    viewer.open(recorded(tmp_path, "sliding-door", 6.0, "over-current@3:node=23"))
    viewer.go_to(3.2)
    assert_all_lively(viewer, (SCENE, *OVERVIEW))
    keep(viewer.picture(), "faulted")
    assert share_like(viewer.picture("States"), lane(palette.BAD), 12) > 0.005, "a red stretch in the lanes"
    assert share_like(viewer.picture("Events"), (190, 30, 40), 60) > 1e-4, "ERROR in red among the events"


@pytest.mark.faults
def test_a_minimal_recording_has_the_overview_alone(viewer: HeadlessViewer, tmp_path: Path) -> None:
    viewer.open(recorded(tmp_path, "sliding-door", 4.0, detail=Detail.MINIMAL))
    viewer.go_to(3.0)
    assert "Frames in words" not in viewer.views()
    assert_all_lively(viewer, (SCENE, *OVERVIEW))


def test_a_comparison_shows_both_robots(viewer: HeadlessViewer, tmp_path: Path) -> None:
    runs = [tmp_path / "abc", tmp_path / "arm-only"]
    for folder in runs:
        scenario = load_scenario("sliding-door", [f'planner.coordination="{folder.name}"'])
        run_scenario(scenario, RunOptions(out=folder, duration_s=6.0, quiet=True, detail=Detail.MINIMAL))
    found = compare_runs(runs, tmp_path / "compare.rrd", quiet=True)
    assert found.recording is not None
    viewer.open(found.recording)
    viewer.go_to(4.0, "task_time")
    titles = tuple(title for title in viewer.views() if title in PLOTS)
    assert len(titles) > 4
    assert_all_lively(viewer, titles)
    window = viewer.picture()
    keep(window, "comparison")
    for color in palette.JOINTS[:2]:
        assert share_like(window, color) > 1e-3, "curves and robots of both runs"
