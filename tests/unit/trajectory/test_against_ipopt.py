"""The structured solver against IPOPT on the same transcription, objective and limits: the same optimum, none of it given away."""

import numpy as np
import pytest

from stack.strategic.trajectory import Objective, Status, TrajectoryLimits, TrajectoryProblem, solve
from stack.strategic.trajectory.problem import limits_of

pytest.importorskip("casadi", reason="casadi brings IPOPT")

ROBOTS = ("comau_racer7", "iiwa14", "panda", "moma8")


@pytest.mark.parametrize("push", [2.0, 100.0], ids=["acceleration-binds", "velocity-binds"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_reaches_the_optimum_of_ipopt(robot, push):
    """Without singularities both end in the same optimum; with them IPOPT's own may be another local one."""
    from benchmarks.trajectory_reference import Reference

    own = limits_of(robot)
    n = own.q_min.size
    limits = TrajectoryLimits(own.q_min, own.q_max, own.dq_max, np.full(n, push))
    ends = [np.random.default_rng(seed).uniform(own.q_min, own.q_max, (2, n)) for seed in range(3)]
    problems = [TrajectoryProblem(robot, *pair, objective=Objective.NONE, limits=limits) for pair in ends]
    reference = Reference(problems[0], "ipopt")
    for problem in problems:
        found, theirs = solve(problem), reference.solve(problem)
        assert found.status is Status.SOLVED
        assert theirs.converged
        assert found.objective == pytest.approx(theirs.objective, rel=1e-4)
        assert found.t_f == pytest.approx(theirs.t_f, rel=1e-2)
