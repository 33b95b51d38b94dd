"""`[platform_path]`: what it accepts, what it says when it does not, and what it has written into the planner."""

from pathlib import Path

import pytest

from config.errors import ConfigError
from config.load import load_scenario
from config.mission import build_mission
from config.platform_path import path_writes
from config.scenario import Scenario
from stack.kinematics import ArmModel
from stack.planner.platform_path import CirclePath, LinePath, SplinePath

ARM = ArmModel.load("moma8")

BODY = """
name = "t"
title = "t"
duration_s = 1.0
[[step]]
name = "hold"
kind = "wait"
duration_s = 1.0
[platform_path]
"""


@pytest.fixture
def scenario(tmp_path: Path):
    def load(text: str) -> Scenario:
        path = tmp_path / "t.toml"
        path.write_text(BODY + text)
        loaded = load_scenario(str(path))
        assert isinstance(loaded, Scenario)
        return loaded

    return load


def written(scenario: Scenario) -> list[tuple[int, int, float]]:
    return [(write.index, write.subindex, write.value) for write in path_writes(scenario.platform_path)]


def test_a_circle_without_ends(scenario) -> None:
    loaded = scenario('kind = "circle"\nradius_m = -0.6\nheading_rad = 0.5')
    built = loaded.platform_path.build()
    assert built.path == CirclePath(-0.6)
    assert (built.x, built.y, built.heading) == (0.0, 0.0, 0.5)
    assert written(loaded)[-1] == (0x2016, 1, 2), "the kind comes last: it puts the rest into force"
    assert {(0x2016, 2, -0.6), (0x2016, 3, 1e6), (0x2016, 4, 1e6), (0x2016, 7, 0.5)} <= set(written(loaded))


def test_a_line_with_ends(scenario) -> None:
    loaded = scenario('kind = "line"\nahead_m = 1.5\nbehind_m = 0.0')
    assert loaded.platform_path.build().path == LinePath(0.0, 1.5)
    assert {(0x2016, 3, 1.5), (0x2016, 4, 0.0), (0x2016, 1, 1)} <= set(written(loaded))


def test_a_spline_has_its_waypoints_written(scenario) -> None:
    loaded = scenario('kind = "spline"\nwaypoints_m = [[0.5, 0.1], [1.0, 0.0]]')
    assert isinstance(loaded.platform_path.build().path, SplinePath)
    waypoints = {(0x2017, 1, 0.5), (0x2018, 1, 0.1), (0x2017, 2, 1.0), (0x2018, 2, 0.0), (0x2016, 8, 2)}
    assert waypoints <= set(written(loaded))


def test_the_mission_writes_it_unless_it_is_not_to_be_followed(scenario) -> None:
    followed = build_mission(scenario('kind = "circle"\nradius_m = 0.6'), ARM)
    assert (0x2016, 1) in [(write.index, write.subindex) for write in followed.initial_writes]
    free = build_mission(scenario('kind = "circle"\nradius_m = 0.6\nfollow = false'), ARM)
    assert not [write for write in free.initial_writes if write.index == 0x2016]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "square"', "kind"),
        ('kind = "circle"', "needs radius_m"),
        ('kind = "circle"\nradius_m = 0.05', "radius 0.05 m: must be at least 0.1 m"),
        ('kind = "circle"\nradius_m = 0.6\nwaypoints_m = [[1.0, 0.0]]', "has no waypoints_m"),
        ('kind = "line"\nradius_m = 1.0', "has no radius_m"),
        ('kind = "line"\nahead_m = 0.0\nbehind_m = 0.0', "have a length"),
        ('kind = "line"\nahead_m = -1.0', "ahead_m"),
        ('kind = "spline"', "needs waypoints_m"),
        ('kind = "spline"\nwaypoints_m = [[1.0, 0.0]]\nahead_m = 1.0', "ends at its last waypoint"),
        ('kind = "spline"\nwaypoints_m = [[0.3, 0.0], [0.0, 0.01]]', "bends|cusp"),
        ('kind = "line"\nradus_m = 1.0', "radius_m"),
    ],
)
def test_what_is_no_path_is_refused(scenario, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        scenario(text)
