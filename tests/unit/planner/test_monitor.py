"""The singularity monitor against the paper's case, the paper's formulas and differences."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import null_space

from stack.kinematics import ArmModel
from stack.planner.jacobian_derivative import jacobian_derivative, manipulability_derivatives
from stack.planner.measures import AnyMeasure, Manipulability
from stack.planner.monitor import WHOLE_TASK, Kind, Limits, joint_limits, margins, monitor_arm
from stack.planner.monitor_kernels import projected_curvature
from stack.planner.singular_points import PlaneSearch, SingularPoint

PLANAR, MOMA = ArmModel.load("planar3"), ArmModel.load("moma8")
XY = np.arange(2)
LOWER, UPPER = np.radians(60.0), np.radians(265.0)
WIDTH = np.full(3, 0.2)
FREE = np.full(3, np.inf)
BOUNDED = (np.array([-np.inf, LOWER, -np.inf]), np.array([np.inf, UPPER, np.inf]))
PARK = json.loads((Path(__file__).parent / "park.json").read_text())["singularities"]
KINDS = {"KS": Kind.KINEMATIC, "AS": Kind.ALGORITHMIC, "SS": Kind.SEMI, "SAS": Kind.SEMI_ALGORITHMIC}
KINDS["AS_r0_degenerate"] = Kind.ALGORITHMIC
MEASURE = Manipulability(PLANAR, XY)


@pytest.fixture(scope="module")
def found() -> list[SingularPoint]:
    return PlaneSearch(MEASURE, (1, 2), np.zeros(3), {1: (LOWER, UPPER)}).all()


def planar_margins(theta2: float, theta3: float, *, limited: bool = True):
    q = np.array([0.7, theta2, theta3])
    lower, upper = BOUNDED if limited else (-FREE, FREE)
    return margins(MEASURE.at(q), joint_limits(q, lower, upper, WIDTH))


@pytest.mark.parametrize(("arm", "rows"), [(PLANAR, XY), (MOMA, WHOLE_TASK), (MOMA, np.arange(3))])
def test_derivatives_agree_with_differences(arm: ArmModel, rows: np.ndarray) -> None:
    q = arm.home + 0.1
    step = 1e-5 * np.eye(arm.n)
    _, _, _, _, _, gradient, hessian = manipulability_derivatives(arm.jacobian(q), rows)
    value = [manipulability_derivatives(arm.jacobian(q + e), rows) for e in (*step, *-step)]
    change = [(arm.jacobian(q + e) - arm.jacobian(q - e)) / 2e-5 for e in step]
    n = arm.n
    np.testing.assert_allclose(jacobian_derivative(arm.jacobian(q)), change, atol=1e-9)
    np.testing.assert_allclose(gradient, [(value[i][4] - value[n + i][4]) / 2e-5 for i in range(n)], atol=1e-8)
    np.testing.assert_allclose(hessian, [(value[i][5] - value[n + i][5]) / 2e-5 for i in range(n)], atol=1e-7)


def test_any_measure_by_differences_gives_the_same_margins() -> None:
    q = MOMA.home

    def measure(q: np.ndarray) -> float:
        j = MOMA.jacobian(q)
        return float(np.sqrt(np.linalg.det(j @ j.T)))

    analytic, differences = monitor_arm(MOMA, q), monitor_arm(MOMA, q, AnyMeasure(MOMA, WHOLE_TASK, measure))
    assert differences.algorithmic == pytest.approx(analytic.algorithmic, abs=1e-8)
    assert differences.kinematic == pytest.approx(analytic.kinematic, abs=1e-12)


def test_curvature_is_that_of_the_measure_along_the_self_motion() -> None:
    """H''(s) along the curve that keeps the TCP, walked in small steps and put back onto it."""
    q, h = np.array([0.3, 2.0, 1.0]), 1e-3
    target = PLANAR.pose(q)[:2, 3]
    z = null_space(PLANAR.jacobian(q)[:2])[:, 0]

    def walked(way: float) -> float:
        point = q + way * z
        for _ in range(20):
            j = PLANAR.jacobian(point)[:2]
            point = point - np.linalg.pinv(j) @ (PLANAR.pose(point)[:2, 3] - target)
        return MEASURE.at(point).value

    local = MEASURE.at(q)
    null, rows, _ = projected_curvature(
        local.jacobian, local.derivative, local.gradient, local.hessian, np.zeros((0, 3)), np.zeros((0, 3, 3))
    )
    differences = (walked(h) - 2.0 * walked(0.0) + walked(-h)) / h**2
    assert float(rows[0] @ null[0]) == pytest.approx(differences, rel=1e-4)


def test_multiplier_and_margins_are_those_of_the_papers_formulas() -> None:
    q = np.array([0.3, LOWER, 1.0])
    local = MEASURE.at(q)
    z = null_space(local.jacobian).T
    g = np.array([[0.0, -1.0, 0.0]])
    square = g @ z.T @ z @ g.T
    result = margins(local, joint_limits(q, *BOUNDED, WIDTH))
    assert result.multiplier == pytest.approx((np.linalg.inv(square) @ g @ z.T @ z @ local.gradient).item(), rel=1e-9)
    assert result.semi == pytest.approx(np.sqrt(square.item()), rel=1e-9)
    scale = local.value + np.linalg.norm(local.gradient)
    assert result.semi_algorithmic == pytest.approx(min(1.0, abs(result.multiplier) / scale), rel=1e-9)


@pytest.mark.parametrize("point", PARK, ids=lambda p: f"{p['kind']}_{p['theta2']:.0f}_{p['theta3']:.0f}")
def test_the_papers_points_have_their_names(point: dict) -> None:
    result = planar_margins(np.radians(point["theta2"]), np.radians(point["theta3"]), limited=point["inside_limit"])
    assert result.kind(1e-9) is KINDS[point["kind"]]
    assert result.measure == pytest.approx(point["H"], abs=1e-9)
    if "bound" in point:
        assert result.limit == {"lo": 1, "hi": 4}[point["bound"]]


@pytest.mark.parametrize("point", PARK, ids=lambda p: f"{p['kind']}_{p['theta2']:.0f}_{p['theta3']:.0f}")
def test_the_search_finds_the_papers_points(point: dict, found: list[SingularPoint]) -> None:
    wanted = np.radians([point["theta2"], point["theta3"]])
    off = [np.abs(np.remainder(p.q - wanted + np.pi, 2 * np.pi) - np.pi).max() for p in found]
    # Near the extra degenerate points AS lie close to each other, so the name is part of what is compared.
    same = [d for d, p in zip(off, found, strict=True) if p.kind is KINDS[point["kind"]]]
    assert min(same) < 1e-9


def test_what_the_search_finds_is_singular_to_rounding(found: list[SingularPoint]) -> None:
    """Sharper than the paper's points are given."""
    for point in found:
        limited = point.inside or not np.isnan(point.bound)
        assert planar_margins(*point.q, limited=limited).of(point.kind) < 1e-12


