"""A person's hand: spring, damper, strength, and ways that are smooth, bounded and repeatable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.person import PersonParameters, Wandering, Waypoints
from sim.slip import SlipParameters
from sim.surroundings import SurroundingsParameters
from sim.world import WorldParameters

pytestmark = pytest.mark.slow

STEP_S = 1e-3


def world_of(person: PersonParameters) -> WorldParameters:
    return WorldParameters(slip=SlipParameters(sigma=0.0), surroundings=SurroundingsParameters(person=person))


def way(*rows: tuple[float, float, float, float]) -> Waypoints:
    return Waypoints([row[0] for row in rows], [row[1:] for row in rows])


AWAY = way((0.0, 0.0, 0.0, 0.0), (0.5, 0.02, -0.01, 0.03))


@pytest.mark.parametrize("stiffness", [200.0, 500.0, 5000.0])
def test_the_force_is_that_of_a_spring_and_a_damper_and_the_sensor_reads_it(
    rig: Callable[..., Any], stiffness: float
) -> None:
    one = rig(world_of(PersonParameters(AWAY, stiffness, damping=20.0, strength=1e4)))
    physics, person = one.world.physics, one.world.surroundings.person
    start = physics.pose_WE()[:3, 3]
    ticks: list[tuple[np.ndarray, np.ndarray]] = []

    def note() -> None:
        t = len(ticks) * STEP_S
        offset, speed = AWAY.at(t)
        state = physics.hand()
        law = stiffness * (start + offset - np.array(state[4])) + 20.0 * (speed - np.array(state[6]))
        ticks.append((law, person.force))

    one.world.before_step.append(note)
    for _ in range(150):
        one.cycle()
    laws, forces = np.array(ticks).transpose(1, 0, 2)
    assert np.linalg.norm(forces, axis=1).max() > 0.01 * stiffness
    assert forces == pytest.approx(laws, abs=1e-3)
    truth = one.world.truth(0)
    assert truth.hand is not None
    assert (truth.hand[3:] == forces[-1]).all()
    assert truth.pose_WE[:3, :3] @ truth.contact_wrench[:3] == pytest.approx(forces[-1], abs=1e-4)
    one.world.force_sensor.read()
    one.cycle()
    reading = truth.pose_WE[:3, :3] @ one.world.force_sensor.read()[:3]
    assert reading == pytest.approx(np.mean([tick[1] for tick in ticks[-10:]], axis=0), abs=0.3)


def test_nobody_is_stronger_than_his_strength(rig: Callable[..., Any]) -> None:
    far = way((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 0.0))
    one = rig(world_of(PersonParameters(far, 500.0, strength=40.0)))
    forces = []
    for _ in range(150):
        one.cycle(after_tick=lambda: forces.append(one.world.surroundings.person.force))
    sizes = np.linalg.norm(forces, axis=1)
    assert sizes.max() == pytest.approx(40.0)
    assert forces[-1] / 40.0 == pytest.approx([2**-0.5, 2**-0.5, 0.0], abs=0.03)


def test_the_hand_grips_and_lets_go_at_its_times(rig: Callable[..., Any]) -> None:
    one = rig(world_of(PersonParameters(AWAY, grips_s=0.2, lets_go_s=0.9)))
    forces = []
    for _ in range(120):
        one.cycle(after_tick=lambda: forces.append(np.linalg.norm(one.world.surroundings.person.force)))
    forces = np.array(forces)
    assert not forces[:200].any()
    assert forces[300:900].min() > 0.0
    assert not forces[900:].any()
    assert not one.world.truth(0).contact_wrench.any()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.tuples(st.floats(0.05, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 0.5)),
    speed=st.floats(0.05, 0.6),
    duration=st.floats(2.0, 30.0),
)
def test_a_random_way_stays_in_its_box_below_its_speed_and_is_smooth(
    seed: int, size: tuple[float, float, float], speed: float, duration: float
) -> None:
    path = Wandering(seed, size, speed, duration)
    t = np.arange(0.0, duration + 1.0, 0.01)
    samples = [path.at(float(s)) for s in t]
    x, v = np.array([s[0] for s in samples]), np.array([s[1] for s in samples])
    assert (np.abs(x) <= 0.5 * np.array(size) + 1e-12).all()
    assert np.linalg.norm(v, axis=1).max() <= speed * (1.0 + 1e-9)
    assert x[0] == pytest.approx(np.zeros(3), abs=1e-12)
    assert x[-1] == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.diff(x, axis=0) == pytest.approx(0.005 * (v[1:] + v[:-1]), abs=5e-5)
    assert np.abs(np.diff(v, axis=0)).max() < 0.01 * 10.0 * speed


def test_the_same_seed_wanders_the_same_way_and_another_one_does_not() -> None:
    one, same, other = (Wandering(seed, (0.4, 0.4, 0.3), 0.25, 20.0) for seed in (3, 3, 4))
    times = np.linspace(0.0, 20.0, 50).tolist()
    assert all((one.at(t)[0] == same.at(t)[0]).all() for t in times)
    assert any((one.at(t)[0] != other.at(t)[0]).any() for t in times)
    assert max(np.linalg.norm(one.at(t)[0]) for t in times) > 0.1


def test_recorded_ways_go_through_their_points_from_rest_to_rest() -> None:
    path = way((0.5, 0.0, 0.0, 0.0), (1.0, 0.1, 0.0, 0.0), (2.0, 0.1, 0.2, -0.1))
    assert path.at(0.2)[0] == pytest.approx([0.0, 0.0, 0.0])
    assert path.at(1.0)[0] == pytest.approx([0.1, 0.0, 0.0])
    assert path.at(9.0)[0] == pytest.approx([0.1, 0.2, -0.1])
    for t in (0.5, 2.0, 9.0):
        assert path.at(t)[1] == pytest.approx(np.zeros(3), abs=1e-12)
    with pytest.raises(ValueError, match="increase"):
        way((0.0, 0.0, 0.0, 0.0), (0.0, 0.1, 0.0, 0.0))


def test_bad_people_are_refused() -> None:
    with pytest.raises(ValueError, match=r"stiffness 0\.0"):
        PersonParameters(AWAY, stiffness=0.0)
    with pytest.raises(ValueError, match="lets_go_s"):
        PersonParameters(AWAY, grips_s=2.0, lets_go_s=1.0)
