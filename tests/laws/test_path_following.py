"""A platform on a path: one unknown that stands for two, the same for every method, forwards as backwards."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics.arm import turned_rows
from stack.kinematics.platform import extended, integrate_unicycle, path_column, platform_columns
from stack.planner.odometry import PlatformPose, PlatformRate
from stack.planner.parameters import Method, PlannerParameters
from stack.planner.path_following import (
    Deviation,
    PathCoordinator,
    PathFollower,
    in_reference,
    speed_bounds,
    steered,
    top_speed,
)
from stack.planner.platform_command import platform_wish
from stack.planner.platform_path import CirclePath, LinePath, PathPoint, RelativePath, SplinePath
from stack.planner.problem import Problem
from stack.planner.resolvers import RESOLVERS
from tests.unit.planner.plant import ROBOT, parameters

ARM, LIMITS = ROBOT.arm, ROBOT.limits
PERIOD = 0.05
COORDINATOR = PathCoordinator(ARM, LIMITS, np.array([0.15, 0.0, 0.35]))
BOUNDS = (-0.6, 0.6)
seeds = st.integers(0, 2**32 - 1)
curvatures = st.floats(-3.0, 3.0)
signs = st.sampled_from([-1.0, 1.0])


def drawn(seed: int, *, even: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray, PlannerParameters]:
    """q near home, TCP twist, slow twist, and preferences; `even`: all weights 1."""
    rng = np.random.default_rng(seed)
    q = ARM.home + rng.uniform(-0.15, 0.15, 8) * [1, 0.5, 1, 1, 1, 1, 1, 1]
    wish = parameters().preferences
    weights = np.ones(10) if even else rng.uniform(0.2, 5.0, 10)
    wish = replace(wish, weights=weights, preferred=ARM.home, heights=np.full(8, 0.05))
    return q, 0.03 * rng.normal(size=6), 0.1 * rng.normal(size=6), replace(parameters(), preferences=wish)


@given(seeds, curvatures, signs)
def test_the_column_of_s_is_the_twist_of_a_platform_on_the_path(seed: int, curvature: float, sign: float) -> None:
    state = ARM.state(drawn(seed)[0])
    point = state.position + COORDINATOR.base
    speed, dt = 0.3 * sign, 1e-6
    before, after = (integrate_unicycle((0.0, 0.0, 0.0), speed, curvature * speed, t) for t in (-0.5 * dt, 0.5 * dt))
    places = [
        (x + math.cos(a) * point[0] - math.sin(a) * point[1], y + math.sin(a) * point[0] + math.cos(a) * point[1])
        for x, y, a in (before, after)
    ]
    column = path_column(platform_columns(point), 1.0, curvature)
    moved = [(b - a) / dt for a, b in zip(*places, strict=True)]
    np.testing.assert_allclose(speed * column[:2], moved, atol=1e-8)
    assert speed * column[5] == pytest.approx((after[2] - before[2]) / dt, abs=1e-8)


@given(seeds, curvatures)
@pytest.mark.parametrize("method", [Method.PNS, Method.FSP, Method.QP])
def test_arm_and_path_together_do_the_task_as_well_as_a_platform_that_may_not_leave_it(
    method: Method, seed: int, curvature: float
) -> None:
    q, twist, slow, wanted = drawn(seed)
    state = ARM.state(q)
    found = COORDINATOR.on_path(state, twist, slow, curvature, BOUNDS, 1.0, replace(wanted, method=method))
    columns = turned_rows(state.rotation.T, platform_columns(state.position + COORDINATOR.base))
    jacobian = np.column_stack((state.end_point_jacobian, path_column(columns, 1.0, curvature)))
    np.testing.assert_allclose(jacobian @ found.dq, twist, atol=1e-7)
    wish = wanted.preferences
    z = np.append(wish.heights * np.tanh((wish.preferred - q) / wish.widths), platform_wish(state, slow, wish))
    row = np.zeros((1, 10))
    row[0, 8:] = -curvature, 1.0
    whole = RESOLVERS["pns"](Problem(extended(ARM, state), twist, B=wish.weights, z=z, A=row, b=np.zeros(1)))
    np.testing.assert_allclose(found.dq, whole.dq[:9], atol=1e-6)
    assert whole.dq[9] == pytest.approx(curvature * whole.dq[8], abs=1e-9)


@given(seeds, curvatures)
def test_all_methods_agree(seed: int, curvature: float) -> None:
    q, twist, slow, wanted = drawn(seed, even=True)
    # the gradient method knows no weights: with κ = 0 the path's own is 1 like all others
    curvature = 0.0 if seed % 2 else curvature
    state, answers = ARM.state(q), {}
    for method in Method:
        chosen = replace(wanted, method=method)
        answers[method] = COORDINATOR.on_path(state, twist, slow, curvature, BOUNDS, 1.0, chosen).dq
    for method in (Method.FSP, Method.QP) if curvature else (Method.FSP, Method.QP, Method.GRADIENT):
        np.testing.assert_allclose(answers[method], answers[Method.PNS], atol=1e-6, err_msg=method.name)


@given(seeds, curvatures)
def test_the_opposite_task_without_wishes_is_the_opposite_motion(seed: int, curvature: float) -> None:
    q, twist, _, wanted = drawn(seed)
    state, still = ARM.state(q), replace(wanted, null_space_motion=False)
    there, back = (
        COORDINATOR.on_path(state, sign * twist, np.zeros(6), curvature, BOUNDS, 1.0, still).dq for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(there, -back, atol=1e-9)


@given(curvatures, st.floats(-0.05, 0.05), st.floats(-0.4, 0.4), st.floats(-0.6, 0.6))
def test_backwards_is_steered_as_the_mirror_image_of_forwards(
    curvature: float, aside: float, turn: float, v: float
) -> None:
    point = PathPoint(0.0, 0.0, 0.0, curvature)
    forwards = steered(Deviation(0.0, point, aside, turn), v)
    backwards = steered(Deviation(0.0, point, aside, -turn), -v)
    assert backwards == pytest.approx((-forwards.v, -forwards.omega), abs=1e-12)


def track(path: object, pose: PlatformPose, v: float, way: float) -> list[Deviation]:
    """Deviations of a platform that obeys at once, every 10 ms, over `way` metres."""
    follower, offs = PathFollower().following(RelativePath(path), PlatformPose(0.0, 0.0, 0.0)), []  # type: ignore[arg-type]
    for _ in range(round(way / (abs(v) * 0.01))):
        follower, off = follower.at(pose)
        offs.append(off)
        rate = steered(off, v * (1.0 - off.point.curvature * off.aside) / math.cos(off.turn))
        pose = PlatformPose(*integrate_unicycle(pose, rate.v, rate.omega, 0.01).tolist())
    return offs


@given(st.floats(0.5, 5.0), signs, signs, st.floats(-0.05, 0.05), st.floats(-0.3, 0.3), st.floats(0.1, 0.5))
def test_a_platform_beside_its_circle_comes_back_to_it_either_way_without_turning_round(
    radius: float, side: float, sign: float, aside: float, turn: float, speed: float
) -> None:
    offs = track(CirclePath(side * radius), PlatformPose(0.0, aside, turn), sign * speed, 3.0)
    assert abs(offs[-1].aside) < 2e-4
    assert abs(offs[-1].turn) < 2e-3
    assert max(abs(off.turn) for off in offs) < 1.0
    assert max(abs(off.aside) for off in offs) < abs(aside) + 0.5 * abs(turn) + 1e-3
    assert sign * offs[-1].s > 2.5


@given(
    st.sampled_from([LinePath(-1.0, 2.0), CirclePath(0.6, -1.0, 2.0), SplinePath([(0.7, 0.1), (1.5, 0.0)])]),
    st.floats(0.2, 1.2),  # far enough from either end to stop from 0.3 m/s
    st.floats(-0.3, 0.3),
    signs,
)
def test_it_stops_at_the_end_within_its_limits_and_stays(path: object, s: float, speed: float, sign: float) -> None:
    change = LIMITS.dv_max * PERIOD
    for _ in range(600):
        lower, upper = speed_bounds(path, s, speed, LIMITS, PERIOD)  # type: ignore[arg-type]
        assert lower <= upper
        before, speed = speed, min(max(2.0 * sign, lower), upper)
        assert abs(speed - before) <= change + 1e-12
        assert abs(speed) <= top_speed(path, LIMITS) + 1e-12  # type: ignore[arg-type]
        s += 0.5 * (speed + before) * PERIOD
        assert path.start - 2e-3 < s < path.end + 2e-3  # type: ignore[attr-defined]
    assert s == pytest.approx(path.end if sign > 0 else path.start, abs=1e-4)  # type: ignore[attr-defined]
    assert abs(speed) < 1e-4


@given(st.floats(-0.2, -0.005))
def test_past_an_end_it_comes_back(beyond: float) -> None:
    path = LinePath(-1.0, 1.0)
    lower, upper = speed_bounds(path, 1.0 - beyond, 0.0, LIMITS, PERIOD)
    assert lower <= upper < 0.0
    lower, upper = speed_bounds(path, -1.0 + beyond, 0.0, LIMITS, PERIOD)
    assert 0.0 < lower <= upper


@given(st.floats(0.2, 5.0))
def test_the_top_speed_of_a_circle_keeps_the_yaw_rate(radius: float) -> None:
    top = top_speed(CirclePath(radius), LIMITS)
    assert top <= LIMITS.v_max
    assert top / radius < LIMITS.omega_max
    assert top == pytest.approx(LIMITS.v_max) or top / radius > 0.8 * LIMITS.omega_max


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(0.0, 2.0))
def test_the_path_lies_where_the_platform_began_and_goes_along_with_the_reference_frame(
    x: float, y: float, heading: float, offset: float, s: float
) -> None:
    given_path = RelativePath(CirclePath(0.6), offset, 0.1, 0.2)
    start = PlatformPose(x, y, heading)
    follower = PathFollower().following(given_path, start)
    point = given_path.path.at(s)
    on_path = start
    for step in ((offset, 0.1, 0.2), point[:3]):
        cosine, sine = math.cos(on_path.heading), math.sin(on_path.heading)
        on_path = PlatformPose(
            on_path.x + cosine * step[0] - sine * step[1],
            on_path.y + sine * step[0] + cosine * step[1],
            on_path.heading + step[2],
        )
    T = np.eye(4)
    T[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    T[:2, 3] = 0.3, -0.7
    for placed, pose in ((follower, on_path), (follower.moved(T), in_reference(T, on_path))):
        _, off = replace(placed, s=s).at(pose)
        assert off.s == pytest.approx(s, abs=1e-9)
        assert (off.aside, off.turn, off.ahead) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert follower.following(given_path, PlatformPose(0.0, 0.0, 0.0)) is follower


def test_standing_still_it_does_not_turn() -> None:
    off = Deviation(0.0, PathPoint(0.0, 0.0, 0.0, 1.0), 0.05, 0.2)
    assert steered(off, 0.0) == PlatformRate(0.0, 0.0)
