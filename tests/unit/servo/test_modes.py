"""What an axis does in each of its modes, and on the way from one to another."""

from __future__ import annotations

import numpy as np
import pytest

from stack.servo import (
    LIMITED_TORQUE,
    LIMITED_VELOCITY,
    OVERDUE,
    STANDSTILL,
    AxisMode,
    Servo,
    ServoParameters,
)

DT, T = 1e-3, 0.01
INERTIA = 2.0


def parameters(outputs_velocity: bool = False, **changes: float) -> ServoParameters:
    values = {
        "position_gain": 12.0,
        "velocity_gain": 160.0,
        "integral_gain": 480.0,
        "integral_limit": 20.0,
        "velocity_feed_forward": 1.0,
        "lower": -3.0,
        "upper": 3.0,
        "velocity_limit": 2.0,
        "acceleration_limit": 30.0,
        "stop_deceleration": 10.0,
        "torque_limit": 100.0,
    } | changes
    arrays = {name: np.array([value]) for name, value in values.items()}
    return ServoParameters(**arrays, outputs_velocity=np.array([outputs_velocity]))


class Joint:
    """A servo axis on an inertia, with a load torque that the drive does not know."""

    def __init__(self, settings: ServoParameters, load: float = 0.0) -> None:
        self.servo = Servo(settings, DT)
        self.position, self.velocity = np.zeros(1), np.zeros(1)
        self.output, self.flags = np.zeros(1), np.zeros(1, dtype=np.int64)
        self.load = load

    def accept(self, mode: AxisMode, target: float, offset: float = 0.0, elapsed_s: float = 0.0) -> None:
        modes = np.array([mode], dtype=np.int64)
        self.servo.accept(modes, np.array([True]), np.array([target]), np.array([offset]), T, elapsed_s)

    def tick(self, mode: AxisMode, count: int = 1, held: bool = False) -> None:
        modes = np.array([mode], dtype=np.int64)
        for _ in range(count):
            self.servo.tick(modes, self.position, self.velocity, self.output, self.flags)
            if not held:
                self.velocity += (self.output - self.load) / INERTIA * DT
                self.position += self.velocity * DT

    @property
    def speed(self) -> float:
        return float(self.servo.state.set_velocity[0])

    @property
    def point(self) -> float:
        return float(self.servo.state.set_point[0])


def test_off_gives_no_torque_and_follows_the_encoder() -> None:
    joint = Joint(parameters())
    joint.position[0], joint.velocity[0] = 1.2, 0.3
    joint.accept(AxisMode.OFF, 5.0, 50.0)
    joint.tick(AxisMode.OFF, held=True)
    assert joint.output[0] == 0.0
    assert (joint.point, joint.speed) == (1.2, 0.3)


def test_switching_on_is_free_of_jumps() -> None:
    joint = Joint(parameters(), load=15.0)
    joint.position[0] = 0.7
    joint.tick(AxisMode.OFF, held=True)
    joint.accept(AxisMode.POSITION, 0.7, offset=15.0)
    joint.tick(AxisMode.POSITION)
    assert joint.output[0] == pytest.approx(15.0)
    joint.tick(AxisMode.POSITION, 9)
    assert joint.position[0] == pytest.approx(0.7, abs=1e-12)


def test_switched_on_without_a_target_it_holds_where_it_is() -> None:
    joint = Joint(parameters(), load=4.0)
    joint.position[0] = 0.7
    joint.tick(AxisMode.OFF, held=True)
    joint.tick(AxisMode.POSITION, 3000)
    assert joint.point == 0.7
    assert joint.position[0] == pytest.approx(0.7, abs=1e-5)
    assert not joint.flags[0] & OVERDUE


def test_unknown_load_is_taken_by_the_integral() -> None:
    joint = Joint(parameters(), load=10.0)
    for _ in range(500):
        joint.accept(AxisMode.POSITION, 0.0)
        joint.tick(AxisMode.POSITION, 10)
    assert joint.position[0] == pytest.approx(0.0, abs=1e-6)
    assert joint.servo.state.integral[0] == pytest.approx(10.0, abs=1e-3)


def test_the_integral_stops_at_its_limit_and_while_the_torque_saturates() -> None:
    stuck = Joint(parameters(integral_limit=20.0), load=90.0)
    for _ in range(200):
        stuck.accept(AxisMode.POSITION, 0.02)
        stuck.tick(AxisMode.POSITION, 10, held=True)
    assert stuck.servo.state.integral[0] == 20.0
    weak = Joint(parameters(torque_limit=5.0))
    for _ in range(200):
        weak.accept(AxisMode.POSITION, 0.3)
        weak.tick(AxisMode.POSITION, 10, held=True)
    assert weak.flags[0] & LIMITED_TORQUE
    assert weak.output[0] == 5.0
    assert weak.servo.state.integral[0] < 5.0


