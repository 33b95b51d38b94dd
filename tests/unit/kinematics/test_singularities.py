"""The singular manifolds: complete, exact, and with margins that are distances."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from stack.kinematics import ArmModel
from stack.planner.singularities import manifold_margins, manifolds
from tests.unit.kinematics.conftest import VECTORS

NAMES = {
    "moma8": {"L1", "L2", "L3", "L4", "F1", "F2", "F3p", "F3m"},
    "kr15": {"wrist", "elbow", "shoulder"},
    "comau_racer7": {"wrist", "elbow", "shoulder"},
    "iiwa14": {"elbow", "shoulder", "shoulder_and_wrist", "wrist"},
    "panda": {"shoulder", "elbow", "wrist", "in_line"},
    "planar3": {"aligned"},
}
SINGULAR = [(name, i, case) for name, cases in VECTORS["singular"].items() for i, case in enumerate(cases)]


def task_jacobian(arm: ArmModel, q: np.ndarray) -> np.ndarray:
    return arm.jacobian(q)[: 2 if arm.name == "planar3" else 6]


def smallest_singular_value(arm: ArmModel, q: np.ndarray) -> float:
    return float(np.linalg.svd(task_jacobian(arm, q), compute_uv=False)[-1])


@pytest.mark.parametrize(("name", "index", "case"), SINGULAR, ids=[f"{name}-{i}" for name, i, _ in SINGULAR])
def test_known_singular_configurations_have_margin_zero(moma8: ArmModel, name: str, index: int, case: dict) -> None:
    """L and F by their own names; the thesis's A1–A6 lie inside the F manifolds."""
    margins = manifolds(moma8, case["q"])
    assert min(margins.values()) < 1e-12
    assert margins.get(name, 0.0) < 1e-12
    if name.startswith("A"):
        assert min(margins, key=margins.__getitem__).startswith("F")


@pytest.mark.parametrize("case", VECTORS["manifold_O"], ids=range(len(VECTORS["manifold_O"])))
def test_near_misses_are_not_called_singular(moma8: ArmModel, case: dict) -> None:
    """Straight wrists with a small singular value left: no margin may claim more than the Jacobian shows."""
    q = np.array([0.3, 0.8, case["SH"], case["UA"], case["EL"], case["LA"], 0.0, 0.2])
    assert smallest_singular_value(moma8, q) == pytest.approx(case["smin"], abs=1e-9)
    assert min(manifolds(moma8, q).values()) > 0.03


def test_names(any_arm: ArmModel) -> None:
    assert set(manifolds(any_arm, any_arm.home)) == NAMES[any_arm.name]
    assert min(manifolds(any_arm, any_arm.home).values()) > 0.1


def singular_configurations(arm: ArmModel, count: int, seed: int) -> list[np.ndarray]:
    """Roots of Jᵀu = 0, |u| = 1 from random starts, with no knowledge of any manifold."""
    rng, n, found = np.random.default_rng(seed), arm.n, []
    while len(found) < count:
        start = rng.uniform(-np.pi, np.pi, n)
        u = np.linalg.svd(task_jacobian(arm, start))[0][:, -1]
        root = least_squares(
            lambda x: np.append(task_jacobian(arm, x[:n]).T @ x[n:], x[n:] @ x[n:] - 1),
            np.append(start, u),
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=100,
        )
        if root.cost < 1e-24:
            found.append(root.x[:n])
    return found


def test_whatever_is_singular_is_on_a_manifold(any_arm: ArmModel) -> None:
    for q in singular_configurations(any_arm, 25, seed=1):
        assert min(manifolds(any_arm, q).values()) < 1e-5, q


def projected(arm: ArmModel, name: str, q: np.ndarray) -> np.ndarray | None:
    """Onto one manifold by steps of the margin's own length along its gradient."""
    for _ in range(200):
        margin = manifold_margins(arm, q)[name]
        if margin.distance < 1e-10:
            return q
        q = q - margin.distance * margin.gradient / (margin.gradient @ margin.gradient)
    return None


def test_whatever_is_on_a_manifold_is_singular(any_arm: ArmModel) -> None:
    rng = np.random.default_rng(2)
    for name in sorted(NAMES[any_arm.name]):
        landed = [projected(any_arm, name, rng.uniform(-np.pi, np.pi, any_arm.n)) for _ in range(16)]
        on_it = [q for q in landed if q is not None]
        # The Panda's in_line has two angles of q4; at one of them the rest of the condition cannot hold.
        assert len(on_it) >= (4 if name == "in_line" else 16), name
        for q in on_it:
            assert smallest_singular_value(any_arm, q) < 1e-8, name


