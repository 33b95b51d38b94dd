"""What the singularity monitor must not depend on: the axes of the base, the order of the joints, units; and that it is finite."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stack.kinematics import ArmModel
from stack.planner.measures import Local, Manipulability
from stack.planner.monitor import WHOLE_TASK, Limits, Margins, joint_limits, margins, monitor_jacobian

MOMA, PLANAR = ArmModel.load("moma8"), ArmModel.load("planar3")
MEASURES = {"moma8": Manipulability(MOMA, WHOLE_TASK), "planar3": Manipulability(PLANAR, np.arange(2))}
SEEDS = st.integers(0, 2**32 - 1)


def numbers(result: Margins) -> list[float]:
    return [
        result.kinematic, result.algorithmic, result.semi, result.semi_algorithmic, result.measure, result.gradient,
    ]  # fmt: skip


def somewhere(arm: ArmModel, seed: int) -> np.ndarray:
    """Any configuration, one joint in a padding zone."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.q_min, arm.q_max)
    i = int(rng.integers(arm.n))
    q[i] = arm.q_min[i] + rng.uniform(0.0, 1.0) * arm.padding[i]
    return q


def limits_of(arm: ArmModel, q: np.ndarray) -> Limits:
    return joint_limits(q, arm.q_min, arm.q_max, arm.padding)


@given(SEEDS, st.sampled_from([MOMA, PLANAR]))
@settings(max_examples=80)
def test_the_axes_of_the_base_do_not_matter(seed: int, arm: ArmModel) -> None:
    q = somewhere(arm, seed)
    turn = np.kron(np.eye(2), Rotation.random(random_state=seed).as_matrix())
    bounds = (q, arm.q_min, arm.q_max, arm.padding)
    rows = WHOLE_TASK
    if arm is PLANAR:  # a planar task stays one only under turns about z
        turn, rows = np.kron(np.eye(2), Rotation.from_euler("z", seed % 7).as_matrix()), np.arange(2)
    one = monitor_jacobian(arm.jacobian(q), rows, *bounds)
    other = monitor_jacobian(turn @ arm.jacobian(q), rows, *bounds)
    np.testing.assert_allclose(numbers(one), numbers(other), rtol=1e-6, atol=1e-9)


@given(SEEDS, st.sampled_from([MOMA, PLANAR]))
@settings(max_examples=80)
def test_the_order_of_the_joints_does_not_matter(seed: int, arm: ArmModel) -> None:
    q = somewhere(arm, seed)
    local, limits = MEASURES[arm.name].at(q), limits_of(arm, q)
    order = np.random.default_rng(seed).permutation(arm.n)
    moved = Local(
        np.ascontiguousarray(local.jacobian[:, order]),
        np.ascontiguousarray(local.derivative[order][:, :, order]),
        local.value,
        local.gradient[order],
        np.ascontiguousarray(local.hessian[np.ix_(order, order)]),
    )
    one = margins(local, limits)
    other = margins(moved, Limits(limits.value, np.ascontiguousarray(limits.gradient[:, order]), limits.width))
    np.testing.assert_allclose(numbers(one), numbers(other), rtol=1e-6, atol=1e-9)
    assert one.limit == other.limit


@given(SEEDS, st.floats(1e-6, 1e6), st.floats(1e-3, 1e3))
@settings(max_examples=60)
def test_the_units_of_measure_and_limits_do_not_matter(seed: int, unit: float, length: float) -> None:
    q = somewhere(MOMA, seed)
    local, limits = MEASURES["moma8"].at(q), limits_of(MOMA, q)
    scaled = Local(local.jacobian, local.derivative, unit * local.value, unit * local.gradient, unit * local.hessian)
    longer = Limits(length * limits.value, length * limits.gradient, limits.width)
    one, other = margins(local, limits), margins(scaled, longer)
    np.testing.assert_allclose(numbers(one)[:4], numbers(other)[:4], rtol=1e-6, atol=1e-9)


@given(SEEDS)
@settings(max_examples=60)
def test_the_compiled_call_gives_what_the_general_one_gives(seed: int) -> None:
    q = somewhere(MOMA, seed)
    general = margins(MEASURES["moma8"].at(q), limits_of(MOMA, q))
    assert monitor_jacobian(MOMA.jacobian(q), WHOLE_TASK, q, MOMA.q_min, MOMA.q_max, MOMA.padding) == general


@given(
    st.lists(st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, 1e-9, 0.3, -2.0]), min_size=8, max_size=8),
    st.booleans(),
)
@settings(max_examples=150)
def test_margins_are_finite_and_in_range_also_on_singularities(angles: list[float], at_limits: bool) -> None:
    q = np.array(angles)
    if at_limits:
        q = np.clip(q, MOMA.q_min, MOMA.q_max)
    result = monitor_jacobian(MOMA.jacobian(q), WHOLE_TASK, q, MOMA.q_min, MOMA.q_max, MOMA.padding)
    assert np.isfinite(numbers(result)).all()
    assert all(0.0 <= margin <= 1.0 for margin in numbers(result)[:4])
    assert np.isfinite([result.curvature, result.multiplier]).all()
    assert result.of(result.nearest) == result.margin


@given(SEEDS, st.floats(1e-8, 1e-6))
@settings(max_examples=60)
def test_a_small_step_changes_margins_a_little(seed: int, step: float) -> None:
    """Inside the limits, where the set of active ones does not change."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(MOMA.q_min + 1e-3, MOMA.q_max - 1e-3)
    near = q + step * rng.uniform(-1.0, 1.0, 8)
    one, other = (margins(MEASURES["moma8"].at(x), limits_of(MOMA, x)) for x in (q, near))
    if one.kinematic > 0.01:
        change = np.abs(np.array(numbers(one)[:4]) - numbers(other)[:4]).max()
        assert change < 1e6 * step
