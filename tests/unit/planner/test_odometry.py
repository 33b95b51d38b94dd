"""Dead reckoning: exact on arcs, tolerant of lost readings, right ahead of time where the motion is steady."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics.arm import ArmModel
from stack.kinematics.platform import platform_of, wheel_speeds
from stack.planner.odometry import Odometry, PlatformPose, PlatformRate, WheelModel, advance

PLATFORM = platform_of(ArmModel.load("moma8"))
PERIOD = 0.01
MODEL = WheelModel(PLATFORM.wheel_bandwidth, PLATFORM.wheel_dead_time)


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
    for _ in range(20):
        heard = heard.commanded(PlatformRate(0.3, 0.2))
    missing = heard.without_reading().without_reading()
    assert missing.ahead(0, PERIOD, MODEL) == pytest.approx(heard.ahead(2, PERIOD, MODEL), abs=1e-12)


@given(st.floats(-0.6, 0.6), st.floats(-1.2, 1.2), st.integers(0, 5))
def test_ahead_in_steady_motion_is_exact(v: float, omega: float, periods: int) -> None:
    odometry = driven(v, omega, 30)
    for _ in range(20):
        odometry = odometry.commanded(PlatformRate(v, omega))
    expected = advance(PlatformPose(0.0, 0.0, 0.0), v * (30 + periods) * PERIOD, omega * (30 + periods) * PERIOD)
    assert odometry.ahead(periods, PERIOD, MODEL) == pytest.approx(expected, abs=1e-9)


def test_ahead_follows_a_step_of_the_command_as_the_wheels_will() -> None:
    """A plant with dead time and lag in small steps, against what was predicted two cycles before."""
    command, speed, angle = [], 0.0, 0.0
    odometry, predictions, truth = Odometry(), [], []
    lag = MODEL.share(0.001)
    history = [0.0] * 200
    for k in range(100):
        odometry = odometry.update(PLATFORM, angle, angle, PERIOD)
        truth.append(angle * PLATFORM.wheel_radius)
        predictions.append(odometry.ahead(2, PERIOD, MODEL).x)
        wanted = 0.4 if k >= 20 else 0.0
        odometry = odometry.commanded(PlatformRate(wanted, 0.0))
        command.append(wanted)
        for i in range(10):
            # applied at the next SYNC as a ramp over one period, then the dead time
            u = (i + 1) / 10
            before, after = ([0.0, 0.0, *command])[k : k + 2] if k else (0.0, 0.0)
            history.append(before + u * (after - before))
            speed += lag * (history[-1 - round(MODEL.dead_time_s * 1e3)] / PLATFORM.wheel_radius - speed)
            angle += speed * 0.001
    errors = [abs(predicted - true) for predicted, true in zip(predictions[:-2], truth[2:], strict=True)]
    assert max(errors) < 4e-4, "two cycles of 0.4 m/s are 8 mm"
    assert errors[-1] < 1e-6


def test_the_prediction_does_not_amplify_what_shakes_the_wheels() -> None:
    """Readings that shake by some mm/s from period to period must not come out larger than they went in."""
    shaken, calm = driven(0.3, 0.0, 30), driven(0.3, 0.0, 30)
    left, right = (angle + 0.01 * PERIOD / PLATFORM.wheel_radius for angle in calm.wheels or (0.0, 0.0))
    shaken = calm.update(PLATFORM, left + 0.3 * PERIOD / 0.1, right + 0.3 * PERIOD / 0.1, PERIOD)
    calm = driven(0.3, 0.0, 31)
    difference = shaken.ahead(2, PERIOD, MODEL).x - calm.ahead(2, PERIOD, MODEL).x
    assert abs(difference) <= 3 * 0.01 * PERIOD * 1.001
