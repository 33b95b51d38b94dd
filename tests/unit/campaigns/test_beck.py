"""Pairs, measures and tables of the trajectory campaign, without the solver."""

import itertools
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canipulator.campaigns.beck_pairs import LEAST_MANIPULABILITY, draw_pair, manipulability, measure
from canipulator.campaigns.beck_tables import OBJECTIVES, PAPER, summarise_pairs
from stack.kinematics import ArmModel

ARMS = {name: ArmModel.load(name) for name in PAPER}


@given(st.sampled_from(list(ARMS)), st.integers(0, 100_000), st.integers(0, 5))
def test_a_pair_is_inside_the_limits_and_away_from_singularities(name: str, index: int, seed: int) -> None:
    arm = ARMS[name]
    pair = draw_pair(arm, seed, index)
    for q in (pair.start, pair.target):
        assert np.all(q >= arm.q_min)
        assert np.all(q <= arm.q_max)
        assert abs(np.linalg.det(arm.jacobian(q) @ arm.jacobian(q).T)) >= 0.99 * LEAST_MANIPULABILITY**2
    again = draw_pair(arm, seed, index)
    assert np.array_equal(again.start, pair.start)
    assert np.array_equal(again.target, pair.target)


def test_pairs_fill_the_joint_ranges_evenly() -> None:
    """The Comau's sixth joint changes no manipulability, so nothing is drawn again for its sake."""
    arm = ARMS["comau_racer7"]
    last = np.array([draw_pair(arm, 3, i).start[5] for i in range(400)])
    share = np.sort((last - arm.q_min[5]) / (arm.q_max[5] - arm.q_min[5]))
    assert np.abs(share - np.linspace(0.0, 1.0, 400)).max() < 0.0815  # Kolmogorov, one in a hundred


@pytest.mark.parametrize(
    ("q", "expected"), [((0.3, 0.5, 0.2, 0.7, 0.9, 0.1), None), ((0.1, 0.4, 0.3, 0.2, 0.0, 0.6), 0.0)]
)
def test_the_comaus_manipulability_is_the_papers_closed_form(q: tuple[float, ...], expected: float | None) -> None:
    """m = |a2 s5 (a3 s3 - d4 c3)(a1 + a2 c2 + a3 c23 + d4 s23)|, (33) with its misprint put right."""
    a1, a2, a3, d4 = 0.15, 0.59, 0.13, 0.684
    _, q2, q3, _, q5, _ = q
    s3, c3, c23, s23 = math.sin(q3), math.cos(q3), math.cos(q2 + q3), math.sin(q2 + q3)
    formula = abs(a2 * math.sin(q5) * (a3 * s3 - d4 * c3) * (a1 + a2 * math.cos(q2) + a3 * c23 + d4 * s23))
    assert manipulability(ARMS["comau_racer7"], [q])[0] == pytest.approx(formula, rel=1e-9, abs=1e-15)
    if expected is not None:
        assert formula == expected


@given(st.floats(-2.9, 2.9), st.floats(-2.9, 2.9), st.integers(2, 40))
def test_turning_the_first_joint_draws_an_arc(start: float, end: float, n: int) -> None:
    """The chords of an arc about the vertical axis, and its whole angle."""
    arm = ARMS["iiwa14"]
    q = np.tile([0.0, 0.7, 0.2, -1.0, 0.3, 0.8, 0.1], (n, 1))
    q[:, 0] = np.linspace(start, end, n)
    radius = float(np.hypot(*arm.pose(q[0])[:2, 3]))
    step = abs(end - start) / (n - 1)
    measured = measure(arm, q)
    if step < math.pi:  # beyond, the other way round is shorter
        assert measured.rotation_rad == pytest.approx(abs(end - start), abs=1e-6)
    assert measured.path_m == pytest.approx((n - 1) * 2 * radius * math.sin(step / 2), abs=1e-9)
    assert measured.m_min == pytest.approx(measured.m_max)


M_AVG = (0.04, 0.11, 0.05)


