"""Laws of the split task: whatever is commanded from wherever, no limit is broken, and what is not said to give way is met."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stack.kinematics import ArmModel
from stack.kinematics.se3 import rotation_exp
from stack.planner.problem import Status
from stack.planner.resolvers.constraint_optimisation import GaveWay, Weights
from stack.planner.split_task import SplitStep, SplitTask, follow

pytestmark = pytest.mark.slow

ARM = ArmModel.load("kr15")
CYCLE = 0.012
CYCLES = 90

unit = st.floats(-1.0, 1.0)
configurations = st.tuples(*[st.floats(0.02, 0.98)] * 6).map(
    lambda x: ARM.q_min + np.array(x) * (ARM.q_max - ARM.q_min)
)
singular_wrists = configurations.map(lambda q: q * [1, 1, 1, 1, 0, 1])
starts = st.one_of(configurations, singular_wrists)
vectors = st.tuples(unit, unit, unit).map(np.array)
poles = st.tuples(
    st.floats(-3.0, 3.0), st.floats(0.3, 1.8), st.floats(-0.8, 0.8), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)
).map(lambda q: np.array([*q[:4], 0.0, q[4]]))
tasks = st.builds(
    SplitTask,
    cycle_s=st.just(CYCLE),
    weights=st.builds(Weights, beta=st.sampled_from([0.0, 1.0, 3.0])),
    error_bound=st.sampled_from([0.01, 0.05, float("inf")]),
    iterations=st.sampled_from([1, 2, 3]),
)


def smooth(x: float) -> float:
    x = min(max(x, 0.0), 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def run(task: SplitTask, q: np.ndarray, shift: np.ndarray, turn: np.ndarray, seconds: float) -> list[SplitStep]:
    start, steps, dq, moved = ARM.pose(q), list[SplitStep](), np.zeros(6), 0.0

    def path(t: float) -> np.ndarray:
        share, pose = smooth(t / seconds), start.copy()
        pose[:3, 3] += share * shift
        pose[:3, :3] = rotation_exp(share * turn) @ pose[:3, :3]
        return pose

    for _ in range(CYCLES):
        step = follow(ARM, task, q, dq, lambda share, t=moved: path(t + share * CYCLE))  # type: ignore[misc]
        moved += CYCLE * (1.0 - step.time_scaling)
        q, dq = step.q, step.dq
        steps.append(step)
    return steps


def assert_limits(q: np.ndarray, steps: list[SplitStep]) -> None:
    ways = np.array([q, *(step.q for step in steps)])
    speeds = np.array([np.zeros(6), *(step.dq for step in steps)])
    assert np.isfinite(ways).all()
    assert (ways >= ARM.q_min - 1e-9).all()
    assert (ways <= ARM.q_max + 1e-9).all()
    assert (np.abs(speeds) <= ARM.dq_max * (1 + 1e-9)).all()
    assert (np.abs(np.diff(speeds, axis=0)) <= ARM.ddq_max * CYCLE * (1 + 1e-9)).all()
    np.testing.assert_allclose(np.diff(ways, axis=0), speeds[1:] * CYCLE, atol=1e-12)


@settings(max_examples=40)
@given(tasks, starts, vectors, vectors, st.floats(0.2, 3.0))
def test_limits_are_never_broken(
    task: SplitTask, q: np.ndarray, shift: np.ndarray, turn: np.ndarray, seconds: float
) -> None:
    steps = run(task, q, 1.5 * shift, 3.0 * turn, seconds)
    assert_limits(q, steps)
    for step in steps:
        assert 0.0 <= step.time_scaling <= 1.0
        assert bool(step.message) == bool(step.gave_way)
        assert (step.status == Status.INFEASIBLE) == (GaveWay.TRANSLATION in step.gave_way)


@settings(max_examples=40)
@given(starts, vectors, vectors)
def test_translation_is_exact_unless_it_is_said_to_give_way(q: np.ndarray, shift: np.ndarray, turn: np.ndarray) -> None:
    steps = run(SplitTask(CYCLE), q, 0.05 * shift, 0.3 * turn, 1.0)
    assert_limits(q, steps)
    before = [GaveWay.NOTHING, *(step.gave_way for step in steps)]
    for k, step in enumerate(steps):
        if GaveWay.TRANSLATION not in step.gave_way | before[k]:
            assert np.linalg.norm(step.error[:3]) <= 1e-5


@settings(max_examples=25)
@given(poles, vectors)
def test_the_wrist_singularity_can_be_left_in_every_direction(q: np.ndarray, turn: np.ndarray) -> None:
    """To an orientation about ten degrees away; the error ends small, wherever it has to go."""
    norm = np.linalg.norm(turn)
    turn = 0.17 * (turn / norm if norm > 0.1 else np.array([1.0, 0.0, 0.0]))
    steps = run(SplitTask(CYCLE), q, np.zeros(3), turn, 0.5)
    assert_limits(q, steps)
    assert np.linalg.norm(steps[-1].error[3:]) < 0.2 * 0.17
