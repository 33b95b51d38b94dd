"""Wheel plant and slip: what the encoder can and cannot see, dead time, bandwidth, statistics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim.slip import Slip, SlipParameters
from sim.wheel_plant import WheelPlant, WheelPlantParameters
from sim.world import WorldParameters

DT = 1e-3


def slip_record(parameters: SlipParameters, seed: int, steps: int) -> np.ndarray:
    slip = Slip(parameters, seed, DT)
    record = np.empty((steps, 2))
    for row in record:
        slip.advance()
        row[:] = slip.ratio
    return record


def test_slip_has_the_statistics_of_an_ornstein_uhlenbeck_process() -> None:
    sigma, tau = 0.02, 0.05
    record = slip_record(SlipParameters(sigma=sigma, tau_s=tau), seed=5, steps=200_000)  # 4000 correlation times
    assert np.abs(record.mean(axis=0)).max() < 4 * sigma * np.sqrt(2 * tau / 200)
    assert record.std(axis=0) == pytest.approx(sigma, rel=0.06)
    for lag in (20, 50, 100):
        correlation = (record[lag:] * record[:-lag]).mean(axis=0) / sigma**2
        assert correlation == pytest.approx(np.exp(-lag * DT / tau), abs=0.08)
    assert abs(np.corrcoef(record.T)[0, 1]) < 0.08  # the wheels slip independently


def test_slip_starts_in_its_stationary_state() -> None:
    first = np.array([Slip(SlipParameters(sigma=0.01), seed, DT).ratio for seed in range(500)])
    assert first.std() == pytest.approx(0.01, rel=0.1)


def test_no_sigma_is_exactly_no_slip() -> None:
    assert not slip_record(SlipParameters(sigma=0.0), seed=1, steps=3000).any()


def test_slip_is_clipped_and_seeded() -> None:
    wild = SlipParameters(sigma=1.0, limit=0.3)
    record = slip_record(wild, seed=2, steps=5000)
    assert np.abs(record).max() == 0.3
    assert np.array_equal(record, slip_record(wild, seed=2, steps=5000))
    assert not np.array_equal(record, slip_record(wild, seed=3, steps=5000))


@pytest.mark.parametrize(
    "field", [{"sigma": -0.1}, {"tau_s": 0.0}, {"limit": 1.0}, {"sigma": float("nan")}], ids=lambda f: next(iter(f))
)
def test_bad_slip_parameters_are_named(field: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"slip.{next(iter(field))}"):
        SlipParameters(**field)


def step_response(command: float, seconds: float) -> np.ndarray:
    plant = WheelPlant(WheelPlantParameters(), DT)
    still = np.zeros(2)
    response = []
    for _ in range(round(seconds / DT)):
        plant.drive(np.full(2, command), still, still)
        response.append(plant.speed[0])
    return np.array(response)


def test_dead_time_is_forty_milliseconds() -> None:
    response = step_response(0.1, 0.2)
    assert np.flatnonzero(response)[0] == 40


def test_bandwidth_identified_from_a_small_step_is_two_and_a_half_hertz() -> None:
    response = step_response(0.1, 1.0)[40:]
    rise = np.flatnonzero(response >= 0.1 * (1 - np.exp(-1)))[0] * DT
    assert 1 / (2 * np.pi * rise) == pytest.approx(2.5, rel=0.03)


def test_a_large_step_is_limited_in_acceleration() -> None:
    response = step_response(6.0, 2.0)
    acceleration = np.diff(response) / DT
    assert acceleration.max() == pytest.approx(WheelPlantParameters().acceleration)
    assert response[-1] == pytest.approx(6.0, rel=1e-3)


def test_real_wheels_on_the_floor_follow_like_the_model(rig: Callable[..., Any]) -> None:
    one = rig()
    reached = []
    for _ in range(100):
        one.cycle((3.0, 3.0), after_tick=lambda: reached.append(one.velocity[0]))
    servo_ramp_s = 3.0 / one.servo.parameters.acceleration_limit[0]
    reached_array = np.array(reached)
    assert abs(reached_array[:40]).max() < 2e-3
    assert reached_array[-1] == pytest.approx(3.0, abs=0.03)
    half = np.flatnonzero(reached_array > 1.5)[0] * DT
    assert half == pytest.approx(0.040 + 1 / (2 * np.pi * 2.5) + servo_ramp_s / 2, abs=0.03)


def test_the_encoder_sees_the_wheel_and_not_its_slip(rig: Callable[..., Any]) -> None:
    one = rig()
    one.world.plant.slip.bias[:] = 0.1  # a tenth of the way is lost
    before = one.world.physics.pose_WB()[0, 3], one.position[0]
    one.drive(0.4, 0.0, 3.0)
    travelled = one.world.physics.pose_WB()[0, 3] - before[0]
    turned = (one.position[0] - before[1]) * 0.1
    assert turned == pytest.approx(1.2, rel=0.01)
    assert travelled == pytest.approx(0.9 * turned, rel=1e-3)


def test_unequal_slip_turns_the_platform_unseen(rig: Callable[..., Any]) -> None:
    one = rig()
    one.world.plant.slip.bias[:] = 0.05, 0.0
    one.drive(0.4, 0.0, 2.0)
    pose = one.world.physics.pose_WB()
    seen = (one.position[1] - one.position[0]) * 0.1 / 0.45
    assert abs(seen) < 2e-3
    assert np.arctan2(pose[1, 0], pose[0, 0]) == pytest.approx(0.05 * one.position[0] * 0.1 / 0.45, rel=0.03)


def test_standard_noise_takes_the_platform_off_by_centimetres(rig: Callable[..., Any]) -> None:
    one = rig(WorldParameters(), seed=4)
    one.drive(0.5, 0.0, 4.0)
    pose = one.world.physics.pose_WB()
    odometry = one.position[:2].mean() * 0.1
    assert 1e-4 < np.hypot(pose[0, 3] - odometry, pose[1, 3]) < 0.1
