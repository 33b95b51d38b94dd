"""Preferences that are written in mid-motion come in without a jump."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.messages import Mode
from stack.planner.parameters import Preferences
from stack.planner.preference_change import PreferenceChange, mixed
from stack.planner.preferences import preferred_velocity
from tests.unit.planner.plant import PERIOD, ROBOT, Loop, parameters

S = 1_000_000_000


def drawn(seed: int) -> Preferences:
    rng = np.random.default_rng(seed)
    arrays = [rng.uniform(-1, 1, 8), rng.uniform(0, 1, 8), rng.uniform(0.1, 1, 8), rng.uniform(0.1, 5, 10)]
    return Preferences(*arrays, *rng.uniform(0, 1, 5).tolist())


seeds = st.integers(0, 2**32 - 1)


@given(seeds, seeds, seeds, st.floats(0.0, 1.0), st.floats(0.0, 1.5))
def test_what_is_wished_is_continuous_whenever_it_is_changed(a: int, b: int, c: int, first: float, t: float) -> None:
    q, step_ns = np.linspace(-1.0, 1.0, 8), 1000
    change = PreferenceChange().towards(drawn(a), 0, 1.0).towards(drawn(b), 0, 1.0)
    change_ns = round(first * S)
    before = change.in_force(change_ns, 1.0)
    change = change.towards(drawn(c), change_ns, 1.0)
    t_ns = change_ns + round(t * S)
    for x, y in (
        (before, change.in_force(change_ns, 1.0)),
        (change.in_force(t_ns, 1.0), change.in_force(t_ns + step_ns, 1.0)),
    ):
        wishes = [preferred_velocity(q, p.preferred, p.heights, p.widths) for p in (x, y)]
        np.testing.assert_allclose(*wishes, atol=1e-4)
        np.testing.assert_allclose(x.weights, y.weights, atol=1e-4)
        assert x.platform_angle == pytest.approx(y.platform_angle, abs=1e-4)


def test_the_first_is_in_force_at_once_and_every_other_after_its_time() -> None:
    first, second = drawn(1), drawn(2)
    change = PreferenceChange().towards(first, 0, 1.0)
    assert change.in_force(0, 1.0) is first
    assert change.towards(first, S, 1.0) is change
    change = change.towards(second, S, 1.0)
    assert change.in_force(2 * S, 1.0) is second
    assert change.in_force(S, 1.0) is not second


def test_every_number_is_mixed() -> None:
    half = mixed(drawn(1), drawn(2), 0.5)
    for field in fields(Preferences):
        mean = 0.5 * (np.asarray(getattr(drawn(1), field.name)) + np.asarray(getattr(drawn(2), field.name)))
        np.testing.assert_allclose(getattr(half, field.name), mean, err_msg=field.name)


def test_a_lift_that_is_wanted_higher_begins_softly() -> None:
    wish = parameters()
    weights = np.ones(10)
    weights[1] = 100.0
    still = replace(wish.preferences, heights=np.zeros(8), weights=weights)
    loop = Loop(replace(wish, preferences=still))
    for _ in range(150):
        loop.step(Mode.HOLD, None)
    preferred, heights = ROBOT.arm.preferred.copy(), np.zeros(8)
    preferred[1] += 0.1
    heights[1] = 0.05
    loop.parameters = replace(wish, preferences=replace(still, preferred=preferred, heights=heights))
    rates, errors = [np.zeros(8)], []
    for _ in range(600):
        outputs, error = loop.step(Mode.HOLD, None)
        rates.append(outputs.dq)
        errors.append(error)
    acceleration = np.diff(rates, axis=0)[:, 1] / PERIOD
    assert loop.q[1] > ROBOT.arm.home[1] + 0.09
    assert np.abs(acceleration).max() < 0.15, "a jump to 0.05 m/s would take all of the 1 m/s² that the lift may"
    assert max(errors) < 1e-4
