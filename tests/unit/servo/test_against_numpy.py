"""The compiled kernels against the same law in plain, vectorised NumPy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from stack.servo import AxisMode, Servo, ServoParameters

DT, T, N = 1e-3, 0.01, 10
Array = np.ndarray


@dataclass
class NumpyServo:
    """All axes at once by masks; position, velocity, and stop modes, targets every period."""

    p: ServoParameters
    point: Array = field(default_factory=lambda: np.zeros(N))
    speed: Array = field(default_factory=lambda: np.zeros(N))
    nominal: Array = field(default_factory=lambda: np.zeros(N))
    integral: Array = field(default_factory=lambda: np.zeros(N))
    nodes: list[Array] = field(default_factory=list)
    offsets: list[Array] = field(default_factory=list)
    ticks: int = 0

    def accept(self, target: Array, offset: Array, mode: Array) -> None:
        if not self.nodes:
            start = np.where(mode == AxisMode.VELOCITY, 0.0, self.point)
            self.nodes, self.node_velocity = [start, start], np.zeros(N)
            self.offsets = [offset]
            self.nominal = self.point.copy()
        older, previous = self.nodes[-2:]
        self.nodes = [previous, target]
        self.start_velocity = self.node_velocity
        self.node_velocity = (3 * target - 4 * previous + older) / (2 * T)
        self.offsets = [self.offsets[-1], offset]
        self.ticks = 0

    def brake(self, distance: Array) -> Array:
        loss = self.p.acceleration_limit * DT**2
        ticks = np.maximum(np.ceil((np.sqrt(1 + 8 * np.maximum(distance, 0) / loss) - 1) / 2), 1)
        return np.where(distance > 0, (distance / ticks + (ticks - 1) * loss / 2) / DT, 0.0)

    def tick(self, mode: Array, position: Array, velocity: Array) -> Array:
        p = self.p
        self.ticks += 1
        u = self.ticks / 10
        basis = np.array([2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, -2 * u**3 + 3 * u**2, u**3 - u**2])
        cubic = basis @ np.array([self.nodes[0], T * self.start_velocity, self.nodes[1], T * self.node_velocity])
        cubic = np.clip(cubic, p.lower, p.upper)
        lag = self.nominal - self.point
        chase = np.sign(lag) * np.minimum(np.abs(lag) / DT, self.brake(np.abs(lag)))
        ramp = self.nodes[0] + (self.nodes[1] - self.nodes[0]) * u
        wanted = np.where(mode == AxisMode.POSITION, (cubic - self.nominal) / DT + chase, ramp)
        error = self.point - position
        base = np.where(mode == AxisMode.VELOCITY, position, self.point)
        allowed = np.clip(wanted, -p.velocity_limit, p.velocity_limit)
        allowed = np.minimum(allowed, np.where(allowed > 0, self.brake(p.upper - base), np.inf))
        allowed = np.maximum(allowed, np.where(allowed < 0, -self.brake(base - p.lower), -np.inf))
        change = p.acceleration_limit * DT
        before = self.speed
        self.speed = np.clip(allowed, before - change, before + change)
        self.point = base + self.speed * DT
        self.nominal = np.where(mode == AxisMode.POSITION, cubic, self.point)
        mean = 0.5 * (before + self.speed)
        command = np.where(mode == AxisMode.POSITION, p.velocity_feed_forward * mean + p.position_gain * error, mean)
        command = np.clip(command, -1.05 * p.velocity_limit, 1.05 * p.velocity_limit)
        miss = command - velocity
        integral = np.clip(self.integral + p.integral_gain * miss * DT, -p.integral_limit, p.integral_limit)
        runaway = (np.abs(velocity) > 1.05 * p.velocity_limit) & (integral * velocity > 0)
        integral = np.where(runaway, 0.0, integral)
        offset = self.offsets[0] + (self.offsets[1] - self.offsets[0]) * (u - 0.05)
        wanted_torque = p.velocity_gain * miss + offset + integral
        torque = np.clip(wanted_torque, -p.torque_limit, p.torque_limit)
        winding = (torque != wanted_torque) & ((integral - self.integral) * torque > 0)
        self.integral = np.where(winding, self.integral, integral)
        wheel_output = np.clip(self.speed, -p.velocity_limit, p.velocity_limit)
        return np.where(p.outputs_velocity, wheel_output, torque)


def random_parameters(random: np.random.Generator) -> ServoParameters:
    return ServoParameters(
        position_gain=random.uniform(5, 20, N),
        velocity_gain=random.uniform(5, 100, N),
        integral_gain=random.uniform(0, 300, N),
        integral_limit=random.uniform(1, 20, N),
        velocity_feed_forward=random.uniform(0.5, 1.0, N),
        lower=random.uniform(-0.6, -0.1, N),
        upper=random.uniform(0.1, 0.6, N),
        velocity_limit=random.uniform(0.5, 3.0, N),
        acceleration_limit=random.uniform(5, 60, N),
        stop_deceleration=random.uniform(5, 60, N),
        torque_limit=random.uniform(20, 100, N),
        outputs_velocity=np.arange(N) < 2,
    )


@pytest.mark.parametrize("seed", range(12))
def test_a_second_of_wild_targets_gives_the_same_numbers(seed: int) -> None:
    random = np.random.default_rng(seed)
    settings = random_parameters(random)
    servo, plain = Servo(settings, DT), NumpyServo(settings)
    mode = np.where(np.arange(N) < 4, AxisMode.VELOCITY, AxisMode.POSITION).astype(np.int64)
    position, velocity, output = np.zeros(N), np.zeros(N), np.zeros(N)
    flags = np.zeros(N, dtype=np.int64)
    servo.tick(np.zeros(N, dtype=np.int64), position, velocity, output, flags)
    target, seen = np.zeros(N), 0
    for _ in range(100):
        target = np.clip(target + random.normal(0, 0.02, N), -0.8, 0.8)
        offset = random.normal(0, 5, N)
        servo.accept(mode, np.ones(N, dtype=np.bool_), target, offset, T)
        plain.accept(target, offset, mode)
        for _ in range(10):
            servo.tick(mode, position, velocity, output, flags)
            expected = plain.tick(mode, position, velocity)
            assert output == pytest.approx(expected, rel=1e-6, abs=1e-6)
            assert servo.state.set_point == pytest.approx(plain.point, abs=1e-10)
            seen |= int(np.bitwise_or.reduce(flags))
            velocity = 0.9 * velocity + 0.1 * servo.state.set_velocity + random.normal(0, 0.01, N)
            position = position + velocity * DT
    assert seen & 7 == 7  # the limits were in play
