"""A robot that cannot follow slows down on its path: it neither cuts corners nor forgets to arrive; limits hold from any start."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.planner.limits import velocity_bounds
from stack.planner.problem import Problem, Solution
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.rule_base import resolve_within_limits
from stack.planner.resolvers.step import limit_table
from stack.planner.tracking import body_twist, moved

PERIOD = 0.01
METHODS = ["pns", "qp"]
ARM = ArmModel.load("moma8")


def follow(method: str, q: np.ndarray, twist: np.ndarray, duration_s: float, limit_s: float = 20.0):
    """The TCP along `twist` (6,) (end-point frame) for `duration_s` of path time, as fast as the joints can.

    Yields the deviation from the path (position, angle), the scale and q after every cycle, until the path is done.
    """
    X, way, dq = ARM.pose(q), 0.0, np.zeros(8)
    start = X.copy()
    for _ in range(int(limit_s / PERIOD)):
        left = min(1.0, (duration_s - way) / PERIOD)
        correction = body_twist(ARM.pose(q), X) / PERIOD
        solution: Solution = RESOLVERS[method](
            Problem(
                # the Jacobian of the middle of the step: what is left of the path error is of third order in the period
                ARM.end_point_jacobian(q + 0.5 * PERIOD * dq),
                twist * left + correction,
                lower=-ARM.dq_max,
                upper=ARM.dq_max,
            )
        )
        way += solution.scale * left * PERIOD
        X = moved(start, twist, way)
        dq = solution.dq
        q = q + dq * PERIOD
        off = body_twist(ARM.pose(q), X)
        yield np.linalg.norm(off[:3]), np.linalg.norm(off[3:]), solution, q
        if way >= duration_s - 1e-9:
            return
    pytest.fail(f"did not arrive: {way / duration_s:.3f} of the path after {limit_s} s")


@pytest.mark.parametrize("method", METHODS)
def test_a_line_commanded_at_4_m_per_s_is_kept_to_a_millimetre_and_arrives(method: str) -> None:
    twist = np.array([0.0, -4.0, 0.0, 0.0, 0.0, 0.0])
    steps = list(follow(method, ARM.home, twist, 0.6 / 4.0))
    position, angle, solutions, _ = zip(*steps, strict=True)
    assert min(solution.scale for solution in solutions) < 0.5, "it was not overspeed"
    assert max(position) <= 1e-3
    assert max(angle) <= 1e-3
    for solution in solutions:
        assert np.all(np.abs(solution.dq) <= ARM.dq_max * (1.0 + 1e-9))


inside = st.tuples(*[st.floats(0.25, 0.75)] * 8).map(lambda u: ARM.q_min + np.array(u) * (ARM.q_max - ARM.q_min))
directions = st.tuples(*[st.floats(-1.0, 1.0)] * 6).map(np.array).filter(lambda d: np.linalg.norm(d) > 0.1)


@settings(max_examples=40)
@given(q=inside, direction=directions, method=st.sampled_from(METHODS))
def test_saturated_steps_point_along_the_commanded_twist(q: np.ndarray, direction: np.ndarray, method: str) -> None:
    J = ARM.end_point_jacobian(q)
    if np.linalg.svd(J, compute_uv=False)[-1] < 0.02:
        return
    xdot = 50.0 * direction
    solution = RESOLVERS[method](Problem(J, xdot, lower=-ARM.dq_max, upper=ARM.dq_max))
    assert 0.0 < solution.scale < 1.0
    np.testing.assert_allclose(J @ solution.dq, solution.scale * xdot, atol=1e-7 * np.abs(xdot).max())


@pytest.mark.slow
@settings(max_examples=25)
@given(
    joint=st.integers(0, 7),
    beyond=st.floats(0.01, 0.15),
    upper=st.booleans(),
    direction=directions,
    method=st.sampled_from(METHODS),
)
def test_from_outside_a_limit_it_comes_back_and_never_goes_further_out(
    joint: int, beyond: float, upper: bool, direction: np.ndarray, method: str
) -> None:
    q = ARM.home.copy()
    q[joint] = ARM.q_max[joint] + beyond if upper else ARM.q_min[joint] - beyond
    table = limit_table(ARM.q_min, ARM.q_max, ARM.padding, ARM.dq_max)
    outside, dq = beyond, np.zeros(8)
    for _ in range(500):
        low, high = velocity_bounds(q, dq, ARM.q_min, ARM.q_max, ARM.dq_max, ARM.ddq_max, 2.0, PERIOD)
        problem = Problem(ARM.end_point_jacobian(q), 0.2 * direction, lower=low, upper=high)
        solution, _ = resolve_within_limits(RESOLVERS[method], problem, q, table)
        dq = np.clip(solution.dq, low, high)
        q = q + dq * PERIOD
        now = q[joint] - ARM.q_max[joint] if upper else ARM.q_min[joint] - q[joint]
        assert now <= outside + 1e-9
        outside = now
        if outside <= 0.0:
            return
    # recovery is exponential: five seconds at 2 1/s leave next to nothing
    assert outside < 0.01 * beyond + 1e-3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_out_of_a_singularity_is_always_possible(method: str, side: float) -> None:
    """Arm stretched straight down, wrist in line (all of L2, F1, F3): the TCP must come up again on command."""
    q = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    q[7] = side * 0.3
    assert np.linalg.svd(ARM.end_point_jacobian(q), compute_uv=False)[-1] < 1e-9
    height, aside = [], []
    base = ARM.pose(q)
    for _ in range(400):
        pose = ARM.pose(q)
        height.append(pose[2, 3] - base[2, 3])
        aside.append(abs(pose[0, 3] - base[0, 3]))
        twist = np.zeros(6)
        twist[:3] = pose[:3, :3].T @ np.array([0.15, 0.0, 0.15])
        problem = Problem(
            ARM.end_point_jacobian(q), twist, z=0.3 * np.tanh(ARM.preferred - q), lower=-ARM.dq_max, upper=ARM.dq_max
        )
        solution = RESOLVERS[method](problem)
        assert np.isfinite(solution.dq).all()
        q = q + solution.dq * PERIOD
    assert max(aside) > 0.2, "the TCP must get away sideways too"
    assert np.linalg.svd(ARM.end_point_jacobian(q), compute_uv=False)[-1] > 0.02
