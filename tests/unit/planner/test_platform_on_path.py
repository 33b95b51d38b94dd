"""The planner with its platform bound to a path, in a closed loop with wheels that are late."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stack.messages import Mode
from stack.planner.parameters import Coordination, Method, PlannerParameters
from stack.planner.platform_path import CirclePath, LinePath, PlatformPath, RelativePath, SplinePath
from tests.unit.planner.plant import PERIOD, ROBOT, Loop, parameters


def bound(path: PlatformPath, coordination: Coordination = Coordination.ABC, **changes: object) -> PlannerParameters:
    return replace(parameters(coordination, **changes), platform_path=RelativePath(path))


def along(loop: Loop, direction: tuple[float, float, float]) -> np.ndarray:
    """Twist (6,) in the end-point frame along a direction of the world."""
    twist = np.zeros(6)
    twist[:3] = loop.tcp()[:3, :3].T @ np.array(direction)
    return twist


def pull(loop: Loop, velocity: tuple[float, float, float], seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the TCP (mm) and poses of the platform (k, 3) over a motion with ramps of a second."""
    errors, poses = [], []
    for k in range(round(seconds / PERIOD)):
        ramp = min(1.0, k * PERIOD, max(0.0, seconds - 1.0 - k * PERIOD))
        _, error = loop.step(Mode.COORDINATED, ramp * along(loop, velocity))
        errors.append(0.0 if error is None else 1e3 * error)
        poses.append(loop.base.copy())
    return np.array(errors), np.array(poses)


def distances(path: PlatformPath, poses: np.ndarray) -> np.ndarray:
    s, found = 0.0, []
    for x, y, _ in poses:
        s = path.closest(x, y, s)
        point = path.at(s)
        found.append(math.hypot(x - point.x, y - point.y))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("radius", [0.6, -2.0])
def test_forwards_and_backwards_on_a_circle(method: Method, radius: float) -> None:
    loop, circle = Loop(bound(CirclePath(radius), method=method)), CirclePath(radius)
    first, there = pull(loop, (0.1, 0.0, 0.0), 5.0)
    second, back = pull(loop, (-0.1, 0.0, 0.0), 5.0)
    assert max(first.max(), second.max()) < 0.5
    assert there[-1][2] * radius > 0.1, "it did not drive forwards"
    assert abs(back[-1][2]) < 0.6 * abs(there[-1][2]), "it did not drive backwards"
    poses = np.vstack((there, back))
    assert distances(circle, poses).max() < 1e-3
    for x, y, heading in poses:  # no flip-over
        tangent = circle.at(circle.closest(x, y, 0.0)).heading
        assert abs(math.remainder(heading - tangent, 2 * math.pi)) < 0.02


@pytest.mark.parametrize("coordination", list(Coordination))
def test_every_coordination_keeps_to_the_path_and_only_arm_only_stays_behind(coordination: Coordination) -> None:
    loop, path = Loop(bound(SplinePath([(0.4, 0.05), (0.9, 0.0)]), coordination)), SplinePath([(0.4, 0.05), (0.9, 0.0)])
    _, poses = pull(loop, (0.1, 0.0, 0.0), 3.0)
    assert distances(path, poses).max() < 2e-3
    assert (poses[-1][0] > 0.05) == (coordination is not Coordination.ARM_ONLY)


def test_at_the_end_of_a_line_the_platform_stops_and_the_arm_goes_on() -> None:
    loop = Loop(bound(LinePath(-1.0, 0.25)))
    start = loop.tcp()[:3, 3].copy()
    errors, poses = pull(loop, (0.1, 0.0, 0.0), 5.6)
    rest, stays = pull(loop, (0.0, 0.0, 0.0), 2.0)
    assert loop.tcp()[0, 3] - start[0] == pytest.approx(0.36, abs=2e-3)
    assert max(errors.max(), rest.max()) < 1.0
    x = np.concatenate((poses[:, 0], stays[:, 0]))
    assert x.max() < 0.252
    assert x[-1] == pytest.approx(0.25, abs=2e-3)
    assert np.abs(np.diff(x, 2)).max() / PERIOD**2 <= 1.1 * ROBOT.limits.dv_max


def test_speeds_and_accelerations_of_the_platform_are_kept_on_a_tight_path() -> None:
    loop = Loop(bound(CirclePath(0.25)))
    last, limits = (0.0, 0.0), ROBOT.limits
    for k in range(600):
        outputs, _ = loop.step(Mode.COORDINATED, along(loop, (0.8 * math.cos(k / 40), 0.8 * math.sin(k / 40), 0.0)))
        v, omega = outputs.platform.rate
        assert abs(v) <= limits.v_max + 1e-9
        assert abs(omega) <= limits.omega_max + 1e-9
        period = loop.parameters.platform_period_s
        assert abs(v - last[0]) <= limits.dv_max * period + 1e-9
        assert abs(omega - last[1]) <= limits.domega_max * period + 1e-9
        last = (v, omega)
    assert distances(CirclePath(0.25), loop.base[None]).max() < 5e-3


def test_a_path_is_taken_up_where_the_platform_stands_and_left_again() -> None:
    free = bound(LinePath())
    loop = Loop(replace(free, platform_path=None))
    pull(loop, (0.0, 0.15, 0.0), 5.0)
    start = loop.base.copy()
    assert abs(start[2]) > 0.2, "it has not turned"
    loop.parameters = free
    errors, poses = pull(loop, (0.0, 0.1, 0.0), 3.0)
    aside = (poses[:, 1] - start[1]) * math.cos(start[2]) - (poses[:, 0] - start[0]) * math.sin(start[2])
    assert np.abs(aside).max() < 2e-3
    assert np.abs(poses[:, 2] - start[2]).max() < 0.03
    assert errors.max() < 0.5
    loop.parameters = replace(free, platform_path=None)
    _, poses = pull(loop, (0.0, 0.15, 0.0), 4.0)
    assert abs(poses[-1][2] - start[2]) > 0.1, "it did not become free"


def test_whoever_drives_the_platform_elsewhere_begins_the_path_there() -> None:
    loop = Loop(bound(LinePath()))
    pull(loop, (0.1, 0.0, 0.0), 3.0)
    for _ in range(300):
        loop.step(Mode.PLATFORM_ONLY, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.3]))
    for _ in range(100):
        loop.step(Mode.PLATFORM_ONLY, np.zeros(6))
    start = loop.base.copy()
    assert start[2] > 0.5
    _, poses = pull(loop, (0.06, 0.06, 0.0), 3.0)
    aside = (poses[:, 1] - start[1]) * math.cos(start[2]) - (poses[:, 0] - start[0]) * math.sin(start[2])
    assert np.hypot(*(poses[-1] - start)[:2]) > 0.05
    assert np.abs(aside).max() < 2e-3
