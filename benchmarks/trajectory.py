"""Point-to-point trajectories: the structured solver beside IPOPT (MUMPS) and fatrop on the same pairs, in one run.

One process, one thread, the three one after another on every pair. The same transcription, objective, limits and first guess for all.

    python -m benchmarks.trajectory [--pairs 20] [--robots iiwa14 ...] [--objectives none potentials manipulability]
"""

from __future__ import annotations

import argparse
import os
from time import perf_counter

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np  # noqa: E402

from benchmarks.trajectory_reference import Answer, Reference  # noqa: E402
from stack.strategic.trajectory import Objective, TrajectoryProblem, solve  # noqa: E402
from stack.strategic.trajectory.problem import arm_model  # noqa: E402

ROBOTS = ("comau_racer7", "iiwa14", "panda", "moma8")
LEAST_MANIPULABILITY = 1e-4


def pairs(robot: str, objective: Objective, count: int, seed: int = 1) -> list[TrajectoryProblem]:
    """Uniform inside the limits, both ends at least the paper's threshold away from zero manipulability."""
    arm, rng = arm_model(robot), np.random.default_rng(seed)

    def draw() -> np.ndarray:
        while True:
            q = rng.uniform(arm.q_min, arm.q_max)
            if np.linalg.svd(arm.jacobian(q), compute_uv=False).prod() >= LEAST_MANIPULABILITY:
                return q

    return [TrajectoryProblem(robot, draw(), draw(), objective=objective) for _ in range(count)]


def ours(problem: TrajectoryProblem) -> Answer:
    began = perf_counter()
    found = solve(problem)
    seconds = perf_counter() - began
    return Answer(found.status.name == "SOLVED", found.objective, found.t_f, seconds, found.iterations)


def compare(robot: str, objective: Objective, count: int) -> None:
    """Prints one line for each solver."""
    problems = pairs(robot, objective, count)
    references = {name: Reference(problems[0], name) for name in ("ipopt", "fatrop")}
    ours(problems[0])
    answers: dict[str, list[Answer]] = {"structured": [], "ipopt": [], "fatrop": []}
    for problem in problems:
        answers["structured"].append(ours(problem))
        for name, reference in references.items():
            answers[name].append(reference.solve(problem))
    best = np.array(
        [min(a.objective if a.converged else np.inf for a in row) for row in zip(*answers.values(), strict=True)]
    )
    slow = np.median([a.seconds for a in answers["ipopt"]])
    for name, found in answers.items():
        ms = 1e3 * np.array([a.seconds for a in found])
        ok = np.array([a.converged for a in found])
        ratio = np.array([a.objective for a in found])[ok] / best[ok]
        if not ok.any():
            print(f"{robot:13s} {objective.value:14s} {name:11s} converged 0/{count}")
            continue
        print(
            f"{robot:13s} {objective.value:14s} {name:11s} converged {ok.sum():3d}/{count}  median {np.median(ms):7.2f} ms  p99 "
            f"{np.percentile(ms, 99):8.2f}  IPOPT's median ÷ {1e3 * slow / np.median(ms):5.1f}  objective ÷ best: mean {ratio.mean():.3f}, "
            f"median {np.median(ratio):.4f}, within 1 % {100 * (ratio <= 1.01).mean():3.0f} %",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=ROBOTS)
    parser.add_argument("--objectives", nargs="+", default=["none", "potentials"], choices=[o.value for o in Objective])
    arguments = parser.parse_args()
    for robot in arguments.robots:
        for objective in arguments.objectives:
            compare(robot, Objective(objective), arguments.pairs)


if __name__ == "__main__":
    main()
