"""The planner in a closed loop with a platform that does not obey at once."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from stack.messages import Mode, Restriction
from stack.planner.parameters import Coordination, Method
from stack.planner.planner import PlannerState
from tests.unit.planner.plant import PERIOD, ROBOT, Loop, along_y, parameters


def pull(loop: Loop, seconds: float = 4.0, speed: float = 0.2) -> np.ndarray:
    """Errors (mm) of a pull along y with a ramp of one second."""
    errors = []
    for k in range(round(seconds / PERIOD)):
        _, error = loop.step(Mode.COORDINATED, along_y(speed * min(1.0, k * PERIOD)))
        if error is not None:
            errors.append(1e3 * error)
    return np.array(errors)


def test_the_arm_takes_up_what_the_platform_does_not_do() -> None:
    abc = pull(Loop(parameters()))
    unified = pull(Loop(parameters(Coordination.UNIFIED)))
    assert abc.max() < 0.5
    assert unified.max() > 10.0
    assert np.sqrt(np.mean(abc**2)) < np.sqrt(np.mean(unified**2)) / 20


@pytest.mark.parametrize("method", list(Method))
def test_every_method_follows(method: Method) -> None:
    loop = Loop(parameters(method=method))
    assert pull(loop, 2.0).max() < 0.6
    assert loop.tcp()[1, 3] > 0.7


def test_the_platform_turns_along_the_path() -> None:
    loop = Loop(parameters())
    pull(loop, 14.0)
    assert loop.base[2] == pytest.approx(np.pi / 2, abs=0.2)
    assert loop.base[1] > 1.5


def test_same_arguments_same_answer_and_nothing_is_written_to() -> None:
    loop = Loop(parameters())
    pull(loop, 0.5)
    state, before = loop.state, copy.deepcopy(loop.state)
    first, _ = loop.step(Mode.COORDINATED, along_y(0.2))
    again, twin = Loop(parameters()), None
    pull(again, 0.5)
    twin, _ = again.step(Mode.COORDINATED, along_y(0.2))
    np.testing.assert_array_equal(first.q, twin.q)
    np.testing.assert_array_equal(first.effort, twin.effort)
    assert first.wheels == twin.wheels
    assert_same(state, before)


def assert_same(state: PlannerState, before: PlannerState) -> None:
    np.testing.assert_array_equal(state.q_next, before.q_next)
    np.testing.assert_array_equal(state.X_RE, before.X_RE)
    np.testing.assert_array_equal(state.command.twist, before.command.twist)
    np.testing.assert_array_equal(state.drift.T_RO, before.drift.T_RO)
    assert (state.odometry, state.rate, state.commanded) == (before.odometry, before.rate, before.commanded)


def test_a_twist_that_stays_away_brings_the_robot_to_rest() -> None:
    loop = Loop(parameters())
    pull(loop, 2.0)
    for _ in range(300):
        outputs, _ = loop.step(Mode.COORDINATED, None)
    assert outputs.restrictions & Restriction.STALE_TWIST
    here = loop.tcp()[:3, 3]
    for _ in range(100):
        loop.step(Mode.COORDINATED, None)
    np.testing.assert_allclose(loop.tcp()[:3, 3], here, atol=1e-4)


def test_lost_feedback_costs_accuracy_not_the_motion() -> None:
    loop, errors = Loop(parameters()), []
    for k in range(300):
        lost = k > 100 and k % 10 in (3, 4)
        outputs, error = loop.step(Mode.COORDINATED, along_y(0.2 * min(1.0, k * PERIOD)), heard=not lost)
        assert bool(outputs.restrictions & Restriction.STALE_DRIVE) == lost
        if error is not None:
            errors.append(error)
    assert max(errors) < 1e-3


def test_nothing_begins_before_the_drives_have_been_heard() -> None:
    loop = Loop(parameters())
    outputs, _ = loop.step(Mode.COORDINATED, along_y(0.2), heard=False)
    assert outputs.X_RE is None
    assert outputs.wheels == (0.0, 0.0)
    assert outputs.restrictions & Restriction.STALE_DRIVE


def test_platform_only_leaves_the_arm_alone() -> None:
    loop, twist = Loop(parameters()), np.zeros(6)
    for k in range(600):
        twist = np.array([0.3, 0, 0, 0, 0, 0.3]) * np.clip(min(k, 400 - k) / 100, 0.0, 1.0)
        outputs, _ = loop.step(Mode.PLATFORM_ONLY, twist)
        np.testing.assert_array_equal(outputs.q, ROBOT.arm.home)
    assert loop.base[2] == pytest.approx(0.9, abs=0.03)
    assert np.hypot(loop.base[0], loop.base[1]) == pytest.approx(2 * np.sin(0.45), abs=0.03)


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.ARM_ONLY])
def test_hold_and_arm_only_keep_the_platform_still(mode: Mode) -> None:
    loop = Loop(parameters())
    for _ in range(100):
        outputs, _ = loop.step(mode, along_y(0.02) if mode is Mode.ARM_ONLY else None)
        assert outputs.wheels == (0.0, 0.0)
    if mode is Mode.ARM_ONLY:
        assert loop.tcp()[1, 3] > ROBOT.arm.pose(ROBOT.arm.home)[1, 3] + 0.01


def test_null_space_motion_adjusts_the_arm_while_the_tcp_rests_and_can_be_switched_off() -> None:
    wish = parameters()
    higher, heights, weights = ROBOT.arm.preferred.copy(), np.zeros(8), np.ones(10)
    higher[1] += 0.1
    heights[1], weights[1] = 0.1, 50.0
    preferences = replace(wish.preferences, preferred=higher, heights=heights, weights=weights)
    on = Loop(replace(wish, preferences=preferences))
    off = Loop(replace(wish, preferences=preferences, null_space_motion=False))
    for _ in range(400):
        _, error = on.step(Mode.HOLD, None)
        off.step(Mode.HOLD, None)
        assert error is None or error < 2e-4
    assert on.q[1] > ROBOT.arm.home[1] + 0.03
    np.testing.assert_allclose(off.q, ROBOT.arm.home, atol=1e-6)


def test_a_path_out_of_reach_waits_at_the_border_instead_of_tearing_the_arm_along() -> None:
    loop = Loop(parameters(Coordination.ARM_ONLY, method=Method.QP))
    errors = pull(loop, 6.0)
    assert errors.max() < 12.0
    assert loop.tcp()[1, 3] < 1.2


def test_limits_hold_whatever_is_commanded() -> None:
    rng = np.random.default_rng(4)
    loop = Loop(parameters())
    twist, last = np.zeros(6), np.zeros(8)
    for k in range(1500):
        if k % 60 == 0:
            twist = rng.normal(size=6) * [0.6, 0.6, 0.6, 1.5, 1.5, 1.5]
        outputs, _ = loop.step(Mode.COORDINATED, twist)
        limits = ROBOT.limits
        assert np.all(outputs.q <= ROBOT.arm.q_max + 1e-9)
        assert np.all(outputs.q >= ROBOT.arm.q_min - 1e-9)
        assert np.all(np.abs(outputs.dq) <= limits.dq_max + 1e-9)
        assert np.all(np.abs(outputs.dq - last) <= limits.ddq_max * PERIOD + 1e-9)
        assert abs(outputs.platform.rate.v) <= limits.v_max + 1e-9
        assert abs(outputs.platform.rate.omega) <= limits.omega_max + 1e-9
        assert np.isfinite(outputs.effort).all()
        last = outputs.dq


def test_without_the_rule_base_set_points_stop_at_the_limits_and_nothing_else_knows() -> None:
    loop = Loop(replace(parameters(), joint_limit_rules=False))
    up = np.zeros(6)
    up[:3] = ROBOT.arm.pose(ROBOT.arm.home)[:3, :3].T @ np.array([0.0, 0.0, 0.1])
    errors = []
    for _ in range(1000):
        outputs, error = loop.step(Mode.ARM_ONLY, up)
        assert np.all(outputs.q <= ROBOT.arm.q_max)
        assert np.all(outputs.q >= ROBOT.arm.q_min)
        errors.append(0.0 if error is None else error)
    assert max(errors) > 0.02


def test_while_the_path_waits_for_the_arm_the_platform_slows_down() -> None:
    wish = parameters()
    loop = Loop(replace(wish, preferences=replace(wish.preferences, platform_gain=0.0, heights=np.zeros(8))))
    ahead = np.concatenate((loop.tcp()[:3, :3].T @ [0.2, 0.0, 0.0], np.zeros(3)))
    for k in range(400):
        outputs, _ = loop.step(Mode.COORDINATED, ahead * min(1.0, k * PERIOD))
    driven = outputs.platform.rate.v
    assert driven > 0.15
    shifted = loop.state.X_RE.copy()
    shifted[0, 3] += 0.3
    loop.state = replace(loop.state, X_RE=shifted)
    for _ in range(20):
        outputs, _ = loop.step(Mode.COORDINATED, ahead)
        assert outputs.arm.scale == 0.0, "the path does not wait"
    assert outputs.platform.rate.v < driven - 0.05
