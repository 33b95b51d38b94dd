"""Path and null-space scale: exact against brute force, unique, without jumps."""

import numpy as np
import pytest

from stack.planner.resolvers.path_scale import NULL_COST, into_bounds, path_and_null_scale


def cost(s: float, tau: float) -> float:
    return (1 - s) ** 2 + NULL_COST * (1 - tau) ** 2


def test_nothing_is_given_up_inside_the_bounds() -> None:
    bound = np.ones(3)
    assert path_and_null_scale(np.zeros(3), 0.5 * bound, 0.4 * bound, -bound, bound) == (1.0, 1.0, -1, 0.0)


def test_null_motion_goes_before_the_path_slows_down() -> None:
    s, tau, which, missed = path_and_null_scale(
        np.zeros(2), np.array([0.9, 0.0]), np.array([0.5, 0.1]), -np.ones(2), np.ones(2)
    )
    assert missed == 0.0
    assert which == 1  # the upper bound of joint 0
    assert s == pytest.approx(1.0, abs=0.02)
    assert tau < 0.3
    assert 0.9 * s + 0.5 * tau == pytest.approx(1.0, abs=1e-12)


def test_is_the_optimum_of_a_fine_grid() -> None:
    rng = np.random.default_rng(5)
    grid = np.linspace(0, 1, 201)
    s, tau = np.meshgrid(grid, grid, indexing="ij")
    for _ in range(200):
        fixed, path, null = rng.normal(size=(3, 5)) * np.array([[0.2], [1.0], [0.7]])
        lower, upper = -rng.uniform(0.1, 1.0, 5), rng.uniform(0.1, 1.0, 5)
        got_s, got_tau, _, missed = path_and_null_scale(fixed, path, null, lower, upper)
        motion = fixed + s[..., None] * path + tau[..., None] * null
        inside = ((motion >= lower) & (motion <= upper)).all(axis=2)
        if missed > 0.0:
            assert not inside.any()
            continue
        dq = fixed + got_s * path + got_tau * null
        assert (dq >= lower - 1e-9).all()
        assert (dq <= upper + 1e-9).all()
        if inside.any():
            assert cost(got_s, got_tau) <= cost(s[inside], tau[inside]).min() + 1e-9  # type: ignore[arg-type]


def test_shortfall_is_by_how_much_the_fixed_motion_is_outside() -> None:
    *_, missed = path_and_null_scale(np.array([1.5]), np.array([0.1]), np.zeros(1), -np.ones(1), np.ones(1))
    assert missed == pytest.approx(0.5)


def test_into_bounds_slows_all_joints_alike_for_speed_and_changes_them_in_step_for_acceleration() -> None:
    np.testing.assert_allclose(into_bounds(np.array([2.0, 1.0]), -np.ones(2), np.ones(2)), [1.0, 0.5])
    last = np.array([1.0, -0.5])
    np.testing.assert_allclose(into_bounds(np.zeros(2), last - 0.1, last + 0.1), [0.9, -0.45])
    np.testing.assert_array_equal(into_bounds(np.array([3.0]), np.array([-np.inf]), np.array([np.inf])), [3.0])