def results(
    m_min: dict[str, float], unsolved: tuple[int, str] | None = None, m_avg: tuple[float, ...] = M_AVG
) -> pa.Table:
    """Four pairs of one robot; times and mean manipulability as the paper claims."""
    rows = []
    for index, objective in itertools.product(range(4), OBJECTIVES):
        rank = OBJECTIVES.index(objective)
        rows.append(
            {
                "group": "panda",
                "index": index,
                "error": None,
                "objective": objective,
                "solved": (index, objective) != unsolved,
                "status": "OK",
                "iterations": 10.0,
                "t_f": 2.0 + index + rank,
                "computing_s": (0.010, 0.030, 0.020)[rank],
                "end_points_m_min": 2e-4,
                "m_min": m_min[objective] * (1 + index),
                "m_max": 0.13,
                "m_avg": m_avg[rank],
                "path_m": 1.0,
                "rotation_rad": 3.0,
            }
        )
    return pa.Table.from_pylist(rows)


def test_the_tables_stand_beside_the_papers_and_say_what_holds(tmp_path: Path) -> None:
    summary = summarise_pairs(results({"none": 1e-7, "manipulability": 1e-5, "potentials": 1e-4}), tmp_path, "weights")
    text = (tmp_path / "summary.md").read_text()
    assert summary.holds
    assert "| t_F (s) | 3.5 ± 1.1 | 2.44 ± 0.29 | 4.5 ± 1.1 | 11.3 ± 2.29 | 5.5 ± 1.1 | 4.96 ± 3.11 |" in text
    assert "| m_min, of all nodes | 1.0e-07 | 6.5e-06 | 1.0e-05 | 6.8e-05 | 1.0e-04 | 3.1e-04 |" in text
    assert "weights" in text
    assert (tmp_path / "panda.png").stat().st_size > 10_000


def test_an_ordering_that_does_not_hold_is_not_hidden(tmp_path: Path) -> None:
    m_min = {"none": 1e-7, "manipulability": 1e-5, "potentials": 1e-4}
    summary = summarise_pairs(results(m_min, m_avg=(0.04, 0.05, 0.11)), tmp_path, "")
    assert summary.holds is False
    assert "0.040 < 0.110 < 0.050 | NO | yes |" in (tmp_path / "summary.md").read_text()


def test_the_least_of_all_nodes_is_reported_but_decides_nothing(tmp_path: Path) -> None:
    """The end points have 2e-4: a pair whose m_min is that got it from the draw."""
    summary = summarise_pairs(results({"none": 1e-7, "manipulability": 1e-4, "potentials": 5e-5}), tmp_path, "")
    text = (tmp_path / "summary.md").read_text()
    assert summary.holds
    assert "1.00e-07 < 1.00e-04 < 5.00e-05 | NO | no: reported |" in text
    assert "| m_min is an end point's (% of the pairs) | 0.0 | – | 75.0 | – | 25.0 | – |" in text


def test_only_pairs_that_all_objectives_solve_are_compared(tmp_path: Path) -> None:
    m_min = {"none": 1e-7, "manipulability": 1e-5, "potentials": 1e-4}
    summarise_pairs(results(m_min, unsolved=(3, "potentials")), tmp_path, "")
    text = (tmp_path / "summary.md").read_text()
    assert "panda: 3 pairs" in text
    assert "| t_F (s) | 3 ± 0.82 |" in text
    assert "| solved | 4 of 4 | – | 4 of 4 | – | 3 of 4 | – |" in text


def test_pairs_that_failed_altogether_leave_no_table(tmp_path: Path) -> None:
    failed = pa.Table.from_pylist([{"group": "panda", "index": 0, "error": "ValueError: q_start"}])
    assert summarise_pairs(failed, tmp_path, "").holds is None


def test_a_pair_that_failed_is_left_out_of_the_table(tmp_path: Path) -> None:
    good = results({"none": 1e-7, "manipulability": 1e-5, "potentials": 1e-4})
    failed = pa.Table.from_pylist([{"group": "panda", "index": 4, "error": "ValueError: q_start"}])
    summary = summarise_pairs(pa.concat_tables([good, failed], promote_options="permissive"), tmp_path, "")
    assert summary.holds
    assert "panda: 4 pairs" in (tmp_path / "summary.md").read_text()
