"""Velocity bounds: they hold, the robot slows down on the path, and the quadratic program finds the best there is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linprog, minimize

from stack.planner.problem import Active, Problem, Status
from stack.planner.resolvers import RESOLVERS

METHODS = list(RESOLVERS)
numbers = st.floats(-2.0, 2.0, allow_subnormal=False).map(lambda x: round(x, 3))


@st.composite
def bounded_problems(draw: st.DrawFn, standstill: bool = True) -> Problem:
    m = draw(st.integers(1, 4))
    n = m + draw(st.integers(1, 3))
    k = draw(st.integers(0, n - m)) if not standstill else 0
    low = st.floats(-1.5, -0.1) if standstill else st.floats(-1.0, 0.5)
    width = st.floats(0.2, 2.0) if standstill else st.floats(-0.2, 2.0)
    lower = draw(arrays(np.float64, n, elements=low))
    upper = np.maximum(lower + draw(arrays(np.float64, n, elements=width)), 0.05 if standstill else -np.inf)
    return Problem(
        draw(arrays(np.float64, (m, n), elements=numbers)),
        draw(arrays(np.float64, m, elements=numbers)),
        B=draw(arrays(np.float64, n, elements=st.floats(0.1, 10.0))),
        z=draw(arrays(np.float64, n, elements=numbers)),
        A=draw(arrays(np.float64, (k, n), elements=numbers)),
        b=draw(arrays(np.float64, k, elements=numbers)),
        lower=lower,
        upper=upper,
    )


@pytest.mark.parametrize("method", METHODS)
@given(problem=bounded_problems())
def test_bounds_around_standstill_slow_the_robot_down_on_its_path(method: str, problem: Problem) -> None:
    p = problem
    solution = RESOLVERS[method](p)
    assert (solution.dq >= p.lower).all()
    assert (solution.dq <= p.upper).all()
    assert 0.0 <= solution.scale <= 1.0
    if solution.sigma[-1] >= p.epsilon:
        assert solution.status <= Status.CONSTRAINED
        assert np.abs(p.J @ solution.dq - solution.scale * p.xdot).max() <= 1e-9
    if solution.scale < 1.0:
        assert solution.active
        assert f"path slowed to {solution.scale:.4g}" in solution.message


@pytest.mark.parametrize("method", METHODS)
@given(problem=bounded_problems(standstill=False))
def test_any_bounds_at_all_give_a_finite_answer_inside_them(method: str, problem: Problem) -> None:
    p = problem
    solution = RESOLVERS[method](p)
    assert np.isfinite(solution.dq).all()
    met = p.lower <= p.upper + 1e-9
    assert (solution.dq[met] >= p.lower[met] - 1e-9).all()
    assert (solution.dq[met] <= p.upper[met] + 1e-9).all()
    if not met.all():
        assert solution.status is Status.INFEASIBLE
        assert "cross by" in solution.message


def fastest(p: Problem) -> float | None:
    """Largest share of ẋ that the bounds allow, None where not even standstill along the path is possible."""
    n, m, k = p.z.size, p.xdot.size, p.b.size
    result = linprog(
        np.append(np.zeros(n), -1.0),
        A_eq=np.block([[p.J, -p.xdot[:, None]], [p.A, np.zeros((k, 1))]]),
        b_eq=np.append(np.zeros(m), p.b),
        bounds=[*zip(p.lower, p.upper, strict=True), (0.0, 1.0)],
    )
    return None if result.status != 0 else -float(result.fun)


def test_the_quadratic_program_is_as_fast_as_the_bounds_allow() -> None:
    rng = np.random.default_rng(4)
    slowed = 0
    for _ in range(200):
        m = int(rng.integers(1, 7))
        n = m + int(rng.integers(1, 5))
        k = int(rng.integers(0, n - m + 1))
        p = Problem(
            rng.normal(size=(m, n)), rng.normal(size=m), z=rng.normal(size=n), B=rng.uniform(0.2, 5.0, n),
            A=rng.normal(size=(k, n)), b=0.1 * rng.normal(size=k),
            lower=-rng.uniform(0.3, 2.0, n), upper=rng.uniform(0.3, 2.0, n),
        )  # fmt: skip
        if np.linalg.cond(np.vstack([p.J, p.A])) > 1e2:
            continue
        solution, limit = RESOLVERS["qp"](p), fastest(p)
        if limit is None:
            assert solution.status >= Status.DEGRADED
            continue
        slowed += limit < 1.0
        assert solution.scale == pytest.approx(limit, abs=1e-8)
        for method in METHODS:
            assert RESOLVERS[method](p).scale <= limit + 1e-9
    assert slowed > 50


def test_the_quadratic_program_minimises_the_criterion_where_null_space_motion_suffices() -> None:
    rng = np.random.default_rng(5)
    compared = 0
    for _ in range(60):
        p = Problem(
            rng.normal(size=(3, 6)), 0.5 * rng.normal(size=3), z=rng.normal(size=6), B=rng.uniform(0.2, 5.0, 6),
            lower=-0.6 * np.ones(6), upper=0.6 * np.ones(6),
        )  # fmt: skip
        solution = RESOLVERS["qp"](p)
        if solution.scale < 1.0 or not solution.active:
            continue
        compared += 1
        found = minimize(
            lambda x, p=p: (x - p.z) @ p.B @ (x - p.z),
            solution.dq,
            jac=lambda x, p=p: 2 * p.B @ (x - p.z),
            bounds=list(zip(p.lower, p.upper, strict=True)),
            constraints={"type": "eq", "fun": lambda x, p=p: p.J @ x - p.xdot, "jac": lambda x, p=p: p.J},
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 200},
        )
        np.testing.assert_allclose(solution.dq, found.x, atol=1e-5)
        assert (solution.dq - p.z) @ p.B @ (solution.dq - p.z) <= found.fun + 1e-9
    assert compared > 15


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_no_jump_where_a_bound_takes_over_and_hands_back(method: str) -> None:
    """A command that swells and ebbs across saturation, on a J that turns: velocity changes stay of the size of the steps."""
    rng = np.random.default_rng(6)
    start, turn, z = rng.normal(size=(4, 7)), rng.normal(size=(4, 7)), 0.3 * rng.normal(size=7)
    direction, bound = np.array([0.6, -0.5, 0.3, 0.5]), 0.5 * np.ones(7)
    steps = {}
    for samples in (500, 4000):
        times = np.linspace(0.0, 1.0, samples)
        dq = np.array(
            [
                RESOLVERS[method](
                    Problem(
                        start + 0.4 * np.sin(3 * t) * turn,
                        2.0 * np.sin(np.pi * t) * direction,
                        z=z,
                        lower=-bound,
                        upper=bound,
                    )
                ).dq
                for t in times
            ]
        )
        steps[samples] = np.abs(np.diff(dq, axis=0)).max()
        assert (np.abs(dq) > 0.499).any()
    assert steps[4000] < 0.3 * steps[500]


@pytest.mark.parametrize("method", METHODS)
def test_says_which_bound_slowed_it_down(method: str) -> None:
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    solution = RESOLVERS[method](Problem(jacobian, [2.0, 0.1], lower=-np.ones(3), upper=np.ones(3)))
    assert solution.scale == pytest.approx(0.5)
    assert Active("upper", 0) in solution.active
    assert solution.message == "path slowed to 0.5 by the upper bound of joint 0"
    np.testing.assert_allclose(jacobian @ solution.dq, [1.0, 0.05])


def test_the_task_gives_way_to_a_bound_that_excludes_standstill_and_the_quadratic_program_keeps_the_most_of_it() -> (
    None
):
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    solution = RESOLVERS["qp"](Problem(jacobian, [0.0, 0.1], lower=[0.2, -1, -1], upper=np.ones(3)))
    assert solution.status is Status.DEGRADED
    np.testing.assert_allclose(jacobian @ solution.dq, [0.2, 0.0], atol=1e-5)


def test_approximate_rows_give_way_before_the_path_slows_down() -> None:
    jacobian = np.array([[1.0, 0.0, 0.2], [0.0, 1.0, 0.1]])
    problem = {"lower": -np.ones(3), "upper": np.ones(3), "epsilon": 1e-3}
    hard = RESOLVERS["qp"](Problem(jacobian, [0.5, 2.0], **problem))  # type: ignore[arg-type]
    soft = RESOLVERS["qp"](Problem(jacobian, [0.5, 2.0], exact=[True, False], **problem))  # type: ignore[arg-type]
    assert hard.scale < 0.6
    assert soft.scale == pytest.approx(1.0)
    assert soft.status is Status.DEGRADED
    assert soft.task_error[0] == pytest.approx(0.0, abs=1e-12)
    assert soft.task_error[1] < -0.5
