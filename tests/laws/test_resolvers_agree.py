"""Laws that hold for every resolver on every problem: they are four ways to one optimum."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stack.planner.problem import Problem, Solution, Status
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.pns import pns, reference

METHODS = list(RESOLVERS)
SAME_OPTIMUM = {"pns": 1e-9, "fsp": 1e-7, "qp": 1e-6}


def optimum(p: Problem) -> np.ndarray:
    """Direct solution of the optimality conditions of the equality-constrained problem."""
    rows = np.vstack([p.J, p.A])
    k, n = rows.shape
    system = np.block([[p.B, rows.T], [rows, np.zeros((k, k))]])
    return np.linalg.solve(system, np.concatenate([p.B @ p.z, p.xdot, p.b]))[:n]


def random_problem(rng: np.random.Generator, *, identity: bool = False) -> Problem:
    m = int(rng.integers(1, 7))
    n = m + int(rng.integers(1, 5))
    k = int(rng.integers(0, n - m + 1))
    root = rng.normal(size=(n, n))
    return Problem(
        rng.normal(size=(m, n)),
        rng.normal(size=m) * rng.choice([0.0, 1e-6, 1.0]),
        B=None if identity else root @ root.T + np.eye(n),
        z=rng.normal(size=n),
        A=rng.normal(size=(k, n)),
        b=rng.normal(size=k),
    )


@pytest.mark.slow
def test_a_thousand_random_problems() -> None:
    rng = np.random.default_rng(1)
    compared = 0
    for _ in range(1000):
        p = random_problem(rng)
        rows = np.vstack([p.J, p.A])
        if np.linalg.cond(rows) > 1e3:
            continue
        compared += 1
        wanted = optimum(p)
        size = 1.0 + np.abs(wanted).max()
        for method, tolerance in SAME_OPTIMUM.items():
            solution = RESOLVERS[method](p)
            np.testing.assert_allclose(solution.dq, wanted, atol=tolerance * size, err_msg=method)
            assert solution.status is (Status.CONSTRAINED if p.b.size else Status.OK)
    assert compared > 900


def test_gradient_projection_is_the_unweighted_unrestricted_case() -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        m = int(rng.integers(1, 7))
        n = m + int(rng.integers(1, 5))
        p = Problem(rng.normal(size=(m, n)), rng.normal(size=m), z=rng.normal(size=n))
        if np.linalg.cond(p.J) > 1e3:
            continue
        wanted = RESOLVERS["gradient"](p).dq
        size = 1.0 + np.abs(wanted).max()
        for method in METHODS:
            np.testing.assert_allclose(RESOLVERS[method](p).dq, wanted, atol=1e-10 * size, err_msg=method)


def test_the_kernel_is_its_plain_reference() -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        p = random_problem(rng)
        if np.linalg.cond(np.vstack([p.J, p.A])) > 1e3:
            continue
        dq, unconstrained, sigma, _, _ = pns(p.J, p.xdot, p.B, p.z, p.A, p.b, 0.3, 1e-12)
        wanted, wanted_unconstrained, wanted_sigma = reference(p.J, p.xdot, p.B, p.z, p.A, p.b, 0.3)
        size = 1.0 + np.abs(wanted).max()
        np.testing.assert_allclose(dq, wanted, atol=1e-9 * size)
        np.testing.assert_allclose(unconstrained, wanted_unconstrained, atol=1e-10 * size)
        np.testing.assert_allclose(sigma, wanted_sigma, atol=1e-12)


# --- with shrinking ------------------------------------------------------------------------------------------------------------

numbers = st.floats(-2.0, 2.0, allow_subnormal=False).map(lambda x: round(x, 3))


@st.composite
def problems(draw: st.DrawFn, rows: bool = True) -> Problem:
    m = draw(st.integers(1, 4))
    n = m + draw(st.integers(1, 3))
    k = draw(st.integers(0, n - m)) if rows else 0
    return Problem(
        draw(arrays(np.float64, (m, n), elements=numbers)),
        draw(arrays(np.float64, m, elements=numbers)),
        B=draw(arrays(np.float64, n, elements=st.floats(0.1, 10.0))),
        z=draw(arrays(np.float64, n, elements=numbers)),
        A=draw(arrays(np.float64, (k, n), elements=numbers)),
        b=draw(arrays(np.float64, k, elements=numbers)),
    )


def everything(solution: Solution) -> list[np.ndarray]:
    return [np.atleast_1d(getattr(solution, f.name)) for f in fields(solution) if f.name not in ("active", "message")]


@pytest.mark.parametrize("method", METHODS)
@given(problem=problems())
def test_finite_deterministic_and_leaves_its_input_alone(method: str, problem: Problem) -> None:
    before = [np.copy(getattr(problem, f.name)) for f in fields(problem)]
    first, second = RESOLVERS[method](problem), RESOLVERS[method](problem)
    for one, two in zip(everything(first), everything(second), strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_array_equal(one, two)
    for name, value in zip((f.name for f in fields(problem)), before, strict=True):
        np.testing.assert_array_equal(getattr(problem, name), value)


@pytest.mark.parametrize("method", METHODS)
@given(problem=problems())
def test_the_status_keeps_its_word(method: str, problem: Problem) -> None:
    p = problem
    solution = RESOLVERS[method](p)
    size = 1.0 + np.abs(solution.dq).max()
    np.testing.assert_allclose(p.J @ solution.dq - solution.scale * p.xdot, solution.task_error, atol=1e-12 * size)
    if solution.status <= Status.CONSTRAINED:
        assert np.abs(solution.task_error).max() <= 1e-9 * size
        assert solution.sigma[-1] >= p.epsilon
    if solution.status <= Status.DEGRADED and p.b.size:
        assert np.abs(p.A @ solution.dq - p.b).max() <= 1e-8 * size
    if solution.status >= Status.SINGULAR:
        assert solution.message
    assert solution.manipulability == pytest.approx(np.prod(solution.sigma))


@pytest.mark.parametrize("method", METHODS)
@given(problem=problems(), data=st.data())
def test_renaming_joints_renames_the_answer(method: str, problem: Problem, data: st.DataObject) -> None:
    p = problem
    assume(np.linalg.cond(np.vstack([p.J, p.A])) < 1e3)
    order = np.array(data.draw(st.permutations(range(p.z.size))))
    turned = Problem(
        p.J[:, order], p.xdot, B=p.B[np.ix_(order, order)], z=p.z[order], A=p.A[:, order], b=p.b,
        lower=p.lower[order], upper=p.upper[order],
    )  # fmt: skip
    solution = RESOLVERS[method](p)
    tolerance = 1e-8 * (1.0 + np.abs(solution.dq).max())
    np.testing.assert_allclose(RESOLVERS[method](turned).dq, solution.dq[order], atol=tolerance)


@pytest.mark.parametrize("method", METHODS)
@given(problem=problems(rows=False), factor=st.floats(0.01, 100.0))
def test_twice_the_command_and_the_wish_is_twice_the_motion(method: str, problem: Problem, factor: float) -> None:
    p = problem
    assume(np.linalg.cond(p.J) < 1e3)
    once = RESOLVERS[method](p).dq
    times = RESOLVERS[method](Problem(p.J, factor * p.xdot, B=p.B, z=factor * p.z)).dq
    np.testing.assert_allclose(times, factor * once, atol=1e-8 * factor * (1.0 + np.abs(once).max()))


@pytest.mark.parametrize("method", METHODS)
@given(problem=problems(rows=False), data=st.data())
def test_the_frame_of_the_twist_does_not_matter(method: str, problem: Problem, data: st.DataObject) -> None:
    p = problem
    assume(np.linalg.cond(p.J) < 1e3)
    m = p.xdot.size
    turn, _ = np.linalg.qr(data.draw(arrays(np.float64, (m, m), elements=numbers)) + 5.0 * np.eye(m))
    here, there = RESOLVERS[method](p), RESOLVERS[method](Problem(turn @ p.J, turn @ p.xdot, B=p.B, z=p.z))
    np.testing.assert_allclose(there.dq, here.dq, atol=1e-8 * (1.0 + np.abs(here.dq).max()))
    np.testing.assert_allclose(there.sigma, here.sigma, atol=1e-12 * (1.0 + here.sigma[0]))
