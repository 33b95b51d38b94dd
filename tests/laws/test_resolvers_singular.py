"""At and around singular configurations every resolver stays finite, bounded, continuous, and says so."""

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS

METHODS = list(RESOLVERS)
HALF = np.pi / 2
SINGULAR = {
    "L1": [0.3, 0.7, 0.0, HALF, -HALF, 0.4, 0.9, 0.2],
    "L2": [0.3, 0.7, -np.pi, 0.0, 0.0, 0.4, 0.9, 0.2],
    "L3": [0.3, 0.7, -HALF, np.pi, 0.0, 0.4, 0.9, 0.2],
    "A1": [0.3, 0.7, -1.0, 0.0, 0.0, 0.0, 0.0, 0.2],
    "A3": [0.3, 0.7, 0.0, -1.3, HALF, 0.0, 0.0, 0.2],
}
EPSILON = 0.02
TWIST = np.array([0.1, -0.05, 0.08, 0.2, 0.1, -0.1])


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("moma8")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", list(SINGULAR))
def test_at_a_singular_configuration(arm: ArmModel, method: str, name: str) -> None:
    jacobian = arm.jacobian(SINGULAR[name])
    solution = RESOLVERS[method](Problem(jacobian, TWIST, z=0.1 * np.ones(8), epsilon=EPSILON))
    assert solution.sigma[-1] < 1e-12
    assert solution.status is Status.SINGULAR
    assert np.isfinite(solution.dq).all()
    assert np.abs(solution.dq).max() <= 2.0 * np.linalg.norm(TWIST) / EPSILON + 1.0
    assert "singular value" in solution.message
    wanted = RESOLVERS["pns"](Problem(jacobian, TWIST, z=0.1 * np.ones(8), epsilon=EPSILON))
    np.testing.assert_allclose(solution.dq, wanted.dq, atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", list(SINGULAR))
def test_no_jump_on_the_way_through(arm: ArmModel, method: str, name: str) -> None:
    """Halving the step halves the largest change of velocity (a jump would stay)."""
    q0 = np.array(SINGULAR[name])
    direction = np.array([0.0, 0.0, 0.3, -0.2, 0.25, 0.3, -0.35, 0.0])
    changes = []
    for samples in (1000, 4000):
        dq = [
            RESOLVERS[method](Problem(arm.jacobian(q0 + s * direction), TWIST, epsilon=0.05)).dq
            for s in np.linspace(-0.4, 0.4, samples // (8 if method == "fsp" else 2))
        ]
        changes.append(np.abs(np.diff(dq, axis=0)).max())
    assert changes[1] < 0.5 * changes[0]


@pytest.mark.parametrize("method", METHODS)
def test_velocity_bounds_hold_at_a_singularity_as_well(arm: ArmModel, method: str) -> None:
    bound = 0.3 * np.ones(8)
    for q in SINGULAR.values():
        solution = RESOLVERS[method](Problem(arm.jacobian(q), TWIST, lower=-bound, upper=bound, epsilon=EPSILON))
        assert np.abs(solution.dq).max() <= 0.3
        assert solution.status is Status.SINGULAR


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_rank_deficient_matrices(method: str, rank: int) -> None:
    rng = np.random.default_rng(rank)
    jacobian = rng.normal(size=(4, rank)) @ rng.normal(size=(rank, 7))
    solution = RESOLVERS[method](Problem(jacobian, rng.normal(size=4), z=rng.normal(size=7)))
    assert solution.status is Status.SINGULAR
    assert np.isfinite(solution.dq).all()
    assert solution.manipulability == pytest.approx(0.0, abs=1e-12)


def test_the_exact_part_of_the_task_survives_a_wrist_singularity(arm: ArmModel) -> None:
    """Rotation may give way, translation holds: what the propped inverse loses in both."""
    jacobian = arm.jacobian(SINGULAR["A1"])
    exact = np.array([True, True, True, False, False, False])
    p = Problem(jacobian, TWIST, exact=exact, epsilon=EPSILON)
    split, propped = RESOLVERS["qp"](p), RESOLVERS["pns"](p)
    assert np.abs(split.task_error[:3]).max() < 1e-9
    assert np.abs(propped.task_error).max() > 1e-3
    assert np.abs(split.task_error).max() < 2.0 * np.abs(propped.task_error).max()
