"""The compiled last limit of the arm cycle against NumPy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stack.planner.arm_command import within_bounds

vectors = st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8).map(np.array)


@given(vectors, vectors, vectors)
def test_within_bounds_clips_each_joint_and_tells_the_worst_change(dq, one, other) -> None:
    lower, upper = np.minimum(one, other), np.maximum(one, other)
    clipped, worst = within_bounds(dq, lower, upper)
    expected = np.minimum(np.maximum(dq, lower), upper)
    np.testing.assert_array_equal(clipped, expected)
    assert worst == np.abs(expected - dq).max()
