"""Distances from paths and steps of acceleration against numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from logs.metrics import RunFacts, evaluate
from logs.path_metrics import (
    acceleration_steps,
    driven_distances,
    largest_distance_to_curve,
    platform_path_deviation,
    standing_s,
)
from logs.signals import DecodedBlock, Signal, SignalTable
from stack.kinematics import ArmModel
from stack.messages import Mode
from stack.planner.platform_path import CirclePath, LinePath, RelativePath

ARM = ArmModel.load("moma8")
PERIOD_NS = 10_000_000


def signal(values: object) -> Signal:
    array = np.asarray(values, float)
    return Signal(np.arange(len(array), dtype=np.int64) * PERIOD_NS, array)


def poses(places: list[tuple[float, float, float]]) -> Signal:
    """Platform poses from x, y, heading."""
    stack = np.tile(np.eye(4), (len(places), 1, 1))
    for pose, (x, y, heading) in zip(stack, places, strict=True):
        pose[:2, :2] = [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
        pose[:2, 3] = x, y
    return signal(stack)


def mission(modes: list[Mode]) -> Signal:
    return signal([[mode, 0] for mode in modes])


def test_way_forwards_and_backwards_is_told_by_the_heading_not_by_the_world() -> None:
    west = [(-0.01 * i, 0.0, math.pi) for i in range(11)]
    back = [(-0.1 + 0.01 * i, 0.0, math.pi) for i in range(1, 5)]
    assert driven_distances(poses(west + back)) == pytest.approx((0.1, 0.04))
    assert driven_distances(poses([(0.0, 0.0, 0.0)] * 3)) == (0.0, 0.0)
    assert driven_distances(None) == (None, None)


def test_a_turn_on_the_spot_is_no_way() -> None:
    assert driven_distances(poses([(1.0, 1.0, 0.1 * i) for i in range(60)])) == (0.0, 0.0)


def test_standing_between_two_ways_is_counted_even_where_late_ticks_share_their_time() -> None:
    there = [(0.01 * i, 0.0, 0.0) for i in range(5)]
    waited = [there[-1]] * 20
    on = [(there[-1][0] + 0.01 * i, 0.0, 0.0) for i in range(1, 5)]
    assert standing_s(poses(there + waited + on)) == pytest.approx(0.20)
    late = poses(there + waited + on)
    late.t_ns[10] = late.t_ns[9]
    late.t_ns[26] = late.t_ns[25]  # two places at one time
    assert standing_s(late) == pytest.approx(0.20)
    assert standing_s(poses(waited)) == 0.0


def on_circle(
    radius: float, off: float, turned: float, start: tuple[float, float, float]
) -> list[tuple[float, float, float]]:
    """A quarter of a circle from `start`, `off` metres to its left from the middle on, heading `turned` there."""
    x0, y0, a0 = start
    places = []
    for i in range(50):
        angle = i / 49 * 0.5 * math.pi
        aside, heading = (off, a0 + angle + turned) if i >= 25 else (0.0, a0 + angle)
        x = (radius - aside) * math.sin(angle)
        y = radius - (radius - aside) * math.cos(angle)
        places.append((x0 + math.cos(a0) * x - math.sin(a0) * y, y0 + math.sin(a0) * x + math.cos(a0) * y, heading))
    return places


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (2.0, -1.0, 2.5)])
def test_the_deviation_is_the_distance_from_the_circle_wherever_it_lies(start: tuple[float, float, float]) -> None:
    path = RelativePath(CirclePath(0.6))
    pose_WB = poses(on_circle(0.6, 0.004, 0.02, start))
    found = platform_path_deviation(pose_WB, mission([Mode.COORDINATED] * 50), path)
    assert found == pytest.approx((0.004, 0.02), abs=1e-9)


def test_the_path_lies_where_coordination_begins_and_counts_from_there() -> None:
    before = [(0.1 * i, 3.0, 1.0) for i in range(10)]  # driven there without a path
    then = on_circle(0.6, 0.003, 0.0, (1.0, 3.0, 0.5))
    modes = [Mode.PLATFORM_ONLY] * 10 + [Mode.COORDINATED] * 50
    path = RelativePath(CirclePath(0.6))
    # the reference is the first pose after the mission's word
    found = platform_path_deviation(poses([*before, then[0], *then]), mission([*modes, Mode.COORDINATED]), path)
    assert found[0] == pytest.approx(0.003, abs=1e-9)


def test_a_platform_that_turned_round_has_pi_to_show_for_it() -> None:
    places = [(0.01 * i, 0.0, 0.0) for i in range(10)] + [(0.1, 0.0, math.pi)]
    off, turn = platform_path_deviation(poses(places), mission([Mode.COORDINATED] * 11), RelativePath(LinePath()))
    assert (off, turn) == pytest.approx((0.0, math.pi))


def test_a_path_beside_the_start_is_measured_where_it_was_put() -> None:
    places = [(0.01 * i, 0.0, 0.0) for i in range(10)]
    given = RelativePath(LinePath(), 0.0, 0.2, 0.0)
    assert platform_path_deviation(poses(places), mission([Mode.COORDINATED] * 10), given)[0] == pytest.approx(0.2)


def test_without_path_or_coordination_there_is_nothing_to_measure() -> None:
    places, path = poses([(0.0, 0.0, 0.0)] * 3), RelativePath(LinePath())
    assert platform_path_deviation(places, mission([Mode.COORDINATED] * 3), None) == (None, None)
    assert platform_path_deviation(places, mission([Mode.ARM_ONLY] * 3), path) == (None, None)
    assert platform_path_deviation(None, None, path) == (None, None)


def tcp(points: np.ndarray) -> Signal:
    stack = np.tile(np.eye(4), (len(points), 1, 1))
    stack[:, :3, 3] = points
    return signal(stack)


def test_a_tcp_that_is_late_on_its_curve_is_on_it_and_one_beside_it_is_not() -> None:
    t = np.linspace(0.0, 1.5, 150)
    corner = np.column_stack([np.minimum(t, 0.7), np.maximum(t - 0.7, 0.0), np.zeros(150)])
    commanded = signal(np.hstack([corner, np.tile([0.0, 0.0, 0.0, 1.0], (150, 1))]))
    late = np.vstack([np.repeat(corner[:1], 5, axis=0), corner[:-5]])
    assert largest_distance_to_curve(tcp(late), commanded) == pytest.approx(0.0, abs=1e-4)
    assert largest_distance_to_curve(tcp(late + [0.0, 0.0, 0.003]), commanded) == pytest.approx(0.003, rel=1e-3)
    assert largest_distance_to_curve(None, commanded) is None


def test_a_path_that_comes_back_later_does_not_count_as_near() -> None:
    t = np.arange(400) * 0.01
    there_and_back = np.column_stack([np.minimum(t, 4.0 - t), np.zeros(400), np.zeros(400)])
    commanded = signal(np.hstack([there_and_back, np.tile([0.0, 0.0, 0.0, 1.0], (400, 1))]))
    truth = there_and_back.copy()
    truth[:50, 0] += 1.2  # where the path will be two seconds later
    assert largest_distance_to_curve(tcp(truth), commanded) == pytest.approx(1.2 - 0.5, abs=0.02)


def test_steps_of_acceleration_are_those_of_the_mean_over_a_cycle() -> None:
    dq = np.zeros((100, 8))
    dq[10:, 1] = 0.1  # stops or starts within a cycle: 10 m/s², and back to 0
    dq[:, 2] = 0.5 * np.arange(100) * 0.01  # constant acceleration: no step
    steps = acceleration_steps(signal(dq), (0, 99 * PERIOD_NS), ARM.joint_names)
    assert steps["tower_lift"] == pytest.approx(10.0)
    assert steps["shoulder"] == pytest.approx(0.0, abs=1e-9)
    later = acceleration_steps(signal(dq), (30 * PERIOD_NS, 99 * PERIOD_NS), ARM.joint_names)
    assert later["tower_lift"] == pytest.approx(0.0, abs=1e-9)
    assert acceleration_steps(None, (0, 1), ARM.joint_names) == {}
    ticks = signal(dq)
    late = Signal(np.append(ticks.t_ns, ticks.t_ns[-1:]), np.vstack([ticks.values, ticks.values[-1:]]))
    assert acceleration_steps(late, (0, 99 * PERIOD_NS), ARM.joint_names) == steps, "two ticks at one time"


def test_they_are_in_the_metrics_of_a_run() -> None:
    pose_WB = poses(on_circle(0.6, 0.004, 0.0, (0.0, 0.0, 0.0)))
    dq = np.zeros((50, 8))
    dq[20:, 1] = 0.02
    signals = {
        "truth/pose_WB": pose_WB,
        "truth/dq": signal(dq),
        "mission": mission([Mode.COORDINATED] * 50),
        "tcp/error": signal(np.zeros((50, 3))),
    }
    facts = RunFacts("x", 1, "pns", "abc", 1.0, 1.0, platform_path=RelativePath(CirclePath(0.6)))
    metrics = evaluate(SignalTable([DecodedBlock(signals)]), ARM, facts)
    assert metrics.platform_path_error_max_m == pytest.approx(0.004)
    assert metrics.platform_path_turn_max_rad == pytest.approx(0.0, abs=1e-9)
    assert metrics.platform_distance_forward_m == pytest.approx(0.94, abs=0.01)
    assert metrics.platform_distance_backward_m == pytest.approx(0.0, abs=1e-9)
    assert metrics.joint_acceleration_step_max["tower_lift"] == pytest.approx(2.0)
    assert evaluate(SignalTable(), ARM, facts).platform_path_error_max_m is None