def test_gradients_are_derivatives(any_arm: ArmModel) -> None:
    rng, step = np.random.default_rng(3), 1e-6
    for q in rng.uniform(-np.pi, np.pi, (10, any_arm.n)):
        plus = [manifolds(any_arm, q + h) for h in step * np.eye(any_arm.n)]
        minus = [manifolds(any_arm, q - h) for h in step * np.eye(any_arm.n)]
        for name, margin in manifold_margins(any_arm, q).items():
            numeric = [(a[name] - b[name]) / (2 * step) for a, b in zip(plus, minus, strict=True)]
            np.testing.assert_allclose(margin.gradient, numeric, rtol=0, atol=1e-6)
            assert margin.distance == manifolds(any_arm, q)[name]


def test_margins_never_overstate_the_distance(any_arm: ArmModel) -> None:
    """From points of a manifold, walk away by a known length: the margin is no more than that."""
    rng = np.random.default_rng(4)
    for name in sorted(NAMES[any_arm.name]):
        q = next(
            p
            for p in (projected(any_arm, name, rng.uniform(-np.pi, np.pi, any_arm.n)) for _ in range(50))
            if p is not None
        )
        for length in (1e-3, 0.1, 1.0, 3.0):
            for _ in range(10):
                away = rng.normal(size=any_arm.n)
                away *= length / np.linalg.norm(away)
                assert manifolds(any_arm, q + away)[name] <= length + 1e-9


def test_margin_is_the_angle_where_angles_define_the_manifold(moma8: ArmModel) -> None:
    """A wrist at L2 that is moved by 3 and 4 hundredths of a radian in two of its three joints is 0.05 rad away."""
    q = np.array([0.4, 0.8, np.pi + 0.03, -0.04, np.pi, 1.0, 1.0, 0.3])
    assert manifolds(moma8, q)["L2"] == pytest.approx(0.05, abs=1e-12)
    gradient = manifold_margins(moma8, q)["L2"].gradient
    np.testing.assert_allclose(gradient, [0, 0, 0.6, -0.8, 0, 0, 0, 0], atol=1e-9)


def test_margin_is_the_distance_to_first_order_where_a_formula_does() -> None:
    """Beside the Racer's shoulder singularity, one unit of the margin is one radian straight away from it."""
    arm = ArmModel.load("comau_racer7")
    q = projected(arm, "shoulder", np.array([0.0, 1.0, 1.0, 0.0, 1.0, 0.0]))
    away = manifold_margins(arm, q + [0, 0.05, 0.0, 0, 0, 0])["shoulder"].gradient
    away = away / np.linalg.norm(away)
    assert manifolds(arm, q + 1e-3 * away)["shoulder"] == pytest.approx(1e-3, rel=0.05)


def test_gradient_on_the_manifold_is_zero_and_not_nan(moma8: ArmModel) -> None:
    margin = manifold_margins(moma8, VECTORS["singular"]["L1"][0]["q"])["L1"]
    assert margin.distance == 0.0
    np.testing.assert_array_equal(margin.gradient, np.zeros(8))


def test_the_racers_formula_for_its_manipulability() -> None:
    """m = |a2 s5 (a3 s3 − d4 c3)(a1 + a2 c2 + a3 c23 + d4 s23)|: its factors are the three manifolds."""
    arm = ArmModel.load("comau_racer7")
    a1, a2, a3, d4 = 0.15, 0.59, 0.13, 0.684
    for q in np.random.default_rng(5).uniform(arm.q_min, arm.q_max, (50, 6)):
        s, c = np.sin(q), np.cos(q)
        radius = a1 + a2 * c[1] + a3 * np.cos(q[1] + q[2]) + d4 * np.sin(q[1] + q[2])
        formula = abs(a2 * s[4] * (a3 * s[2] - d4 * c[2]) * radius)
        assert np.prod(np.linalg.svd(arm.jacobian(q), compute_uv=False)) == pytest.approx(formula, abs=1e-12)


def test_the_pandas_stretched_elbow_is_at_the_papers_angle() -> None:
    """(36c): q4 = −26.757° is where shoulder, elbow and wrist centre are in line."""
    arm = ArmModel.load("panda")
    q = projected(arm, "elbow", arm.home)
    assert np.degrees(q[3]) == pytest.approx(-26.757, abs=1e-3)


def test_bad_input_is_named(moma8: ArmModel) -> None:
    with pytest.raises(ValueError, match=r"q has shape \(7,\), expected \(8,\)"):
        manifolds(moma8, np.zeros(7))
    with pytest.raises(ValueError, match="not finite at index 2"):
        manifold_margins(moma8, [0, 0, np.nan, 0, 0, 0, 0, 0])
