"""The compiled SVD against its definition and LAPACK."""

import numpy as np
import pytest

from stack.planner.resolvers.decomposition import decompose, prop

SHAPES = [(1, 1), (1, 4), (3, 5), (6, 6), (6, 8), (6, 10)]


def matrices(m: int, n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(m * 100 + n)
    regular = rng.normal(size=(m, n))
    repeated = regular.copy()
    repeated[-1] = repeated[0]
    rank_one = np.outer(rng.normal(size=m), rng.normal(size=n))
    graded = regular * 10.0 ** rng.integers(-8, 4, size=(m, 1))
    holes = regular.copy()
    holes[:, rng.integers(n)] = 0.0
    holes[rng.integers(m)] = 0.0
    return [regular, repeated, rank_one, graded, holes, np.zeros((m, n)), np.eye(m, n)]


@pytest.mark.parametrize(("m", "n"), SHAPES)
def test_is_a_singular_value_decomposition(m: int, n: int) -> None:
    for matrix in matrices(m, n):
        before = matrix.copy()
        u, sigma, vt = decompose(matrix)
        size = max(1.0, float(np.abs(matrix).max()))
        np.testing.assert_array_equal(matrix, before)
        np.testing.assert_allclose((u * sigma) @ vt[:m], matrix, atol=2e-14 * size)
        np.testing.assert_allclose(u.T @ u, np.eye(m), atol=2e-14)
        np.testing.assert_allclose(vt @ vt.T, np.eye(n), atol=2e-14)
        np.testing.assert_allclose(sigma, np.linalg.svd(matrix, compute_uv=False), atol=2e-14 * size)


def test_small_singular_values_keep_their_relative_accuracy() -> None:
    rng = np.random.default_rng(3)
    left, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    wanted = np.array([1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10])
    _, sigma, _ = decompose(np.ascontiguousarray(wanted[:, None] * np.hstack([left, np.zeros((6, 2))])))
    np.testing.assert_allclose(sigma, wanted, rtol=1e-13)


def test_propping_is_continuous_with_its_derivative_and_never_below_half() -> None:
    epsilon, h = 0.05, 1e-7
    below, at, above = prop(epsilon - h, epsilon), prop(epsilon, epsilon), prop(epsilon + h, epsilon)
    assert at == epsilon
    assert (at - below) / h == pytest.approx((above - at) / h, abs=1e-5)
    assert min(prop(s, epsilon) for s in np.linspace(0.0, epsilon, 101)) == pytest.approx(epsilon / 2)
