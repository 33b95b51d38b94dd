"""The admittance against hands: loop with its real delays, energy, dead band, bounds, wind-up, weight; and the motion around it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from stack.kinematics.se3 import rotation_exp
from stack.messages import PlannerPhase, PlannerState, Restriction
from stack.strategic.force_guidance import (
    Admittance,
    AdmittanceState,
    Pair,
    Tool,
    admit,
    bounded,
    carried,
    without_band,
    without_weight,
)
from stack.strategic.guide import Guide
from stack.strategic.motion import CYCLE_S, MotionInputs

Array = NDArray[np.float64]
LAW = Admittance()
FREE = Pair(np.inf, np.inf)
LINEAR = replace(LAW, dead_band=Pair(0.0, 0.0), saturation=FREE, speed=FREE, acceleration=FREE)
NOTHING = np.zeros(6)
SMOOTHING_S = 0.03
TOOL_KG = 1.0
STATES = 8


def along_x(force: float) -> Array:
    return np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])


def loop(
    law: Admittance, hand: Callable[[float, float, float], float], z: Array, now_s: float
) -> tuple[Array, list[float]]:
    """One strategic cycle of 20 ms along x; state and the force of every millisecond.

    The loop of the robot: the sensor sends the mean of the last 10 ms at every SYNC, less what the tool's inertia takes; the strategic
    cycle has the reading of the SYNC before; the planner smooths at 100 Hz, and what it computes in a cycle is gone in the next but one
    interval. z: position, velocity, velocity at the last SYNC, sum of forces, reading, mass velocity, twist, smoothed twist.
    """
    x, v, last_v, total, reading, mass, twist, smoothed = z
    forces = []
    for ms in range(20):
        if ms % 10 == 0:
            fresh = total / 10.0 - TOOL_KG * (v - last_v) / 0.01
            last_v, total = v, 0.0
            if ms == 0:
                state = AdmittanceState(along_x(mass), NOTHING, along_x(twist))
                state, sent = admit(law, state, along_x(reading), np.eye(3), 1.0, CYCLE_S)
                mass, twist = float(state.velocity[0]), float(sent[0])
            reading = fresh
            v = smoothed
            smoothed += 0.01 / (SMOOTHING_S + 0.01) * (twist - smoothed)
        force = hand(now_s + 1e-3 * ms, x, v)
        forces.append(force)
        total += force
        x += v * 1e-3
    return np.array([x, v, last_v, total, reading, mass, twist, smoothed]), forces


def growth(law: Admittance, stiffness: float, damping: float) -> float:
    """Spectral radius of the loop over one cycle: below 1 everything dies out."""
    columns = [loop(law, lambda _, x, v: -stiffness * x - damping * v, e, 0.0)[0] for e in np.eye(STATES)]
    return float(np.abs(np.linalg.eigvals(np.column_stack(columns))).max())


def walk(t: float, speed: float, ramp: float, until: float) -> tuple[float, float]:
    """Way and speed of a hand that goes at `speed` from t = 0 and rests from `until` on, with smooth ramps."""

    def one(t: float) -> tuple[float, float]:
        u = min(max(t / ramp, 0.0), 1.0)
        return ramp * (u**3 - u**4 / 2.0) + max(t - ramp, 0.0), u * u * (3.0 - 2.0 * u)

    (p, v), (q, w) = one(t), one(t - until + ramp)
    return speed * (p - q), speed * (v - w)


def guided(law: Admittance, stiffness: float, damping: float, seconds: float = 6.0) -> Array:
    """Force (N) of every millisecond on a hand that goes at 0.2 m/s for 3 s, then rests."""
    z, forces = np.zeros(STATES), []

    def hand(t: float, x: float, v: float) -> float:
        p, w = walk(t, 0.2, 1.0, 3.0)
        return stiffness * (p - x) + damping * (w - v)

    for cycle in range(round(seconds / CYCLE_S)):
        z, more = loop(law, hand, z, cycle * CYCLE_S)
        forces.extend(more)
    return np.array(forces)


@given(stiffness=st.floats(200.0, 5000.0), damping=st.floats(0.0, 50.0))
@settings(max_examples=60, deadline=None)
def test_the_loop_is_stable_for_every_hand(stiffness: float, damping: float) -> None:
    assert growth(LINEAR, stiffness, damping) < 0.995


def test_what_makes_it_stable_is_the_lead() -> None:
    assert growth(replace(LINEAR, lead_s=0.0), 5000.0, 20.0) > 1.03
    assert growth(LINEAR, 5000.0, 20.0) < 0.99
    assert growth(LINEAR, 12000.0, 20.0) > 1.0  # this model can tell


@given(stiffness=st.floats(200.0, 5000.0))
@settings(max_examples=15, deadline=None)
def test_a_hand_at_a_fifth_of_a_metre_per_second_feels_at_most_25_newtons_and_then_rests(stiffness: float) -> None:
    forces = guided(LAW, stiffness, 20.0)
    assert np.abs(forces).max() <= 25.0
    assert np.abs(forces).max() >= 8.0  # it does carry something
    assert np.abs(forces[-1000:]).max() < 1.0  # nothing outside the dead band goes on


def test_without_guidance_the_hand_pulls_at_a_wall() -> None:
    assert np.abs(guided(replace(LAW, gain=0.0), 500.0, 20.0)).max() > 150.0


six = st.lists(st.floats(-80.0, 80.0), min_size=6, max_size=6).map(np.array)
positive = st.lists(st.floats(0.5, 200.0), min_size=6, max_size=6).map(np.array)


@given(st.lists(six, min_size=1, max_size=40), positive, positive)
def test_the_virtual_mass_never_has_more_energy_than_was_put_into_it(
    wrenches: list[Array], mass: Array, damping: Array
) -> None:
    law = replace(LINEAR, mass=mass, damping=damping, guided=np.ones(6))
    state, work = AdmittanceState.at_rest(), 0.0
    for wrench in wrenches:
        state, _ = admit(law, state, wrench, np.eye(3), 1.0, CYCLE_S)
        work += float(wrench @ state.velocity) * CYCLE_S
        stored = 0.5 * float(state.velocity @ (mass * state.velocity))
        assert stored <= work + 1e-9 * (1.0 + abs(work))


@given(st.floats(0.0, 200.0), st.floats(1.0, 200.0), st.floats(1.0, 400.0), st.floats(0.01, 1000.0))
def test_the_lead_keeps_the_admittance_passive(lead: float, mass: float, damping: float, omega: float) -> None:
    response = (1.0 + 1j * omega * lead) / (1j * omega * mass + damping)
    assert response.real > 0.0


vectors = st.lists(st.floats(-100.0, 100.0), min_size=3, max_size=3).map(np.array)


@given(vectors, st.floats(0.01, 20.0))
def test_the_dead_band_is_smooth_and_only_takes(vector: Array, band: float) -> None:
    rest, norm = without_band(vector, band), float(np.linalg.norm(vector))
    length = float(np.linalg.norm(rest))
    assert length <= norm + 1e-12
    np.testing.assert_allclose(np.cross(rest, vector), 0.0, atol=1e-9 * (1.0 + norm**2))
    assert rest @ vector >= 0.0
    longer = without_band(1.001 * vector, band)
    assert -1e-9 <= float(np.linalg.norm(longer)) - length <= 0.001 * norm * (1.0 + 1e-6) + 1e-9


def test_the_dead_band_by_numbers() -> None:
    assert without_band(np.array([0.1, 0.0, 0.0]), 1.0)[0] == pytest.approx(0.1**3 / 3.0, rel=0.01)
    assert without_band(np.array([0.0, 20.0, 0.0]), 1.0)[1] == pytest.approx(19.0, abs=1e-9)
    assert not without_band(np.zeros(3), 1.0).any()
    np.testing.assert_array_equal(without_band(np.array([1.0, 2.0, 3.0]), 0.0), [1.0, 2.0, 3.0])


@given(st.lists(st.lists(st.floats(-1e4, 1e4), min_size=6, max_size=6).map(np.array), min_size=2, max_size=30))
def test_speed_and_acceleration_stay_inside_their_bounds_whatever_pulls(wrenches: list[Array]) -> None:
    law = replace(LAW, guided=np.ones(6))
    state = AdmittanceState.at_rest()
    for wrench in wrenches:
        before = state.velocity
        state, twist = admit(law, state, wrench, np.eye(3), 1.0, CYCLE_S)
        change = (state.velocity - before) / CYCLE_S
        for half, speed, acceleration in ((slice(0, 3), 0.5, 2.5), (slice(3, 6), 1.0, 6.0)):
            assert np.linalg.norm(twist[half]) <= speed + 1e-12
            assert np.linalg.norm(change[half]) <= acceleration + 1e-9


def cycles_to_reverse(path_scale: float) -> int:
    """How long after a force was turned round the twist turns, after 4 s of pushing along a path of `path_scale`."""
    state = AdmittanceState.at_rest()
    for _ in range(200):
        state, _ = admit(LAW, state, along_x(40.0), np.eye(3), path_scale, CYCLE_S)
    for cycle in range(1, 200):
        state, twist = admit(LAW, state, along_x(-40.0), np.eye(3), path_scale, CYCLE_S)
        if twist[0] < 0.0:
            return cycle
    raise AssertionError("never turned")


def test_a_path_that_stands_does_not_wind_the_mass_up() -> None:
    assert cycles_to_reverse(0.0) <= 2
    assert cycles_to_reverse(1.0) >= 5


@given(st.floats(0.0, 0.95), st.floats(5.0, 60.0))
def test_what_is_asked_for_stays_near_what_is_granted(path_scale: float, force: float) -> None:
    """Pushing on does not raise the demand beyond what one cycle of force adds to what the path let through."""
    state = AdmittanceState.at_rest()
    for _ in range(300):
        state, twist = admit(LAW, state, along_x(force), np.eye(3), path_scale, CYCLE_S)
    step = 2.5 * (CYCLE_S + LAW.lead_s)
    assert twist[0] - path_scale * twist[0] <= 0.01 + step


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array))
def test_the_tools_weight_moves_nothing_in_any_orientation(turn: Array) -> None:
    tool = Tool(1.4, np.array([0.01, -0.02, -0.08]))
    rotation = rotation_exp(turn)
    down = rotation.T @ np.array([0.0, 0.0, -1.4 * 9.81])
    raw = np.concatenate([down, np.cross(tool.centre, down)])
    np.testing.assert_allclose(without_weight(raw, tool, rotation), 0.0, atol=1e-12)
    law = replace(LAW, tool=tool, dead_band=Pair(0.0, 0.0), guided=np.ones(6))
    _, twist = admit(law, AdmittanceState.at_rest(), raw, rotation, 1.0, CYCLE_S)
    np.testing.assert_allclose(twist, 0.0, atol=1e-12)
    _, twist = admit(replace(law, tool=None), AdmittanceState.at_rest(), raw, rotation, 1.0, CYCLE_S)
    assert np.linalg.norm(twist) > 0.01


def test_a_tool_below_a_hand_that_looks_up_by_numbers() -> None:
    """Half a turn about x: down is +z of the end point; a centre 0.1 m aside makes a moment about y."""
    rotation = np.diag([1.0, -1.0, -1.0])
    wrench = without_weight(np.zeros(6), Tool(2.0, np.array([0.1, 0.0, 0.0])), rotation)
    np.testing.assert_allclose(wrench, [0.0, 0.0, -19.62, 0.0, 1.962, 0.0], atol=1e-12)


def test_without_a_reading_it_comes_to_rest() -> None:
    state = AdmittanceState(along_x(0.3), along_x(20.0), along_x(0.3))
    for _ in range(150):
        state, twist = admit(LAW, state, None, np.eye(3), 1.0, CYCLE_S)
    assert np.linalg.norm(twist) < 1e-3


def test_a_mass_that_goes_straight_does_not_turn_with_the_hand() -> None:
    state = AdmittanceState(along_x(0.3), NOTHING, NOTHING)
    turned = carried(state, np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(turned.velocity[:3], [0.0, -0.3, 0.0], atol=1e-12)
    assert carried(state, np.zeros(3)) is state


def test_only_guided_axes_follow_and_each_has_its_own_damping() -> None:
    law = replace(LINEAR, damping=np.array([50.0, 100.0, 200.0, 2.0, 2.0, 2.0]), guided=np.array([1.0, 1, 1, 0, 0, 1]))
    state = AdmittanceState.at_rest()
    for _ in range(2000):
        state, twist = admit(law, state, np.array([10.0, 10.0, 10.0, 1.0, 1.0, 1.0]), np.eye(3), 1.0, CYCLE_S)
    np.testing.assert_allclose(twist, [0.2, 0.1, 0.05, 0.0, 0.0, 0.5], rtol=1e-6)


def test_parameters_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="mass"):
        Admittance(mass=np.zeros(6))
    with pytest.raises(ValueError, match="must not be negative"):
        Admittance(lead_s=-0.1)


def test_bounded_keeps_the_direction() -> None:
    np.testing.assert_allclose(bounded(np.array([3.0, 4.0, 0.0]), 1.0), [0.6, 0.8, 0.0])
    np.testing.assert_array_equal(bounded(np.array([0.3, 0.4, 0.0]), 1.0), [0.3, 0.4, 0.0])


def heard(t_s: float, wrench: Array | None, scale: float = 1.0, X_RE: Array | None = None) -> MotionInputs:
    planner = PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, scale, 0)
    return MotionInputs(t_s, planner, np.eye(3), X_RE, wrench)


def test_guiding_ends_after_its_time_and_says_how_hard_it_was() -> None:
    motion = Guide(LAW, 1.0)
    state = motion.begin(heard(0.0, NOTHING))
    for cycle in range(50):
        state, outputs = motion.step(state, heard(cycle * CYCLE_S, along_x(12.0)))
        assert not outputs.done
    assert outputs.twist[0] > 0.1
    _, outputs = motion.step(state, heard(1.0, along_x(12.0)))
    assert outputs.done
    assert outputs.event is not None
    assert "at most 12.0 N" in outputs.event


def test_a_silent_sensor_ends_the_guiding_with_a_reason() -> None:
    motion = Guide(LAW, 10.0)
    state = motion.begin(heard(0.0, None))
    said = []
    for cycle in range(40):
        state, outputs = motion.step(state, heard(cycle * CYCLE_S, None))
        said.append(outputs.failure)
    assert said[23] is None
    assert said[26] is not None
    assert "force sensor" in said[26]


def test_a_short_gap_in_the_readings_ends_nothing() -> None:
    motion = Guide(LAW, 10.0)
    state = motion.begin(heard(0.0, None))
    for cycle in range(100):
        state, outputs = motion.step(state, heard(cycle * CYCLE_S, None if cycle % 20 < 15 else along_x(5.0)))
        assert outputs.failure is None


def test_the_orientation_for_the_weight_is_the_present_one() -> None:
    tool = Tool(1.0, np.zeros(3))
    motion = Guide(replace(LAW, tool=tool), 10.0)
    X_RE = np.eye(4)
    X_RE[:3, :3] = rotation_exp([np.pi / 2, 0.0, 0.0])
    raw = np.concatenate([X_RE[:3, :3].T @ [0.0, 0.0, -9.81], np.zeros(3)])
    _, outputs = motion.step(motion.begin(heard(0.0, raw)), heard(0.0, raw, X_RE=X_RE))
    assert np.linalg.norm(outputs.twist) < 1e-12
    _, outputs = motion.step(motion.begin(heard(0.0, raw)), heard(0.0, raw))
    assert np.linalg.norm(outputs.twist) > 0.01
