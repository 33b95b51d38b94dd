"""What each limiter of a drive does at its bound, and from which excess on it says so."""

from __future__ import annotations

import math

import pytest

from stack.servo.limiter import (
    LIMITED_ACCELERATION,
    LIMITED_POSITION,
    LIMITED_TORQUE,
    LIMITED_VELOCITY,
    OVERDUE,
    STANDSTILL,
    braking_velocity,
    catch_up_velocity,
    clamp,
    limit_velocity,
)

DT, SPEED, ACCELERATION = 1e-3, 1.5, 20.0
CHANGE = ACCELERATION * DT
FAR = math.inf
BELOW, ABOVE = 0.5e-9, 4e-9
"""Excesses that are rounding, and that are none."""


def test_each_flag_is_a_bit_of_its_own() -> None:
    flags = (LIMITED_POSITION, LIMITED_VELOCITY, LIMITED_ACCELERATION, LIMITED_TORQUE, STANDSTILL, OVERDUE)
    assert sorted(flags) == [1, 2, 4, 8, 16, 32]


def test_a_value_at_its_bound_is_not_limited() -> None:
    assert [clamp(x, -1.0, 2.0) for x in (-1.0, 2.0, 0.3)] == [(-1.0, False), (2.0, False), (0.3, False)]
    assert [clamp(x, -1.0, 2.0) for x in (-1.1, 2.1)] == [(-1.0, True), (2.0, True)]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("excess", "flag"), [(0.0, 0), (BELOW, 0), (ABOVE, LIMITED_VELOCITY)])
def test_velocity_is_limited_and_says_so_beyond_rounding(sign: float, excess: float, flag: int) -> None:
    wanted = sign * SPEED * (1 + excess)
    assert limit_velocity(wanted, 0.0, wanted, -FAR, FAR, SPEED, ACCELERATION, DT) == (sign * SPEED, flag)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("excess", "flag"), [(0.0, 0), (BELOW, 0), (ABOVE, LIMITED_ACCELERATION)])
@pytest.mark.parametrize("before", [0.0, 0.4])
def test_acceleration_is_limited_and_says_so_beyond_rounding(
    before: float, sign: float, excess: float, flag: int
) -> None:
    wanted = before + sign * (CHANGE + excess)
    velocity, flags = limit_velocity(wanted, 0.0, before, -FAR, FAR, SPEED, ACCELERATION, DT)
    assert velocity == pytest.approx(before + sign * CHANGE, rel=1e-12)
    assert abs(velocity - before) <= CHANGE * (1 + 1e-12)
    assert flags == flag


@pytest.mark.parametrize(("excess", "flag"), [(5e-8, 0), (3e-7, LIMITED_ACCELERATION)])
def test_what_counts_as_rounding_grows_with_the_acceleration(excess: float, flag: int) -> None:
    wanted = 1e5 * DT + excess
    assert limit_velocity(wanted, 0.0, 0.0, -FAR, FAR, 1e3, 1e5, DT) == (1e5 * DT, flag)


def test_next_to_no_distance_is_one_tick_and_not_two() -> None:
    assert braking_velocity(1e-25, ACCELERATION, DT) == pytest.approx(1e-22)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("distance", [5e-6, 0.02])
@pytest.mark.parametrize(("excess", "flag"), [(0.0, 0), (BELOW, 0), (ABOVE, LIMITED_POSITION)])
def test_an_axis_that_still_can_stop_before_its_limit_is_left_alone(
    distance: float, sign: float, excess: float, flag: int
) -> None:
    """`distance` before either limit, with the other one far away or none at all."""
    fastest = braking_velocity(distance, ACCELERATION, DT)
    wanted = sign * (fastest + excess)
    for other in (FAR, 3.0):
        lower, upper = (-other, distance) if sign > 0 else (-distance, other)
        velocity, flags = limit_velocity(wanted, 0.0, wanted, lower, upper, SPEED, ACCELERATION, DT)
        assert (velocity, flags) == (pytest.approx(sign * fastest, rel=1e-12), flag)
        assert abs(velocity) <= fastest


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("position", [-0.6, 0.6])
def test_both_limits_are_measured_from_where_the_axis_is(sign: float, position: float) -> None:
    lower, upper = (position - 3.0, position + 0.02) if sign > 0 else (position - 0.02, position + 3.0)
    fastest = braking_velocity(0.02, ACCELERATION, DT)
    velocity, flags = limit_velocity(sign * 1.4, position, sign * fastest, lower, upper, SPEED, ACCELERATION, DT)
    assert velocity == pytest.approx(sign * fastest, rel=1e-9)
    assert flags == LIMITED_POSITION


@pytest.mark.parametrize(("ticks", "tenths"), [(1, 1.0), (2, 3.0), (3, 6.0), (4, 10.0)])
def test_whole_numbers_of_ticks_brake_away_whole_steps(ticks: int, tenths: float) -> None:
    """n ticks that each lose one step cover n(n+1)/2 of them."""
    assert braking_velocity(tenths * CHANGE * DT, ACCELERATION, DT) == pytest.approx(ticks * CHANGE, rel=1e-9)
    assert braking_velocity(0.5 * CHANGE * DT, ACCELERATION, DT) == pytest.approx(0.5 * CHANGE, rel=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_last_step_of_catching_up_ends_where_it_should(sign: float) -> None:
    assert catch_up_velocity(0.0, ACCELERATION, DT) == 0.0
    assert catch_up_velocity(sign * 1e-6, ACCELERATION, DT) == pytest.approx(sign * 1e-3, rel=1e-12)
    far = sign * braking_velocity(0.3, ACCELERATION, DT)
    assert catch_up_velocity(sign * 0.3, ACCELERATION, DT) == far
