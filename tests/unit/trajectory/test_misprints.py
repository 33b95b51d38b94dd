"""The closed forms of Beck et al. against exact Jacobians: what is misprinted is wrong, its correction is right (docs/misprints.md)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.planner.singular_sets import ZeroOf
from stack.planner.singularities import singular_sets

COMAU, IIWA, PANDA = (ArmModel.load(name) for name in ("comau_racer7", "iiwa14", "panda"))
DSE, DEW = 0.42, 0.4
"""iiwa 14: shoulder to elbow, elbow to wrist, m."""
EXACT = 1e-9


def singular_values(arm: ArmModel, q: np.ndarray) -> np.ndarray:
    return np.linalg.svd(arm.jacobian(q), compute_uv=False)


def inside(arm: ArmModel, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.q_min, arm.q_max, (count, arm.n))


def comau_form(q: np.ndarray, first_factor: float) -> float:
    """|det J| = ¼ |a2 s5 · (−2 (a3 s3 − d4 c3)) · (first factor − 2 (a3 c23 + d4 s23))|."""
    a2, a3, d4 = 0.59, 0.13, 0.684
    s, c, both = np.sin(q), np.cos(q), q[1] + q[2]
    reach = first_factor - 2.0 * (a3 * math.cos(both) + d4 * math.sin(both))
    return abs(a2 * s[4] * -2.0 * (a3 * s[2] - d4 * c[2]) * reach) / 4.0


@pytest.mark.parametrize(
    ("name", "factor", "right"),
    [
        ("-2(c2 a2 + a1)", lambda c2: -2.0 * (c2 * 0.59 + 0.15), True),
        ("-2(c2 a2 - a1)", lambda c2: -2.0 * (c2 * 0.59 - 0.15), False),
        ("-2 c2 (a2 + a1)", lambda c2: -2.0 * c2 * (0.59 + 0.15), False),
        ("-2 c2 a2", lambda c2: -2.0 * c2 * 0.59, False),
    ],
)
def test_33_holds_with_the_corrected_factor_and_with_no_neighbour_of_it(name: str, factor: object, right: bool) -> None:
    off = [
        abs(comau_form(q, factor(math.cos(q[1]))) - singular_values(COMAU, q).prod())  # type: ignore[operator]
        for q in inside(COMAU, 200, seed=33)
    ]
    assert max(off) < EXACT if right else np.median(off) > 1e-3, name


def iiwa_form(q: np.ndarray, sign: float) -> float:
    """m = d_se d_ew |s2 s4 s6| |n|, n the joint rates that turn the elbow about the line from shoulder to wrist.

    n₁ … n₃ add up to that line, e = d_se z₃ + d_ew z₅, so n₁² + n₂² + n₃² = |e|² − 2 n₁ n₃ cos q2, likewise 5 to 7 with q6;
    |e|² = d_se² ± d_ew² + 2 d_se d_ew cos q4 with `sign` for ±.
    """
    s, c = np.sin(q), np.cos(q)
    line = DSE**2 + sign * DEW**2 + 2.0 * DSE * DEW * c[3]
    n1, n7 = -DEW * s[3] * c[2] / s[1], -DSE * s[3] * c[4] / s[5]
    n3 = DSE + DEW * c[3] - n1 * c[1]
    n5 = DEW + DSE * c[3] - n7 * c[5]
    square = 2.0 * line - 2.0 * n1 * n3 * c[1] - 2.0 * n5 * n7 * c[5]
    return DSE * DEW * abs(s[1] * s[3] * s[5]) * math.sqrt(max(0.0, square))


def test_34_needs_plus_the_square_of_the_forearm() -> None:
    rows = inside(IIWA, 300, seed=34)
    exact = np.array([singular_values(IIWA, q).prod() for q in rows])
    plus, minus = (np.array([iiwa_form(q, sign) for q in rows]) for sign in (1.0, -1.0))
    np.testing.assert_allclose(plus, exact, rtol=0.0, atol=EXACT)
    assert np.abs(minus - exact).min() > EXACT
    assert np.median(np.abs(minus - exact) / exact) > 0.1


def test_34_is_the_distance_from_shoulder_to_wrist() -> None:
    """The same sign without any Jacobian: the wrist centre is 0.126 m behind the TCP, the shoulder at 0.36 m."""
    for q in inside(IIWA, 50, seed=1):
        pose = IIWA.pose(q)
        wrist = pose[:3, 3] - 0.126 * pose[:3, 2]
        square = float(((wrist - [0.0, 0.0, 0.36]) ** 2).sum())
        assert square == pytest.approx(DSE**2 + DEW**2 + 2.0 * DSE * DEW * math.cos(q[3]), abs=EXACT)


@pytest.mark.parametrize(
    "fixed",
    [
        {3: 0.0},
        {1: 0.0, 2: math.pi / 2},
        {1: 0.0, 2: -math.pi / 2},
        {1: 0.0, 5: 0.0},
        {4: math.pi / 2, 5: 0.0},
        {4: -math.pi / 2, 5: 0.0},
    ],
)
def test_35_is_right_as_printed_and_none_of_its_conditions_can_go(fixed: dict[int, float]) -> None:
    for q in inside(IIWA, 40, seed=35):
        q[list(fixed)] = list(fixed.values())
        assert singular_values(IIWA, q)[-1] < EXACT
    for free in fixed:
        kept, rest = {j: v for j, v in fixed.items() if j != free}, inside(IIWA, 40, seed=free)
        for q in rest:
            q[list(kept)] = list(kept.values())
        assert np.median([singular_values(IIWA, q)[-1] for q in rest]) > 0.01


def panda_shoulder(x: float, y: float, q: np.ndarray) -> tuple[float, float]:
    """(a, b) of the condition a sin q6 + b = 0 that makes q2 = 0 singular, over cos² q4, in x = tan q4, y = 1 / cos q4.

    e^(i q4) = cos q4 (1 + i x), so a wave of order 2 in q4 becomes (1 ± i x)², one of order 1 y (1 ± i x), one of order 0 1 + x².
    """
    ((_, condition),) = singular_sets(PANDA)["shoulder"].branches
    assert isinstance(condition, ZeroOf)
    a, b = 0.0, 0.0
    for k, wave in condition.polynomial.terms.items():
        turn = 1.0 + 1j * np.sign(k[3]) * x
        over = {2: turn**2, 1: turn * y, 0: 1.0 + x * x}[abs(k[3])]
        value = wave * over * np.exp(1j * (k[2] * q[2] + k[4] * q[4]))
        if k[5] == 0:
            b += value.real
        else:
            a += (value * 1j * k[5]).real
    return a, b


@pytest.mark.parametrize("folded", [False, True])
def test_37b_y_is_one_over_the_cosine_not_a_root(folded: bool) -> None:
    """They differ where cos q4 < 0, half of the Panda's range: there the root's q6 is not singular at all."""
    found: list[float] = []
    wrong: list[float] = []
    for q in inside(PANDA, 3000, seed=37):
        x = math.tan(q[3])
        if (math.cos(q[3]) < 0.0) != folded or abs(math.cos(q[3])) < 0.1:
            continue
        q[1] = 0.0
        for y, into in ((1.0 / math.cos(q[3]), found), (math.sqrt(x * x + 1.0), wrong)):
            a, b = panda_shoulder(x, y, q)
            if abs(b) < 0.99 * abs(a):
                q[5] = math.asin(-b / a)
                into.append(singular_values(PANDA, q)[-1])
    assert len(found) > 50
    assert len(wrong) > 50
    assert max(found) < EXACT
    if folded:
        assert np.median(wrong) > 1e-3
    else:
        assert max(wrong) < EXACT


def test_36c_is_right() -> None:
    """Shoulder, elbow and wrist in line, at −26.757° with q5 = 0: singular for every value of the others."""
    stretched = math.atan2(0.316, 0.0825) - math.atan2(0.384, -0.0825)
    assert math.degrees(stretched) == pytest.approx(-26.757, abs=5e-4)
    for q in inside(PANDA, 40, seed=36):
        q[[3, 4]] = stretched, 0.0
        assert singular_values(PANDA, q)[-1] < EXACT


@pytest.mark.parametrize("side", [math.pi / 2, -math.pi / 2])
def test_36_at_a_turned_wrist_needs_only_the_tangent(side: float) -> None:
    """q5 = ±π/2: sin q6 ((d3 d5 − a5²) x − a5 (d3 + d5)) + a7 (d3 x − a5) = 0 with x = tan q4 (37a), on both sides of q4 = −π/2."""
    d3, d5, a5, a7 = 0.316, 0.384, -0.0825, 0.088
    folded = {True: 0, False: 0}
    for q in inside(PANDA, 300, seed=38):
        x = math.tan(q[3])
        sine = -a7 * (d3 * x - a5) / ((d3 * d5 - a5**2) * x - a5 * (d3 + d5))
        if abs(sine) < 0.99:
            q[[4, 5]] = side, math.asin(sine)
            assert singular_values(PANDA, q)[-1] < EXACT
            folded[math.cos(q[3]) < 0.0] += 1
            q[5] += 0.3
            assert singular_values(PANDA, q)[-1] > 1e-4
    assert min(folded.values()) > 20
