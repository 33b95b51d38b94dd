"""Who reads a number in a recording knows its unit: it stands in the name of every entity that holds numbers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from logs.around import Around, around_series
from logs.comparison_blueprint import PLOTS, joint_plots
from logs.kinematic_recorder import _named_with_unit
from logs.plots import all_series
from logs.recording_reader import read_recording
from stack.kinematics import ArmModel

UNIT = re.compile(
    r"_(mm|m|um|deg|rad|mrad|rad_or_m|m_per_s|rad_per_s|N|Nm|Nm_or_N|SI|1|share|percent|per_s|s|ms|us)(?=/|$)"
)
"""`share` of a limit or a range; `1`: a ratio; `SI`: rows of different kind, each in its SI unit."""


@pytest.mark.parametrize("around", [Around(), Around(door="hinged", person=True), Around(door="sliding")], ids=str)
def test_every_plotted_entity_of_a_run(around: Around) -> None:
    arm = ArmModel.load("moma8")
    paths = [series.path for series in all_series(arm.joint_names)] + [path for path, _, _ in around_series(around)]
    assert len(paths) > 40
    assert [path for path in paths if not UNIT.search(path)] == []


def test_every_entity_with_numbers_that_is_in_a_recording(recorded: Path) -> None:
    """What is left out are poses: `tf/…` and the robot's frame of reference."""
    names = [name for name in read_recording(recorded / "run.rrd").series if not name.startswith(("tf/", "world/"))]
    assert len(names) > 30
    assert [name for name in names if not UNIT.search(name)] == []


def test_every_plotted_entity_of_a_comparison() -> None:
    paths = [*PLOTS.values(), *joint_plots(ArmModel.load("moma8")).values()]
    assert [path for path in paths if not UNIT.search(path)] == []


def test_plots_of_kinematic_experiments_are_named_after_their_titles() -> None:
    assert _named_with_unit("Joint 4 [°]") == "joint_4_deg"
    assert _named_with_unit("Velocities, optimised [share of limit]") == "velocities_optimised_share"
    with pytest.raises(KeyError):
        _named_with_unit("Joint 4")
