"""The kernels behind restrictions in the null space, against the same formulas in dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.planner.resolvers.nullspace import _inverse, _overwrite, _row_lengths, particular, restrict

N, R = 8, 4
EPSILON = 1e-6
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, k: int) -> tuple[np.random.Generator, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """White rows (R, N) of a null space, B (N, N), an unconstrained q̇ (N,), rows (k, N)."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(N, N))
    weight = half @ half.T + np.eye(N)
    return rng, rng.normal(size=(R, N)), weight, rng.normal(size=N), rng.normal(size=(k, N))


@given(seeds, st.integers(1, 5))
def test_the_inverse_is_the_inverse_whatever_its_pivots(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    regular = rng.normal(size=(k, k)) + 0.1 * np.eye(k)
    shuffled = np.diag(rng.uniform(0.5, 2.0, k))[rng.permutation(k)]  # zeros on the diagonal
    for matrix in (shuffled, regular):
        if np.linalg.cond(matrix) < 1e6:
            np.testing.assert_allclose(_inverse(matrix) @ matrix, np.eye(k), atol=1e-8)


@pytest.mark.parametrize("small", range(3))
def test_the_particular_part_is_the_pseudo_inverse_and_says_where_it_was_propped(small: int) -> None:
    rng = np.random.default_rng(small)
    u, sigma, vt = np.linalg.svd(rng.normal(size=(3, 5)), full_matrices=False)
    xdot = rng.normal(size=3)
    dq, propped = particular(u, sigma, vt, xdot, EPSILON)
    np.testing.assert_allclose(dq, np.linalg.pinv(u * sigma @ vt) @ xdot, atol=1e-9)
    assert not propped
    sigma[small] = EPSILON
    assert not particular(u, sigma, vt, xdot, EPSILON)[1]
    sigma[small] = 0.5 * EPSILON
    assert particular(u, sigma, vt, xdot, EPSILON)[1]


@given(seeds, st.integers(1, 5))
def test_the_length_of_a_row_is_that_in_the_metric(seed: int, k: int) -> None:
    _, _, weight, _, rows = drawn(seed, k)
    rows[0] = 0.0
    expected = np.sqrt(np.einsum("in,nm,im->i", rows, np.linalg.inv(weight), rows))
    expected[0] = 1.0
    np.testing.assert_allclose(_row_lengths(rows, weight), expected, rtol=1e-9)


@given(seeds, st.integers(1, 4))
def test_overwriting_is_the_shortest_way(seed: int, k: int) -> None:
    rng, _, _, dq, rows = drawn(seed, k)
    target = rng.normal(size=k)
    found = dq.copy()
    _overwrite(found, rows, target)
    np.testing.assert_allclose(found, dq + np.linalg.pinv(rows) @ (target - rows @ dq), atol=1e-8)


@given(seeds)
def test_a_row_that_depends_on_others_is_left_out_of_overwriting(seed: int) -> None:
    rng, _, _, dq, rows = drawn(seed, 2)
    rows = np.vstack((rows, rows[0] + 2.0 * rows[1]))
    target = rng.normal(size=2)
    target = np.append(target, target[0] + 2.0 * target[1])
    found = dq.copy()
    _overwrite(found, rows, target)
    np.testing.assert_allclose(rows @ found, target, atol=1e-8)


@given(seeds, st.integers(1, R))
def test_rows_reach_what_the_formula_says_and_the_sign_of_eta_is_the_side_of_the_pull(seed: int, k: int) -> None:
    """(M (1 - s) + diag(s M_jj)) η = floor - rows·q̇_u, all rows by their lengths; q̇ = q̇_u + N G⁻¹ Cᵀ (1 - s) η."""
    rng, white, weight, dq, rows = drawn(seed, k)
    floor, softness = rng.normal(size=k), rng.choice([0.0, 0.0, 0.3, 1.0], size=k)
    lengths = _row_lengths(rows, weight)
    into = rows @ white.T / lengths[:, None]
    mobility = into @ into.T
    system = mobility * (1.0 - softness) + np.diag(softness * np.diag(mobility))
    if np.linalg.cond(mobility) > 1e4 or np.linalg.cond(system) > 1e4:
        return
    eta = np.linalg.solve(system, (floor - rows @ dq) / lengths)
    expected = dq + white.T @ into.T @ ((1.0 - softness) * eta)
    found, found_eta, damped = restrict(white, weight, dq, rows, floor, softness, EPSILON)
    assert not damped
    np.testing.assert_allclose(found_eta, eta, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)
    hard = softness == 0.0
    np.testing.assert_allclose((rows @ found)[hard], floor[hard], atol=1e-7)


@pytest.mark.parametrize("softness", [0.0, 0.5])
def test_a_row_that_the_null_space_cannot_move_is_met_by_overwriting(softness: float) -> None:
    _, white, _, dq, _ = drawn(5, 1)
    white[:, 0] = 0.0
    row = np.zeros((2, N))
    row[0, 0] = row[1, 3] = 1.0
    floor = np.array([0.25, -0.5])
    found, _, damped = restrict(white, np.eye(N), dq, row, floor, np.array([0.0, 0.0]), EPSILON)
    assert damped
    np.testing.assert_allclose(found[[0, 3]], floor, atol=1e-9)
    # Alone, the row that it can move is no cause for that.
    found, eta, damped = restrict(white, np.eye(N), dq, row[1:], floor[1:], np.array([softness]), EPSILON)
    assert not damped
    if softness == 0.0:
        assert found[3] == pytest.approx(-0.5, abs=1e-9)
    assert np.sign(eta[0]) == np.sign(floor[1] - dq[3])


def test_a_soft_row_stays_soft_where_another_one_is_overwritten() -> None:
    """Its target is what its own equation asks for, not its floor."""
    _, white, _, dq, _ = drawn(6, 1)
    white[:, 0] = 0.0
    rows = np.zeros((2, N))
    rows[0, 0], rows[1, 3] = 1.0, 3.0
    weight, floor, softness = 4.0 * np.eye(N), np.array([0.25, -0.5]), np.array([0.0, 0.5])
    found, eta, damped = restrict(white, weight, dq, rows, floor, softness, EPSILON)
    assert damped
    length = 1.5  # 3 / √4, in the metric
    mobility = 4.0 * white[:, 3] @ white[:, 3]  # (3 / length)²
    np.testing.assert_allclose(rows @ found, floor - [0.0, 0.5 * mobility * length * eta[1]], atol=1e-9)
    assert abs(eta[1]) > 0.01
