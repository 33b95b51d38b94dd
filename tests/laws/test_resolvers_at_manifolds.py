"""On and around every singular manifold of moma8, every method's answer is finite, inside its bounds, and leads out as well as in."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS

VECTORS = json.loads((Path(__file__).parents[1] / "unit" / "kinematics" / "thesis_vectors.json").read_text())
ARM = ArmModel.load("moma8")
POINTS = [(name, np.array(point["q"])) for name, points in VECTORS["singular"].items() for point in points]
unit = st.tuples(*[st.floats(-1.0, 1.0)] * 8).map(np.array)


def test_all_manifolds_are_there() -> None:
    assert {name for name, _ in POINTS} >= {"L1", "L2", "L3", "L4", "F1", "F2", "F3p", "F3m"}


@pytest.mark.parametrize("method", sorted(RESOLVERS))
@given(
    point=st.sampled_from(POINTS),
    offset=unit,
    distance=st.sampled_from([0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.03]),
    wish=unit,
    twist=unit,
    bounded=st.booleans(),
)
def test_finite_and_inside_the_bounds(method, point, offset, distance, wish, twist, bounded) -> None:
    q = point[1] + distance * offset
    bounds = {"lower": -ARM.dq_max, "upper": ARM.dq_max} if bounded else {}
    solution = RESOLVERS[method](Problem(ARM.end_point_jacobian(q), 0.3 * twist[:6], z=wish, **bounds))
    assert np.isfinite(solution.dq).all()
    assert np.isfinite(solution.sigma).all()
    assert np.isfinite(solution.manipulability)
    assert 0.0 <= solution.scale <= 1.0
    if bounded:
        assert np.all(np.abs(solution.dq) <= ARM.dq_max * (1.0 + 1e-9))
    if solution.status is Status.OK:
        np.testing.assert_allclose(ARM.end_point_jacobian(q) @ solution.dq, 0.3 * twist[:6], atol=1e-7)
