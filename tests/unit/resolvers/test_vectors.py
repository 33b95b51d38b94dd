"""The reference vectors: reconstructed problems of the thesis with their answers, twists in the arm's base or the world frame."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.planner.limits import limit_scale
from stack.planner.problem import Problem, Status
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.decomposition import prop
from stack.planner.resolvers.extended import extended_step
from stack.planner.resolvers.step import limit_table

VECTORS: dict[str, Any] = json.loads((Path(__file__).parent / "thesis_vectors.json").read_text())
EXACT = 1e-9


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("moma8")


def in_world(arm: ArmModel, q: list[float], heading: float) -> tuple[np.ndarray, np.ndarray]:
    """Arm Jacobian (6, 8) and platform columns (6, 2) in world axes; the arm's base is 0.15 m ahead of the wheel axis."""
    x, y, _ = arm.pose(q)[:3, 3]
    c, s = np.cos(heading), np.sin(heading)
    turn = np.kron(np.eye(2), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    columns = np.array([[1.0, 0, 0, 0, 0, 0], [-y, x + 0.15, 0, 0, 0, 1.0]]).T
    return turn @ arm.jacobian(q), turn @ columns


@pytest.mark.parametrize("case", VECTORS["pns"])
@pytest.mark.parametrize("method", ["pns", "fsp", "qp"])
def test_null_space_problems(arm: ArmModel, case: dict[str, Any], method: str) -> None:
    jacobian = arm.jacobian(case["q"])
    resolve = RESOLVERS[method]
    free = resolve(Problem(jacobian, case["xd"], B=case["B"], z=case["z"]))
    np.testing.assert_allclose(free.dq, case["qd_unconstrained"], atol=EXACT)
    assert free.status is Status.OK
    row = np.eye(8)[case["constraint"]["joint"]]
    held = resolve(Problem(jacobian, case["xd"], B=case["B"], z=case["z"], A=row, b=case["constraint"]["value"]))
    np.testing.assert_allclose(held.dq, case["qd_constrained"], atol=EXACT)
    np.testing.assert_allclose(held.dq_unconstrained, case["qd_unconstrained"], atol=EXACT)
    assert held.status is Status.CONSTRAINED
    identity = resolve(Problem(jacobian, case["xd"], z=case["z"]))
    np.testing.assert_allclose(identity.dq, case["qd_B_identity_eq_GP"], atol=EXACT)


@pytest.mark.parametrize("case", VECTORS["pns"])
def test_gradient_projection_ignores_the_weight(arm: ArmModel, case: dict[str, Any]) -> None:
    solution = RESOLVERS["gradient"](Problem(arm.jacobian(case["q"]), case["xd"], B=case["B"], z=case["z"]))
    np.testing.assert_allclose(solution.dq, case["qd_B_identity_eq_GP"], atol=EXACT)
    shortest = RESOLVERS["gradient"](Problem(arm.jacobian(case["q"]), case["xd"]))
    np.testing.assert_allclose(shortest.dq, case["pinv"], atol=EXACT)


@pytest.mark.parametrize("method", list(RESOLVERS))
def test_adjusting_motion_without_a_command(arm: ArmModel, method: str) -> None:
    case = VECTORS["pns_zero_cmd"]
    solution = RESOLVERS[method](Problem(arm.jacobian(case["q"]), np.zeros(6), z=case["z"]))
    np.testing.assert_allclose(solution.dq, case["qd"], atol=EXACT)


@pytest.mark.parametrize("case", VECTORS["abc"])
def test_whole_robot(arm: ArmModel, case: dict[str, Any]) -> None:
    jacobian, columns = in_world(arm, case["q"], case["theta"])
    for method in ("pns", "fsp", "qp"):
        problem = Problem(np.hstack([jacobian, columns]), case["xd"], B=case["Bdiag"], z=case["z"])
        np.testing.assert_allclose(RESOLVERS[method](problem).dq, case["qd"], atol=EXACT)
    no_limits = np.full(10, np.inf)
    step = extended_step(
        jacobian, columns, np.array(case["xd"]), np.append(case["q"], (0.0, 0.0)), np.array(case["z"]),
        np.diag(case["Bdiag"]), limit_table(-no_limits, no_limits, np.ones(10), 10 * np.ones(10)),
        np.zeros((0, 10)), np.zeros(0),
    )  # fmt: skip
    np.testing.assert_allclose(step.dq, case["qd"], atol=EXACT)
    assert step.status == Status.OK


@pytest.mark.parametrize("case", VECTORS["propped_sv"])
def test_propped_singular_values(case: dict[str, float]) -> None:
    assert prop(case["s"], case["s0"]) == pytest.approx(case["out"], abs=1e-15)


@pytest.mark.parametrize("case", VECTORS["limit_scale"])
def test_scale_of_the_padding_zone(case: dict[str, float]) -> None:
    scale = limit_scale(case["q"], float(case["lo"]), float(case["lo_thr"]), float(case["hi_thr"]), float(case["hi"]))
    assert scale == pytest.approx(case["alpha"], abs=1e-12)