def test_what_a_held_joint_has_wound_up_does_not_drive_it_beyond_its_limit() -> None:
    joint = Joint(parameters(integral_limit=60.0, velocity_limit=1.0, velocity_gain=20.0))
    for k in range(60):
        joint.accept(AxisMode.POSITION, 0.009 * k)
        joint.tick(AxisMode.POSITION, 10, held=True)
    assert joint.servo.state.integral[0] > 10.0
    fastest = 0.0
    for k in range(60, 90):
        joint.accept(AxisMode.POSITION, 0.009 * k)
        for _ in range(10):
            joint.tick(AxisMode.POSITION)
            fastest = max(fastest, float(joint.velocity[0]))
    assert 1.0 < fastest < 1.3


def test_the_offset_runs_straight_from_one_target_to_the_next() -> None:
    joint = Joint(parameters())
    joint.accept(AxisMode.POSITION, 0.0, offset=10.0)
    joint.tick(AxisMode.POSITION, 10, held=True)
    joint.accept(AxisMode.POSITION, 0.0, offset=20.0)
    outputs = []
    for _ in range(12):
        joint.tick(AxisMode.POSITION, held=True)
        outputs.append(joint.output[0])
    assert outputs[:10] == pytest.approx(10.5 + np.arange(10.0))  # means over the ticks
    assert outputs[10:] == pytest.approx([20.0, 20.0])


def test_velocity_mode_reaches_its_target_at_the_next_sync() -> None:
    joint = Joint(parameters())
    joint.accept(AxisMode.VELOCITY, 0.2)
    joint.tick(AxisMode.VELOCITY, 5)
    assert joint.speed == pytest.approx(0.1)
    joint.tick(AxisMode.VELOCITY, 5)
    assert joint.speed == pytest.approx(0.2)
    for _ in range(300):
        joint.accept(AxisMode.VELOCITY, 0.2)
        joint.tick(AxisMode.VELOCITY, 10)
    assert joint.velocity[0] == pytest.approx(0.2, abs=1e-4)


def test_velocity_mode_stops_before_the_end_of_the_axis() -> None:
    joint = Joint(parameters(upper=0.5))
    for _ in range(200):
        joint.accept(AxisMode.VELOCITY, 1.5)
        joint.tick(AxisMode.VELOCITY, 10)
    assert 0.45 < joint.position[0] < 0.51  # the body lags a little behind the velocity it is asked for
    assert joint.speed == pytest.approx(0.0, abs=1e-3)


def test_a_wheel_gets_its_limited_velocity_as_output() -> None:
    wheel = Joint(
        parameters(outputs_velocity=True, velocity_limit=8.0, torque_limit=np.inf, lower=-np.inf, upper=np.inf)
    )
    outputs = []
    for _ in range(60):
        wheel.accept(AxisMode.VELOCITY, 12.0)
        for _ in range(10):
            wheel.tick(AxisMode.VELOCITY, held=True)
            outputs.append(wheel.output[0])
    assert np.diff(outputs).max() == pytest.approx(30.0 * DT)
    assert outputs[-1] == 8.0
    assert wheel.flags[0] & LIMITED_VELOCITY


def test_torque_mode_gives_target_and_offset_inside_torque_and_speed_limits() -> None:
    joint = Joint(parameters())
    joint.accept(AxisMode.TORQUE, 7.0, offset=3.0)
    joint.tick(AxisMode.TORQUE, held=True)
    assert joint.output[0] == 10.0
    joint.velocity[0] = 2.1  # beyond 2.0: braked
    joint.tick(AxisMode.TORQUE, held=True)
    assert joint.output[0] == pytest.approx(10.0 - 160.0 * 0.1)
    assert joint.flags[0] & LIMITED_VELOCITY
    joint.velocity[0] = 0.0
    joint.tick(AxisMode.TORQUE, 30, held=True)
    assert joint.output[0] == 0.0  # nobody has asked for torque for a while
    assert joint.flags[0] & OVERDUE


