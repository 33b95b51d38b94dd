"""Cubic through the cyclic set points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.servo.interpolation import hermite, linear, node_velocity

T = 0.01
values = st.floats(-10.0, 10.0)


def follow(targets: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities every millisecond through targets T apart, from rest at the first one."""
    previous = older = targets[0]
    velocity = 0.0
    positions, velocities = [], []
    for target in targets[1:]:
        end_velocity = node_velocity(target, previous, older, T)
        for k in range(1, 11):
            p, v = hermite(previous, velocity, target, end_velocity, k * 1e-3, T)
            positions.append(p)
            velocities.append(v)
        previous, older, velocity = target, previous, end_velocity
    return np.array(positions), np.array(velocities)


@given(values, values, values, values)
def test_a_segment_meets_both_its_ends(p0: float, v0: float, p1: float, v1: float) -> None:
    assert hermite(p0, v0, p1, v1, 0.0, T) == pytest.approx((p0, v0))
    assert hermite(p0, v0, p1, v1, T, T) == (p1, v1)
    almost = hermite(p0, v0, p1, v1, T * (1 - 1e-9), T)
    assert almost[0] == pytest.approx(p1, abs=1e-5)
    assert almost[1] == pytest.approx(v1, abs=1e-3)


@given(values, values, values, values, st.floats(0.05, 0.95))
def test_velocity_is_the_derivative_of_position(p0: float, v0: float, p1: float, v1: float, u: float) -> None:
    step = 1e-7
    before, after = (hermite(p0, v0, p1, v1, u * T + s, T)[0] for s in (-step, step))
    assert hermite(p0, v0, p1, v1, u * T, T)[1] == pytest.approx((after - before) / (2 * step), rel=1e-4, abs=1e-3)


def test_every_target_is_passed_at_its_time() -> None:
    targets = [0.0, 0.1, -0.2, 0.05, 0.3]
    positions, _ = follow(targets)
    assert positions[9::10] == pytest.approx(targets[1:], abs=1e-15)


@pytest.mark.parametrize("acceleration", [0.0, 3.0])
def test_parabolas_are_reproduced_between_the_targets(acceleration: float) -> None:
    t = np.arange(12) * T
    positions, velocities = follow(list(0.4 * t + acceleration / 2 * t**2))
    fine = np.arange(1, 111) * 1e-3
    assert positions[30:] == pytest.approx((0.4 * fine + acceleration / 2 * fine**2)[30:], abs=1e-12)
    assert velocities[30:] == pytest.approx((0.4 + acceleration * fine)[30:], abs=1e-9)


def test_a_sine_is_followed_far_below_what_an_encoder_sees() -> None:
    t = np.arange(200) * T
    positions, _ = follow(list(0.3 * np.sin(np.pi * t)))
    fine = np.arange(1, 1991) * 1e-3
    assert np.abs(positions - 0.3 * np.sin(np.pi * fine))[100:].max() < 2e-6


def test_velocity_does_not_jump_at_the_targets() -> None:
    random = np.random.default_rng(1)
    targets = list(np.cumsum(random.normal(0, 1e-3, 50)))
    previous = older = targets[0]
    velocity = 0.0
    for target in targets[1:]:
        end_velocity = node_velocity(target, previous, older, T)
        assert hermite(previous, velocity, target, end_velocity, 0.0, T)[1] == velocity
        previous, older, velocity = target, previous, end_velocity


def test_past_the_last_target_it_goes_on_straight() -> None:
    assert hermite(0.0, 0.0, 1.0, 2.0, T + 0.005, T) == pytest.approx((1.0 + 2.0 * 0.005, 2.0))


def test_a_straight_line_ends_at_its_target_and_stays() -> None:
    assert linear(1.0, 3.0, 0.0, T) == 1.0
    assert linear(1.0, 3.0, T / 4, T) == pytest.approx(1.5)
    assert linear(1.0, 3.0, 2 * T, T) == 3.0