def test_the_search_finds_nothing_else(found: list[SingularPoint]) -> None:
    counts = {kind: sum(p.kind is kind and p.regular for p in found) for kind in Kind}
    assert counts == {
        Kind.NONE: 0, Kind.KINEMATIC: 3, Kind.SEMI: 4, Kind.ALGORITHMIC: 8, Kind.SEMI_ALGORITHMIC: 8,
    }  # fmt: skip
    assert sum(p.kind is Kind.ALGORITHMIC and p.regular and p.inside for p in found) == 6
    assert sum(not p.regular for p in found) == 3  # the stretched arm, and the TCP over its base twice


def test_a_margin_grows_with_the_distance_from_its_point() -> None:
    """All four, a thousandth and a hundredth of a radian away."""
    for point in PARK:
        if point["kind"] == "AS_r0_degenerate":
            continue
        kind = KINDS[point["kind"]]
        theta = np.radians([point["theta2"], point["theta3"]])
        away = np.array([0.0, 1.0]) if "bound" in point else np.array([0.6, 0.8])
        near, far = (planar_margins(*(theta + d * away), limited=point["inside_limit"]).of(kind) for d in (1e-3, 1e-2))
        assert 0.0 < near < 0.02
        assert near < far


def test_the_kinematic_margin_is_at_most_the_distance_to_the_manifold() -> None:
    for d in (1e-4, 1e-3):
        result = planar_margins(np.pi + d * 0.6, d * 0.8)
        assert 0.5 * d < result.kinematic <= d
        assert result.nearest is Kind.KINEMATIC


def test_more_active_limits_than_redundancy_are_a_semi_singularity() -> None:
    q = MOMA.home.copy()
    q[[1, 4, 6]] = MOMA.q_min[1], MOMA.q_max[4], MOMA.q_max[6]
    result = monitor_arm(MOMA, q)
    assert result.semi == 0.0
    assert result.kind(0.01) is Kind.SEMI


def test_a_limit_beyond_its_width_takes_no_part() -> None:
    q = MOMA.home.copy()
    assert monitor_arm(MOMA, q).semi == 1.0
    q[6] = MOMA.q_max[6] - 0.5 * MOMA.padding[6]
    assert 0.5 < monitor_arm(MOMA, q).semi < 1.0


def test_limits_that_do_not_fit_are_named() -> None:
    with pytest.raises(ValueError, match="limits of 1 values"):
        margins(MEASURE.at(PLANAR.home), Limits(np.zeros(1), np.zeros((1, 2)), np.ones(1)))
    with pytest.raises(ValueError, match="hessian"):
        margins(MEASURE.at(PLANAR.home), Limits(np.zeros(1), np.ones((1, 3)), np.ones(1), np.zeros((2, 3, 3))))


def test_a_curved_limit_bends_the_motion_that_it_leaves() -> None:
    """A limit g(q) of moma8 whose curvature changes C_AS: as many terms as the limit's multiplier times its Hessian."""
    local = Manipulability(MOMA, WHOLE_TASK).at(MOMA.home)
    normal = np.ones((1, 8)) / np.sqrt(8.0)
    bend = 0.3 * np.eye(8)[None]
    args = local.jacobian, local.derivative, local.gradient, local.hessian, normal
    null, flat, multipliers = projected_curvature(*args, np.zeros((1, 8, 8)))
    _, curved, _ = projected_curvature(*args, bend)
    np.testing.assert_allclose((flat - curved) @ null.T, multipliers[-1] * 0.3 * null @ null.T, atol=1e-12)
