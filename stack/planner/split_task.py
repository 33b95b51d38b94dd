"""A task split into a part that holds exactly and a part that may give way, followed cycle by cycle through singularities.

Schreiber, Otter, Hirzinger: at each sample the step Δq since the last one is found by successive linearisation around q^(j−1) (12), by the
cheap closed form while that keeps every bound, by the constraint optimisation where it does not (35). Both minimise the same criterion
(24, 25): where J is regular and no bound is active, the optimum turns the approximate part by

    y = (α² e_ap + β² Δx_ap) / (α² + β²),   Δq = J⁻¹ [r_ex; y]

exactly, so neither taking over nor handing back makes a step. With β = 0 that is Newton's step to the commanded pose; the rate term, which
takes J Δq for the turn since the last sample (25), leaves about 1e-4° behind while the robot moves at β = α, and 2e-3° at β = 3 α.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from stack.kinematics import ArmModel
from stack.kinematics.se3 import pose_difference, rotation_exp, rotation_log
from stack.messages import Matrix, Vector
from stack.planner.limits import velocity_bounds
from stack.planner.problem import Status
from stack.planner.resolvers.constraint_optimisation import GaveWay, Weights, optimise_step
from stack.planner.resolvers.decomposition import damped_inverse, decompose, prop

TRANSLATION_EXACT = (True, True, True, False, False, False)
_TIGHT = 1e-12


@dataclass(frozen=True, slots=True)
class SplitTask:
    """How a task is followed.

    cycle_s: time between samples; exact: which of the six rows (translation, then rotation, base axes) hold exactly; error_bound: largest
    component of the approximate error, rad (or m), may be infinite; iterations: linearisations per cycle; epsilon: singular value of
    J below which a direction counts as lost (rad/rad); recovery_rate (1/s): how fast a joint outside its limits comes back;
    switching (35): the closed form where it will do; False: the optimisation in every cycle, for comparison.
    """

    cycle_s: float
    weights: Weights = field(default_factory=Weights)
    exact: tuple[bool, ...] = TRANSLATION_EXACT
    error_bound: float = np.inf
    iterations: int = 2
    epsilon: float = 2e-3
    recovery_rate: float = 2.0
    switching: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.cycle_s < np.inf:
            raise ValueError(f"cycle_s is {self.cycle_s}, it must be positive and finite")
        if len(self.exact) != 6:
            raise ValueError(f"exact has {len(self.exact)} entries, it must have 6: translation, then rotation")
        if self.iterations < 1:
            raise ValueError(f"iterations is {self.iterations}, it must be at least 1")
        if not self.error_bound > 0.0:
            raise ValueError(f"error_bound is {self.error_bound}, it must be positive")


@dataclass(frozen=True, slots=True, eq=False)
class SplitStep:
    """q, dq (n,): set points of this sample; goal (4, 4): the pose that was asked for, after time scaling; error (6,): way from the
    pose reached to it, position and rotation vector in base axes; optimised: whether the closed form would not do;
    time_scaling ϑ in [0, 1]; sigma: smallest singular value of J; message: empty when nothing gave way, else what, by name."""

    q: Vector
    dq: Vector
    goal: Matrix
    error: Vector
    optimised: bool
    time_scaling: float
    gave_way: GaveWay
    status: Status
    sigma: float
    message: str


def follow(arm: ArmModel, task: SplitTask, q: Vector, dq: Vector, ahead: Callable[[float], Matrix]) -> SplitStep:
    """One sample: from q, dq (n,) of the last one along `ahead`, the commanded pose (4, 4) at a share in [0, 1] of the coming cycle.

    Position (braking distance), velocity and acceleration limits of `arm` hold in every step, as far as they can be met together:
    a joint that is outside its limits is brought back, braking hard first. With ϑ > 0 only the share 1 − ϑ of the cycle's way was
    gone: `goal` is the pose there, and the next sample goes on from it. Pure; never fails for finite arguments.
    """
    low, high = velocity_bounds(q, dq, arm.q_min, arm.q_max, arm.dq_max, arm.ddq_max, task.recovery_rate, task.cycle_s)
    low, high = low * task.cycle_s, high * task.cycle_s
    goal = ahead(1.0)
    change = pose_difference(goal, ahead(0.0))
    at, state, theta = q, arm.state(q), 0.0
    for _ in range(task.iterations):
        way = pose_difference(goal, state.pose) + change * theta + state.jacobian @ (at - q)
        delta, theta, gave_way, message, optimised = _linearised(task, state.jacobian, way, change, low, high)
        goal, at = ahead(1.0 - theta), q + delta
        state = arm.state(at)
    sigma = float(np.linalg.svd(state.jacobian, compute_uv=False)[-1])
    return SplitStep(
        q=at,
        dq=delta / task.cycle_s,
        goal=goal,
        error=pose_difference(goal, state.pose),
        optimised=optimised,
        time_scaling=theta,
        gave_way=gave_way,
        status=_status(gave_way, optimised, sigma < task.epsilon),
        sigma=sigma,
        message=message,
    )


def chord(here: Matrix, there: Matrix) -> Callable[[float], Matrix]:
    """For `follow`, where only two poses (4, 4) are known: straight in position, about one axis in orientation."""
    shift, turn = there[:3, 3] - here[:3, 3], rotation_log(there[:3, :3] @ here[:3, :3].T)

    def ahead(share: float) -> Matrix:
        pose = here.copy()
        pose[:3, 3] += share * shift
        pose[:3, :3] = rotation_exp(share * turn) @ here[:3, :3]
        return pose

    return ahead


def _linearised(
    task: SplitTask, jacobian: Matrix, way: Vector, change: Vector, low: Vector, high: Vector
) -> tuple[Vector, float, GaveWay, str, bool]:
    """(Δq, ϑ, what gave way, message, optimised) for one linearisation; way (6,): what J Δq should be for the pose to be met
    at the end of the cycle, ϑ = 0."""
    exact = np.array(task.exact)
    alpha, beta = task.weights.alpha**2, task.weights.beta**2
    wanted = np.where(exact, way, (alpha * way + beta * change) / (alpha + beta))
    closed, regular = closed_form(jacobian, wanted, task.epsilon)
    inside = bool((closed >= low - _TIGHT).all() and (closed <= high + _TIGHT).all())
    if (
        task.switching
        and regular
        and inside
        and np.abs((way - jacobian @ closed)[~exact]).max(initial=0.0) <= task.error_bound
    ):
        return np.clip(closed, low, high), 0.0, GaveWay.NOTHING, "", False
    turning = _with_lost_direction(jacobian[~exact], jacobian[exact], task.epsilon)
    found = optimise_step(
        (jacobian[exact], way[exact], change[exact]),
        (turning, way[~exact], change[~exact]),
        low,
        high,
        task.weights,
        task.error_bound,
        closed,
    )
    return found.delta_q, found.time_scaling, found.gave_way, found.message, True


def closed_form(jacobian: Matrix, wanted: Vector, epsilon: float) -> tuple[Vector, bool]:
    """(Δq (n,), regular): the smallest Δq with `J Δq = wanted`; singular values below epsilon are damped, and then it is not regular."""
    u, sigma, vt = decompose(np.ascontiguousarray(jacobian))
    m = sigma.size
    gains = np.array([damped_inverse(value, epsilon) for value in sigma])
    delta: Vector = vt[:m].T @ (gains * (u.T @ wanted))
    return delta, bool(sigma[-1] >= epsilon)


def _with_lost_direction(turning: Matrix, moving: Matrix, epsilon: float) -> Matrix:
    """J_ap (m, n) whose singular values over the null space of J_ex are propped, so that a direction that is lost keeps a gain.

    At the singularity itself the gradient of the error in the lost direction vanishes: the linearised problem would stand still
    there for ever. Propped, it turns the joints whose motion changes nothing (wrist: axes 4 against 6) until the direction is
    found again. Above epsilon J_ap is returned as it is.
    """
    if turning.shape[0] == 0:
        return turning
    n = turning.shape[1]
    free = decompose(np.ascontiguousarray(moving))[2][moving.shape[0] :] if moving.shape[0] else np.eye(n)
    if free.shape[0] < turning.shape[0]:
        return turning
    u, sigma, vt = decompose(np.ascontiguousarray(turning @ free.T))
    if sigma[-1] >= epsilon:
        return turning
    added = np.array([prop(value, epsilon) - value for value in sigma])
    propped: Matrix = turning + (u * added) @ vt[: sigma.size] @ free
    return propped


def _status(gave_way: GaveWay, optimised: bool, singular: bool) -> Status:
    """The worst of what happened."""
    if GaveWay.TRANSLATION in gave_way:
        return Status.INFEASIBLE
    if GaveWay.ORIENTATION_BOUND in gave_way:
        return Status.DEGRADED
    if singular:
        return Status.SINGULAR
    return Status.CONSTRAINED if optimised else Status.OK
