"""The leaf that the hand swings or pulls along is an obstacle like any other: seen in the physics, told over the bus."""

from pathlib import Path

import pytest

from canipulator.run import LockstepRun, RunOptions
from config.load import load_scenario
from config.robot import load_robot
from drivers.tables import planner as table
from stack.planner.leaf import LeafMotion
from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow

# Postures whose wish takes platform, tower and elbow into the gate that the hand pulls open.
INTO_THE_GATE = {
    "platform": (
        "preferences.preferred=[0.051, 0.95, 0.149, -0.165, -1.747, -0.791, 1.356, -0.084]",
        "cases.2.heights=[1.91, 1.36, 0.0, 1.17, 0.0, 0.77, 0.53, 1.64]",
    ),
    "elbow": (
        "preferences.preferred=[1.043, 0.554, -3.146, -2.767, -1.83, 1.871, 0.926, 0.768]",
        "cases.2.heights=[1.09, 1.27, 0.0, 0.41, 1.4, 0.0, 0.98, 1.16]",
    ),
}


@pytest.mark.parametrize("what", ["platform", pytest.param("elbow", marks=pytest.mark.faults)])
def test_a_wish_into_the_gate_is_kept_from_it(runner: Runner, what: str) -> None:
    free = runner("sliding-door", *INTO_THE_GATE[what], "planner.collision_avoidance=false").metrics
    assert free["collisions"] > 0
    assert any("door touch" in fault for fault in free["faults"])
    kept = runner("sliding-door", *INTO_THE_GATE[what], "planner.collision_avoidance=true").metrics
    assert kept["collisions"] == 0
    assert not kept["faults"]
    finished = [expectation for expectation in kept["expectations"] if expectation["name"] == "mission_finished"]
    assert finished[0]["ok"]


def test_the_planner_is_told_of_the_leaf_and_of_the_hinge_once_it_is_known(tmp_path: Path) -> None:
    scenario = load_scenario("hinged-door")
    assert scenario.door is not None
    with LockstepRun(scenario, load_robot(scenario.robot), RunOptions(record=False, quiet=True), tmp_path) as run:
        run.power_on()
        planner = run.planner
        run.clock.run_until(2_500_000_000)
        told = planner.parameters.door
        assert told is not None
        assert told.motion is LeafMotion.TURNS
        radius = ((told.hinge[0] - told.handle[0]) ** 2 + (told.hinge[1] - told.handle[1]) ** 2) ** 0.5
        assert radius == pytest.approx(0.84, abs=1e-3), "a guess, a fifth too long"
        run.clock.run_until(13_000_000_000)
        found = planner.parameters.door
        assert found is not None
        radius = ((found.hinge[0] - found.handle[0]) ** 2 + (found.hinge[1] - found.handle[1]) ** 2) ** 0.5
        assert radius == pytest.approx(0.7, abs=0.03)
        door = run.sim.world.surroundings.door
        assert door is not None
        # Where the planner believes the leaf to be: turned as far as it is in the physics, clockwise.
        opening = float(planner.node.dictionary.get(table.DOOR_OPENING))
        assert -opening == pytest.approx(door.position, abs=0.03)
        assert planner.node.dictionary.get(table.DOOR_MOTION) == LeafMotion.TURNS
        while not run._done():
            run.clock.run_until(run.clock.now_ns() + 100_000_000)
        assert planner.parameters.door is not None
        assert planner.parameters.door.motion is LeafMotion.STANDS, "let go"
