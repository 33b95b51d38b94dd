"""Every path is a curve by arc length, whatever it is made of."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from stack.planner.platform_path import CirclePath, LinePath, PlatformPath, SplinePath

H = 1e-5
shares = st.floats(0.0, 1.0)
radii = st.floats(0.15, 20.0).flatmap(lambda r: st.sampled_from([r, -r]))
circles = st.builds(CirclePath, radii, start=st.floats(-30.0, -0.1), end=st.floats(0.1, 30.0))
lines = st.builds(LinePath, start=st.floats(-30.0, -0.1), end=st.floats(0.1, 30.0))


@st.composite
def splines(draw: st.DrawFn) -> SplinePath:
    """Through up to six waypoints, each ahead of the one before."""
    steps = draw(st.lists(st.tuples(st.floats(0.3, 1.0), st.floats(-0.3, 0.3)), min_size=1, max_size=6))
    try:
        return SplinePath(np.cumsum(np.array(steps), axis=0).tolist())
    except ValueError:
        assume(False)
        raise


paths = st.one_of(lines, circles, splines())


def place(path: PlatformPath, share: float) -> float:
    """An s inside, away from the ends by more than a finite difference needs."""
    return path.start + 2 * H + share * (path.end - path.start - 4 * H)


@given(paths)
def test_it_begins_at_the_origin_along_x(path: PlatformPath) -> None:
    x, y, heading, _ = path.at(0.0)
    assert (x, y, heading) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@given(paths, shares)
def test_the_tangent_is_a_unit_vector_along_the_heading(path: PlatformPath, share: float) -> None:
    s = place(path, share)
    before, here, after = path.at(s - H), path.at(s), path.at(s + H)
    dx, dy = (after.x - before.x) / (2 * H), (after.y - before.y) / (2 * H)
    assert math.hypot(dx, dy) == pytest.approx(1.0, abs=2e-5)
    assert math.remainder(math.atan2(dy, dx) - here.heading, 2 * math.pi) == pytest.approx(0.0, abs=2e-4)


@given(paths, shares)
def test_curvature_is_the_rate_of_the_heading(path: PlatformPath, share: float) -> None:
    s = place(path, share)
    rate = (path.at(s + H).heading - path.at(s - H).heading) / (2 * H)
    assert rate == pytest.approx(path.at(s).curvature, abs=1e-5 + 2 * H * path.steepest)


@given(paths, shares)
def test_no_bend_is_sharper_or_changes_faster_than_the_path_says(path: PlatformPath, share: float) -> None:
    s = place(path, share)
    slope = (path.at(s + H).curvature - path.at(s - H).curvature) / (2 * H)
    assert abs(path.at(s).curvature) <= path.sharpest * 1.01 + 1e-9
    assert abs(slope) <= path.steepest * 1.05 + 1e-6


@given(paths, shares, st.floats(-0.3, 0.3), st.floats(-0.1, 0.1))
def test_the_closest_point_of_a_point_beside_the_path_is_its_foot(
    path: PlatformPath, share: float, aside: float, astray: float
) -> None:
    s = place(path, share)
    point = path.at(s)
    aside = aside / max(path.sharpest, 0.3)
    x = point.x - aside * math.sin(point.heading)
    y = point.y + aside * math.cos(point.heading)
    near = s + astray * min(1.0, 1.0 / max(path.sharpest, 1e-9))
    assert path.closest(x, y, near) == pytest.approx(s, abs=1e-6)


@given(paths, st.floats(0.0, 5.0))
def test_nothing_lies_beyond_the_ends(path: PlatformPath, beyond: float) -> None:
    assert path.at(path.end + beyond) == path.at(path.end)
    assert path.at(path.start - beyond) == path.at(path.start)
    end = path.at(path.end)
    ahead = 0.5 * min(beyond, 1.0) / max(path.sharpest, 1.0)
    x, y = end.x + ahead * math.cos(end.heading), end.y + ahead * math.sin(end.heading)
    if path.end < 6.0:  # the end of a long circle lies where the circle has been before
        assert path.closest(x, y, path.end) == pytest.approx(path.end)


@given(radii, st.floats(-40.0, 40.0))
def test_a_circle_counts_its_turns(radius: float, s: float) -> None:
    circle = CirclePath(radius)
    point = circle.at(s)
    assert math.hypot(point.x, point.y - radius) == pytest.approx(abs(radius), rel=1e-9)
    assert point.heading == pytest.approx(s / radius)
    assert circle.closest(point.x, point.y, s + 0.4 * abs(radius)) == pytest.approx(s, abs=1e-6)


@given(splines(), shares)
def test_a_spline_is_as_long_as_it_says(path: SplinePath, share: float) -> None:
    s = share * path.end
    points = np.array([path.at(x)[:2] for x in np.linspace(0.0, s, 400)])
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    assert length == pytest.approx(s, rel=1e-4, abs=1e-9)


@pytest.mark.slow
@given(st.lists(st.tuples(st.floats(0.3, 1.0), st.floats(-0.3, 0.3)), min_size=1, max_size=6))
def test_a_spline_meets_its_waypoints_in_their_order(steps: list[tuple[float, float]]) -> None:
    waypoints = np.cumsum(np.array(steps), axis=0)
    try:
        path = SplinePath(waypoints.tolist())
    except ValueError:
        assume(False)
    fine = np.linspace(0.0, path.end, 3000)
    points = np.array([path.at(s)[:2] for s in fine])
    met = [int(np.argmin(np.hypot(*(points - waypoint).T))) for waypoint in waypoints]
    assert met == sorted(met)
    for index, waypoint in zip(met, waypoints, strict=True):
        assert np.hypot(*(points[index] - waypoint)) <= path.end / 2999


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: CirclePath(0.05), "radius 0.05 m"),
        (lambda: CirclePath(math.nan), "radius nan m"),
        (lambda: LinePath(0.5, 1.0), "from 0.5 to 1.0"),
        (lambda: LinePath(0.0, 0.0), "have a length"),
        (lambda: SplinePath([]), "at least one waypoint"),
        (lambda: SplinePath([(1.0, 0.0), (1.0, 0.0)]), "waypoint 2 is 0 m from"),
        (lambda: SplinePath([(math.inf, 0.0)]), "must be finite"),
        (lambda: SplinePath([(0.5, 0.0), (0.0, 0.01)]), "bends|cusp"),
    ],
)
def test_what_is_no_path_is_refused_by_name(make: object, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make()  # type: ignore[operator]