@pytest.mark.parametrize("wheel", [False, True])
def test_stop_brakes_at_its_deceleration_and_holds(wheel: bool) -> None:
    joint = Joint(parameters(outputs_velocity=wheel))
    for k in range(40):
        joint.accept(AxisMode.VELOCITY, min(1.0, 0.05 * k))
        joint.tick(AxisMode.VELOCITY, 10, held=wheel)
    start = joint.point
    speeds = [joint.speed]
    for _ in range(101):
        joint.tick(AxisMode.STOP, held=wheel)
        speeds.append(joint.speed)
    assert np.diff(speeds)[:99] == pytest.approx(-10.0 * DT, rel=1e-6)
    assert speeds[-1] == 0.0
    assert joint.flags[0] & STANDSTILL
    assert joint.point - start == pytest.approx(1.0 / (2 * 10.0), rel=0.05)
    rest = joint.point
    joint.tick(AxisMode.STOP, 500, held=wheel)
    assert joint.point == rest
    if wheel:
        assert joint.output[0] == 0.0
    else:
        assert joint.position[0] == pytest.approx(rest, abs=1e-3)


def test_after_a_stop_it_starts_again_from_where_it_stands() -> None:
    joint = Joint(parameters(), load=5.0)
    for k in range(30):
        joint.accept(AxisMode.POSITION, 0.005 * k, offset=5.0)
        joint.tick(AxisMode.POSITION, 10)
    joint.tick(AxisMode.STOP, 300)
    rest, torque = joint.point, joint.output[0]
    joint.accept(AxisMode.POSITION, rest, offset=5.0)
    joint.tick(AxisMode.POSITION)
    assert joint.output[0] == pytest.approx(torque, abs=0.05)
    joint.tick(AxisMode.POSITION, 9)
    assert joint.point == pytest.approx(rest, abs=1e-12)


def test_a_stopped_axis_still_takes_gravity_from_its_master() -> None:
    joint = Joint(parameters(), load=30.0)
    joint.tick(AxisMode.OFF)
    joint.velocity[0] = joint.position[0] = 0.0
    for _ in range(3):
        joint.accept(AxisMode.STOP, 9.9, offset=30.0)
        joint.tick(AxisMode.STOP, 10)
    assert joint.output[0] == pytest.approx(30.0, abs=0.5)
    assert abs(joint.point) < 1e-3


def test_one_missed_target_is_bridged_more_bring_it_to_a_stop() -> None:
    joint = Joint(parameters())
    for k in range(30):
        joint.accept(AxisMode.POSITION, 0.005 * k)
        joint.tick(AxisMode.POSITION, 10)
    joint.tick(AxisMode.POSITION, 10)  # target 30 is lost
    assert joint.point == pytest.approx(0.005 * 30, abs=1e-9)
    assert not joint.flags[0] & OVERDUE
    joint.accept(AxisMode.POSITION, 0.005 * 31)
    joint.tick(AxisMode.POSITION, 10)
    assert joint.point == pytest.approx(0.005 * 31, abs=1e-9)
    joint.tick(AxisMode.POSITION, 11)
    assert joint.flags[0] & OVERDUE
    assert joint.speed == pytest.approx(0.5 - 10.0 * DT, abs=1e-6)
    joint.tick(AxisMode.POSITION, 60)
    assert joint.speed == 0.0
    assert joint.point == pytest.approx(0.005 * 32 + 0.5**2 / (2 * 10.0), abs=1e-3)


def test_a_sync_between_ticks_is_no_jump() -> None:
    """SYNC arrives after the tick of its instant was computed: one tick of the segment is already over."""
    joint = Joint(parameters())
    speeds = []
    for k in range(30):
        joint.tick(AxisMode.POSITION)
        joint.accept(AxisMode.POSITION, 0.3 * (1 - np.cos(3.0 * T * (k + 1))), elapsed_s=DT)
        for _ in range(9):
            joint.tick(AxisMode.POSITION)
            speeds.append(joint.speed)
    assert np.abs(np.diff(speeds)).max() < 4 * 0.3 * 9.0 * DT


def test_settings_can_change_while_it_runs() -> None:
    joint = Joint(parameters())
    joint.accept(AxisMode.VELOCITY, 1.0)
    joint.servo.configure(parameters(velocity_limit=0.1))
    joint.tick(AxisMode.VELOCITY, 10)
    assert joint.speed == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("name", "value"),
    [("velocity_limit", 0.0), ("stop_deceleration", -1.0), ("velocity_gain", -1.0), ("lower", 3.0), ("upper", np.nan)],
)
def test_impossible_settings_are_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        parameters(**{name: value})
