"""Dead reckoning: exact on arcs, tolerant of lost readings, right ahead of time where the motion is steady."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics.arm import ArmModel
from stack.kinematics.platform import platform_of, wheel_speeds
from stack.planner.odometry import Odometry, PlatformPose, advance

PLATFORM = platform_of(ArmModel.load("moma8"))
PERIOD = 0.01


def driven(v: float, omega: float, cycles: int, lost: frozenset[int] = frozenset()) -> Odometry:
    left, right = wheel_speeds(PLATFORM, v, omega)
    odometry = Odometry()
    for k in range(cycles + 1):
        if k in lost:
            odometry = odometry.without_reading()
        else:
            odometry = odometry.update(PLATFORM, left * k * PERIOD, right * k * PERIOD, PERIOD)
    return odometry


@given(st.floats(-0.6, 0.6), st.floats(-1.2, 1.2), st.integers(1, 200))
def test_constant_rates_give_the_arc(v: float, omega: float, cycles: int) -> None:
    pose = driven(v, omega, cycles).pose
    expected = advance(PlatformPose(0.0, 0.0, 0.0), v * cycles * PERIOD, omega * cycles * PERIOD)
    assert pose == pytest.approx(expected, abs=1e-9)


def test_a_full_circle_closes() -> None:
    pose = advance(PlatformPose(1.0, 2.0, 0.3), 2.0 * math.pi * 0.7, 2.0 * math.pi)
    assert pose[:2] == pytest.approx((1.0, 2.0), abs=1e-12)


@given(st.floats(-0.6, 0.6), st.floats(-1.2, 1.2), st.frozensets(st.integers(5, 28)))
def test_lost_readings_cost_nothing_once_one_comes(v: float, omega: float, lost: frozenset[int]) -> None:
    whole, patched = driven(v, omega, 30), driven(v, omega, 30, lost)
    # while frames are missing an arc is taken for the whole gap, which at constant rates it is
    assert patched.pose == pytest.approx(whole.pose, abs=1e-9)
    assert patched.rate == pytest.approx(whole.rate, abs=1e-9)


def test_ahead_counts_from_now_also_while_readings_are_missing() -> None:
    heard = driven(0.3, 0.2, 100)
    missing = heard.without_reading().without_reading()
    assert missing.ahead(0, PERIOD) == pytest.approx(heard.ahead(2, PERIOD), abs=1e-12)


def test_ahead_in_steady_acceleration_is_right_to_micrometres() -> None:
    odometry, acceleration = Odometry(), 0.5
    for k in range(60):
        angle = 0.5 * acceleration * (k * PERIOD) ** 2 / PLATFORM.wheel_radius
        odometry = odometry.update(PLATFORM, angle, angle, PERIOD)
    x = odometry.ahead(2, PERIOD).x
    assert x == pytest.approx(0.5 * acceleration * (61 * PERIOD) ** 2, abs=2e-6)
