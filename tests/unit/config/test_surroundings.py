"""Tables of doors, people and furniture: what is refused and why, and what the simulation gets."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from canipulator.surroundings import around, surroundings
from config.errors import ConfigError
from config.load import dump_scenario, load_scenario
from config.scenario import Scenario
from sim.door_parameters import DoorKind, HandleGrasp
from sim.person import Wandering, Waypoints

HEAD = 'name = "x"\ntitle = "y"\nduration_s = 5.0\n[[step]]\nname = "w"\nkind = "wait"\nduration_s = 1.0\n'
DOOR = '[door]\nkind = "hinged"\nhandle_m = [1.0, 0.2, 0.9]\nheading_rad = 1.5\n'


def load(tmp_path: Path, text: str) -> Scenario:
    path = tmp_path / "x.toml"
    path.write_text(HEAD + text, encoding="utf-8")
    scenario = load_scenario(str(path))
    assert isinstance(scenario, Scenario)
    return scenario


def test_without_tables_there_is_nothing_around(tmp_path: Path) -> None:
    parameters = surroundings(load(tmp_path, ""))
    assert not parameters.solid
    assert parameters.door is None
    assert parameters.person is None
    assert around(load(tmp_path, "")).bodies == ()


def test_a_hinged_door_opens_to_the_side_where_the_hand_is(tmp_path: Path) -> None:
    """Looking from the handle to the hinge: a door that opens to the right turns counter-clockwise seen from above."""
    for side, sign in (("right", 1), ("left", -1)):
        door = surroundings(load(tmp_path, DOOR + f'side = "{side}"\ngrasp = "rigid"\nfriction = 2.0\n')).door
        assert door is not None
        assert (door.kind, door.side, door.grasp) == (DoorKind.HINGED, sign, HandleGrasp.RIGID)
        assert (door.across, door.mass, door.friction) == (0.8, 15.0, 2.0)
        hinge = door.frame()[:3, 3]
        assert hinge - door.handle == pytest.approx([0.8 * math.cos(1.5), 0.8 * math.sin(1.5), 0.0])
        looking, opening = hinge - door.handle, sign * np.cross([0.0, 0.0, 1.0], np.array(door.handle) - hinge)
        to_the_left = np.cross([0.0, 0.0, 1.0], looking)
        assert np.sign(to_the_left @ opening) == -sign


def test_a_sliding_door_has_its_handle_on_its_side(tmp_path: Path) -> None:
    table = '[door]\nkind = "sliding"\nhandle_m = [1.0, 0.2, 0.9]\nheading_rad = 0.0\nside = "right"\nwidth_m = 1.1\n'
    door = surroundings(load(tmp_path, table)).door
    assert door is not None
    assert door.travel == 0.9
    size, middle = door.panel()
    assert size[0] == 1.1
    assert middle[1] > 0.0  # the panel is to the left of its way, the hand to the right


def test_ways_of_people(tmp_path: Path) -> None:
    recorded = load(tmp_path, "[person]\nwaypoints = [[0.0, 0.0, 0.0, 0.0], [2.0, 0.1, 0.0, 0.0]]\nlets_go_s = 3.0\n")
    person = surroundings(recorded).person
    assert person is not None
    assert isinstance(person.path, Waypoints)
    assert person.path.at(2.0)[0] == pytest.approx([0.1, 0.0, 0.0])
    wandering = load(tmp_path, "[person]\nstiffness_n_m = 800.0\nwander = { duration_s = 9.0, speed_m_s = 0.2 }\n")
    person = surroundings(wandering).person
    assert person is not None
    assert isinstance(person.path, Wandering)
    assert person.stiffness == 800.0
    assert around(wandering).person


def test_furniture_and_objects_keep_their_order(tmp_path: Path) -> None:
    scenario = load(
        tmp_path,
        DOOR + "[[table]]\nsize_m = [1.0, 0.6, 0.7]\nposition_m = [1.0, 0.0]\n"
        "[[wall]]\nsize_m = [0.1, 2.0, 2.0]\nposition_m = [3.0, 0.0]\n"
        '[[object]]\nname = "cup"\nshape = "cylinder"\nsize_m = [0.04, 0.04, 0.1]\nposition_m = [1.0, 0.0, 0.7]\n'
        '[[object]]\nname = "box"\nsize_m = [0.04, 0.05, 0.1]\nposition_m = [1.0, 0.2, 0.7]\nmass_kg = 0.5\n',
    )
    parameters = surroundings(scenario)
    assert [thing.name for thing in parameters.obstacles] == ["table", "wall"]
    assert [thing.mass for thing in parameters.objects] == [0.3, 0.5]
    shown = around(scenario)
    assert [(body.name, body.row) for body in shown.bodies] == [
        ("table", None),
        ("wall", None),
        ("door", 0),
        ("cup", 1),
        ("box", 2),
    ]
    assert shown.bodies[3].pose[2, 3] == pytest.approx(0.75)


def test_a_resolved_scenario_has_the_same_surroundings(tmp_path: Path) -> None:
    first = load(tmp_path, DOOR + "[person]\nwander = { duration_s = 9.0 }\n")
    again = tmp_path / "again.toml"
    again.write_text(dump_scenario(first), encoding="utf-8")
    assert load_scenario(str(again)) == first


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (DOOR + "width_m = 1.0\n", "a hinged door has no width_m"),
        (DOOR + "start = 2.0\n", "start = 2 must not exceed travel = 1.75"),
        (DOOR + 'side = "up"\n', "door.side"),
        (DOOR + "weight_kg = 3.0\n", "door.weight_kg"),
        ("[person]\nstiffness_n_m = 500.0\n", "either waypoints or wander"),
        ("[person]\nwaypoints = [[0.0, 0.0, 0.0, 0.0]]\n", "at least two rows"),
        ("[person]\nstiffness_n_m = 1.0\nwander = { duration_s = 9.0 }\n", "stiffness_n_m"),
        ("[person]\ngrips_s = 3.0\nlets_go_s = 1.0\nwander = { duration_s = 9.0 }\n", "lets_go_s = 1"),
        ("[[table]]\nsize_m = [1.0, 1.0, 0.02]\nposition_m = [0.0, 0.0]\n", "top_m = 0.03"),
        (
            '[[object]]\nname = "c"\nshape = "cylinder"\nsize_m = [0.1, 0.2, 0.1]\nposition_m = [0.0, 0.0, 0.0]\n',
            "same diameter",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_reason(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        load(tmp_path, text)
    assert says in str(refusal.value)
