"""CQPM: the measure's gradient as null-space motion, joint limits as inequalities, resolved on velocities cycle by cycle.

`min ‖q̇ − k ∇H‖²` subject to `J q̇ = ẋ` and what the position limits leave for the next cycle. It only ever sees the present velocity: at a
semi algorithmic singularity that the optimum cannot pass it lets go of the limit and runs up (or down) the measure to another optimum,
as fast as the gain allows.

Source: Park, Chang, Lee. Solved by the stack's own `qp` resolver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stack.messages import Matrix, Vector
from stack.planner.kuhn_tucker import Path
from stack.planner.measures import Measure
from stack.planner.problem import Problem
from stack.planner.resolvers import RESOLVERS


@dataclass(frozen=True, slots=True, eq=False)
class VelocityTrack:
    """t (k,), q (k, n), dq (k, n): the velocity that led to each row, 0 in the first."""

    t: Vector
    q: Matrix
    dq: Matrix


@dataclass(frozen=True, slots=True)
class VelocityProgramme:
    """One robot, one measure. `place`: f(q) (m,), the task that `measure` belongs to; `lower`, `upper` (n,): joint limits;
    `gain`: k in rad² per s and unit of H, negative to minimise."""

    measure: Measure
    place: Callable[[Vector], Vector]
    lower: Vector
    upper: Vector
    gain: float

    def step(self, q: Vector, target: Vector, dt: float) -> Vector:
        """q̇ (n,) that takes the task from where q has it to `target` (m,) within dt, so that no error adds up; limits hold."""
        local = self.measure.at(q)
        solution = RESOLVERS["qp"](
            Problem(
                local.jacobian,
                (target - self.place(q)) / dt,
                z=self.gain * local.gradient,
                lower=(self.lower - q) / dt,
                upper=(self.upper - q) / dt,
                epsilon=1e-9,
            )
        )
        return solution.dq

    def track(self, start: Vector, path: Path, times: Vector) -> VelocityTrack:
        """Explicit steps from `start` (n,), one row per time (k,)."""
        q, qs, dqs = start, [start], [np.zeros(start.size)]
        for before, now in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
            dq = self.step(q, path.position(now), now - before)
            q = np.clip(q + dq * (now - before), self.lower, self.upper)
            qs.append(q)
            dqs.append(dq)
        return VelocityTrack(times, np.array(qs), np.array(dqs))
