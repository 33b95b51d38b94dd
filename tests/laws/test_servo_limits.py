"""No master can make a drive's set point break the drive's limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.servo import (
    LIMITED_ACCELERATION,
    LIMITED_POSITION,
    LIMITED_TORQUE,
    LIMITED_VELOCITY,
    AxisMode,
    Servo,
    ServoParameters,
)
from stack.servo.limiter import braking_velocity, catch_up_velocity, limit_velocity

DT, T = 1e-3, 0.01
LOWER, UPPER, SPEED, ACCELERATION, TORQUE = -0.5, 0.8, 1.5, 20.0, 40.0
LIMITED = LIMITED_POSITION | LIMITED_VELOCITY | LIMITED_ACCELERATION | LIMITED_TORQUE


def one_axis(**changes: float) -> Servo:
    values = {
        "position_gain": 12.0,
        "velocity_gain": 50.0,
        "integral_gain": 100.0,
        "integral_limit": 10.0,
        "velocity_feed_forward": 1.0,
        "lower": LOWER,
        "upper": UPPER,
        "velocity_limit": SPEED,
        "acceleration_limit": ACCELERATION,
        "stop_deceleration": 12.0,
        "torque_limit": TORQUE,
    } | changes
    arrays = {name: np.array([value]) for name, value in values.items()}
    return Servo(ServoParameters(**arrays, outputs_velocity=np.array([False])), DT)


class Axis:
    """One servo axis on a body that follows its set point, or stays where it is."""

    def __init__(self, servo: Servo, position: float = 0.0) -> None:
        self.servo = servo
        self.position, self.velocity = np.array([position]), np.zeros(1)
        self.output, self.flags = np.zeros(1), np.zeros(1, dtype=np.int64)
        self.tick(AxisMode.OFF)

    def accept(self, mode: AxisMode, target: float, offset: float = 0.0) -> None:
        modes = np.array([mode], dtype=np.int64)
        self.servo.accept(modes, np.array([True]), np.array([target]), np.array([offset]), T)

    def tick(self, mode: AxisMode, follows: bool = True) -> tuple[float, float]:
        modes = np.array([mode], dtype=np.int64)
        self.servo.tick(modes, self.position, self.velocity, self.output, self.flags)
        point, speed = float(self.servo.state.set_point[0]), float(self.servo.state.set_velocity[0])
        if follows and mode not in (AxisMode.OFF, AxisMode.TORQUE):
            self.position[0], self.velocity[0] = self.position[0] + speed * DT, speed
        return point, speed


orders = st.lists(
    st.tuples(
        st.sampled_from([AxisMode.POSITION, AxisMode.POSITION, AxisMode.VELOCITY, AxisMode.STOP]),
        st.floats(-3.0, 3.0),
        st.integers(1, 45),
        st.booleans(),
    ),
    min_size=1,
    max_size=12,
)


@given(orders, st.floats(LOWER, UPPER))
def test_set_points_keep_position_velocity_and_acceleration_limits(
    sequence: list[tuple[AxisMode, float, int, bool]], start: float
) -> None:
    axis = Axis(one_axis(), start)
    before = 0.0
    for mode, target, ticks, heard in sequence:
        if heard:
            axis.accept(mode, target)
        for _ in range(ticks):
            point, speed = axis.tick(mode)
            assert LOWER - 1e-9 <= point <= UPPER + 1e-9
            assert abs(speed) <= SPEED * (1 + 1e-12)
            assert abs(speed - before) <= ACCELERATION * DT * (1 + 1e-9)
            assert abs(axis.output[0]) <= TORQUE
            before = speed


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-10, 10), st.floats(-1e5, 1e5))
def test_torque_stays_inside_its_limit_whatever_happens(p: float, v: float, target: float, offset: float) -> None:
    for mode in (AxisMode.POSITION, AxisMode.VELOCITY, AxisMode.TORQUE, AxisMode.STOP):
        axis = Axis(one_axis())
        axis.accept(mode, target, offset)
        axis.position[0], axis.velocity[0] = p, v
        for _ in range(3):
            axis.tick(mode, follows=False)
            assert abs(axis.output[0]) <= TORQUE


@given(st.floats(1e-9, 5.0), st.floats(0.1, 100.0))
def test_braking_velocity_stops_exactly_within_the_distance(distance: float, deceleration: float) -> None:
    speed = braking_velocity(distance, deceleration, DT)
    travelled = 0.0
    while speed > 0.0:
        travelled += speed * DT
        speed -= deceleration * DT
    assert travelled == pytest.approx(distance, rel=1e-9, abs=1e-12)


@given(st.floats(0.001, 5.0), st.floats(0.1, 100.0))
def test_braking_velocity_is_nearly_the_continuous_one(distance: float, deceleration: float) -> None:
    ideal = math.sqrt(2 * deceleration * distance)
    assert braking_velocity(distance, deceleration, DT) == pytest.approx(ideal, abs=deceleration * DT)


def test_no_distance_no_velocity() -> None:
    assert braking_velocity(0.0, 10.0, DT) == 0.0
    assert braking_velocity(-0.1, 10.0, DT) == 0.0


@given(st.floats(-2.0, 2.0), st.floats(0.5, 50.0))
def test_catching_up_never_overshoots(error: float, acceleration: float) -> None:
    point, speed = 0.0, 0.0
    for _ in range(20_000):
        wanted = catch_up_velocity(error - point, acceleration, DT)
        speed, _ = limit_velocity(wanted, point, speed, -math.inf, math.inf, 5.0, acceleration, DT)
        point += speed * DT
        assert abs(point) <= abs(error) + 1e-9
        if point == error:
            break
    assert point == pytest.approx(error, abs=1e-9)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=30))
def test_within_the_limits_nothing_is_touched(accelerations: list[float]) -> None:
    """Targets planned with a fifth of the acceleration limit go through unchanged and unflagged."""
    axis = Axis(one_axis())
    target = speed = 0.0
    for share in accelerations:
        speed += share * ACCELERATION / 5 * T
        speed = max(-1.2, min(1.2, speed))
        if not -0.45 < target + speed * T < 0.75:
            break
        target += speed * T
        axis.accept(AxisMode.POSITION, target)
        for _ in range(10):
            point, _ = axis.tick(AxisMode.POSITION)
            assert not axis.flags[0] & LIMITED
            assert point == axis.servo.state.nominal[0]
        assert point == pytest.approx(target, abs=1e-12)


@pytest.mark.parametrize(
    ("target", "flag"),
    [(0.9, LIMITED_POSITION), (0.03, LIMITED_VELOCITY), (0.004, LIMITED_ACCELERATION)],
)
def test_it_says_which_limit_was_in_the_way(target: float, flag: int) -> None:
    axis = Axis(one_axis(acceleration_limit=1e4 if flag == LIMITED_VELOCITY else ACCELERATION))
    axis.accept(AxisMode.POSITION, target)
    seen = 0
    for _ in range(10):
        axis.tick(AxisMode.POSITION)
        seen |= int(axis.flags[0])
    assert seen & flag


def test_an_axis_beyond_its_limit_is_brought_back_gently() -> None:
    axis = Axis(one_axis(), position=1.0)
    before, furthest = 0.0, 1.0
    for _ in range(100):
        axis.accept(AxisMode.POSITION, 1.0)
        for _ in range(10):
            point, speed = axis.tick(AxisMode.POSITION)
            assert abs(speed - before) <= ACCELERATION * DT * (1 + 1e-9)
            before, furthest = speed, max(furthest, point)
    assert furthest == 1.0
    assert point == pytest.approx(UPPER, abs=1e-9)
