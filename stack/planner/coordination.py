"""Arm and base: the platform cycle resolves the whole robot, the arm cycle the arm alone against what the platform really does.

Thesis chapter 4. Everything here is expressed in the end-point frame of the arm model at SYNC k + 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stack.kinematics.arm import ArmModel, ArmState, turned_rows
from stack.kinematics.platform import platform_columns
from stack.kinematics.proximity import BodyDistances, Proximity
from stack.messages import Restriction, Vector
from stack.planner.arm_command import ArmCommand, clipped, restrictions_around, restrictions_of, within_bounds
from stack.planner.avoidance import Zones, circumvent, in_hand, repulsion, zones
from stack.planner.clearance import Standing, dampers, must_brake, nearest_pairs
from stack.planner.limits import velocity_bounds
from stack.planner.odometry import PlatformRate
from stack.planner.parameters import Coordination, Limits, Method, PlannerParameters
from stack.planner.platform_command import PLATFORM_DELAY_S, PlatformCommand, accelerated, platform_wish
from stack.planner.preferences import preferred_velocity
from stack.planner.problem import Matrix, Problem, Solution, Status
from stack.planner.resolvers import RESOLVERS
from stack.planner.resolvers.extended import extended_step
from stack.planner.resolvers.rule_base import resolve_within_limits
from stack.planner.resolvers.step import Step, arm_step, limit_table
from stack.planner.resolvers.wished_step import wished_step
from stack.planner.singularities import manifold_margins

RECOVERY_RATE = 2.0
_NO_ROWS_8, _NO_ROWS_10, _NO_VALUES = np.zeros((0, 8)), np.zeros((0, 10)), np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class _Avoiding:
    """Zones that the arm is kept out of, the push (n,) of repulsion, and what is near to what."""

    zones: Zones
    push: Vector
    near: tuple[Proximity, ...] = ()
    at_the_cost_of_the_task: int = 0
    """Rows that may be held beyond what redundancy has room for."""


@dataclass(frozen=True, slots=True, eq=False)
class _Named:
    """A resolver's answer and the joints that the rule base limits."""

    solution: Solution
    limited: NDArray[np.bool_]

    @property
    def dq(self) -> Vector:
        return self.solution.dq


class Coordinator:
    """The two cycles for one robot. Holds tables that follow from the parameters, nothing that changes with time."""

    def __init__(self, arm: ArmModel, limits: Limits, base: Vector) -> None:
        self.n = arm.n
        self.arm = arm
        self.base = base
        self.limits = limits
        self._bodies: BodyDistances | None = None  # 0.1 s to load: only for those who avoid collisions
        self.arm_table = limit_table(limits.q_min, limits.q_max, limits.padding, limits.dq_max)
        free = np.array([np.inf, np.inf])
        self.robot_table = limit_table(
            np.append(limits.q_min, -free),
            np.append(limits.q_max, free),
            np.append(limits.padding, (1.0, 1.0)),
            np.append(limits.dq_max, (limits.v_max, limits.omega_max)),
        )
        # The rule base off: no position limits until set points are sent, velocity and acceleration bounds are kept.
        self.endless = np.full_like(limits.q_max, np.inf)
        self.endless.setflags(write=limits.q_max.flags.writeable)
        self.arm_table_free, self.robot_table_free = self.arm_table.copy(), self.robot_table.copy()
        for table in (self.arm_table_free, self.robot_table_free):
            table[0:2], table[2:4] = -np.inf, np.inf

    def velocity_bounds(self, q: Vector, dq: Vector, parameters: PlannerParameters) -> tuple[Vector, Vector]:
        """What position, velocity and acceleration limits leave to each joint for the next cycle (n,): lower, upper."""
        limits = self.limits
        ruled = parameters.joint_limit_rules
        q_min, q_max = (limits.q_min, limits.q_max) if ruled else (-self.endless, self.endless)
        return velocity_bounds(
            q, dq, q_min, q_max, limits.dq_max, limits.ddq_max, RECOVERY_RATE, parameters.arm_period_s
        )

    def arm_cycle(
        self,
        model: ArmState,
        twist: Vector,
        dq: Vector,
        window: float,
        parameters: PlannerParameters,
        standing: Standing | None = None,
    ) -> ArmCommand:
        """Joint velocities that give the TCP `twist` (6,) relative to the platform, whose own motion was taken out of it.

        `standing`: where the arm is among its obstacles; without it only its own links are kept apart.
        """
        preferences, limits = parameters.preferences, self.limits
        lower, upper = self.velocity_bounds(model.q, dq, parameters)
        jacobian = model.end_point_jacobian
        avoiding = self._avoidance(model, window, parameters, standing)
        if avoiding is not None and standing is not None:
            near = tuple(pair for pair in avoiding.near if in_hand(pair.gradient[None])[0])
            avoiding = replace(avoiding, near=near, zones=avoiding.zones.with_platform_at(standing.rate))
        if parameters.method is not Method.PNS:
            z = self._wishes(model.q, window, parameters)
            weights = preferences.weights[: self.n]
            # A program with inequalities takes all bounds as they are; closed forms slow down on the path for speed alone, see below.
            exact = parameters.method is Method.QP
            top = limits.dq_max
            bounds = (lower, upper) if exact else (-top, top)
            table = self.arm_table if parameters.joint_limit_rules else self.arm_table_free
            named = self._by_name(parameters, jacobian, twist, weights, z, bounds, model.q, table, avoiding)
            command = named if exact else clipped(named, lower, upper)
            return self._stopped_short(command, avoiding, standing, lower, upper, parameters)
        table = self.arm_table if parameters.joint_limit_rules else self.arm_table_free
        around: tuple[str, ...] = ()
        if avoiding is None:
            step = arm_step(
                jacobian, twist, model.q, preferences.wishes, window if parameters.null_space_motion else 0.0,
                preferences.arm_weight, table, _NO_ROWS_8[:, : self.n], _NO_VALUES, parameters.epsilon,
            )  # fmt: skip
        else:
            z = self._wishes(model.q, window, parameters) + avoiding.push
            weight, epsilon = preferences.arm_weight, parameters.epsilon

            def within(rows: Matrix, values: Vector) -> Step:
                return wished_step(jacobian, twist, model.q, z, weight, table, rows, values, epsilon)

            step, around = circumvent(within, avoiding.zones, self.n, self.n - _TASK + avoiding.at_the_cost_of_the_task)
        restrictions = restrictions_of(step.limited, step.status, step.scale) | restrictions_around(around)
        command = clipped(ArmCommand(step.dq, step.scale, Status(step.status), restrictions, step.sigma), lower, upper)
        return self._stopped_short(command, avoiding, standing, lower, upper, parameters)

    def _stopped_short(
        self,
        command: ArmCommand,
        avoiding: _Avoiding | None,
        standing: Standing | None,
        lower: Vector,
        upper: Vector,
        parameters: PlannerParameters,
    ) -> ArmCommand:
        """The command, or all joints braking where it leaves too little way to stop before something is touched."""
        if avoiding is None or not avoiding.near:
            return command
        rate = _NO_RATE if standing is None else standing.rate
        delay_s = _BRAKING_CYCLES * parameters.arm_period_s
        if not must_brake(avoiding.near, command.dq, rate, parameters.clearance, delay_s):
            return command
        braking, _ = within_bounds(np.zeros(self.n), lower, upper)
        return replace(
            command, dq=braking, scale=0.0, status=Status.DEGRADED, restrictions=command.restrictions | _STOPPED_SHORT
        )

    def robot_cycle(
        self,
        model: ArmState,
        twist: Vector,
        slow_twist: Vector,
        rate: PlatformRate,
        window: float,
        parameters: PlannerParameters,
        standing: Standing | None = None,
    ) -> tuple[ArmCommand, PlatformCommand]:
        """The whole robot for the TCP `twist` (6,): the platform's share is its next command, the arm's is what `unified` sends."""
        n, limits = self.n, self.limits
        columns = turned_rows(model.rotation.T, platform_columns(model.position + self.base))
        z = np.append(
            self._wishes(model.q, window, parameters), platform_wish(model, slow_twist, parameters.preferences)
        )
        q = np.append(model.q, (0.0, 0.0))
        avoiding = self._avoidance(model, window, parameters, standing)
        if parameters.method is Method.PNS:
            table = self.robot_table if parameters.joint_limit_rules else self.robot_table_free
            if avoiding is not None:
                z[:n] += avoiding.push

            def within(rows: Matrix, values: Vector) -> Step:
                return extended_step(
                    model.end_point_jacobian, columns, twist, q, z, parameters.preferences.robot_weight, table,
                    rows, values, parameters.epsilon,
                )  # fmt: skip

            around: tuple[str, ...] = ()
            if avoiding is None:
                step = within(_NO_ROWS_10[:, : n + 2], _NO_VALUES)
            else:
                step, around = circumvent(
                    within, avoiding.zones, n + 2, n + 2 - _TASK + avoiding.at_the_cost_of_the_task
                )
            restrictions = restrictions_of(step.limited[:n], step.status) | restrictions_around(around)
            whole = ArmCommand(step.dq, step.scale, Status(step.status), restrictions, step.sigma)
        else:
            extended = np.hstack((model.end_point_jacobian, columns))
            table = self.robot_table if parameters.joint_limit_rules else self.robot_table_free
            bounds = (table[5], table[6])
            weights = parameters.preferences.weights
            whole = self._by_name(parameters, extended, twist, weights, z, bounds, q, table, avoiding)
        wanted = PlatformRate(float(whole.dq[n]), float(whole.dq[n + 1]))
        unified = parameters.coordination is Coordination.UNIFIED
        period = parameters.arm_period_s if unified else parameters.platform_period_s
        command = accelerated(wanted, rate, limits, period)
        # What the platform can do by then counts, too: a turn that it cannot make in time does not take it past anything.
        if avoiding is not None and any(
            must_brake(avoiding.near, whole.dq[:n], np.array(v), parameters.clearance, PLATFORM_DELAY_S)
            for v in (wanted, command.rate)
        ):
            command = accelerated(PlatformRate(0.0, 0.0), rate, limits, period)
        arm = ArmCommand(whole.dq[:n].copy(), whole.scale, whole.status, whole.restrictions, whole.sigma)
        return arm, command

    def _avoidance(
        self, model: ArmState, window: float, parameters: PlannerParameters, standing: Standing | None
    ) -> _Avoiding | None:
        """What keeps the arm away from its singular manifolds, from itself and from obstacles; None with all of it switched off."""
        singular = parameters.repulsion or parameters.circumvention
        if not (singular or parameters.collision_avoidance):
            return None
        push = np.zeros(self.n)
        near: list[Proximity] = []
        kept = zones({}, parameters.avoidance)
        if singular:
            margins = manifold_margins(self.arm, model.q)
            if parameters.repulsion and parameters.null_space_motion:
                push = window * repulsion(margins, parameters.avoidance)
            kept = zones(margins if parameters.circumvention else {}, parameters.avoidance)
        if parameters.collision_avoidance:
            if self._bodies is None:
                self._bodies = BodyDistances(self.arm)
            near = nearest_pairs(self._bodies, model, parameters.clearance, parameters.obstacles, standing)
            kept = dampers(near, self.n, parameters.clearance).and_also(kept)
        return _Avoiding(kept, push, tuple(near), _COLLISION_ROWS if near else 0)

    def _wishes(self, q: Vector, window: float, parameters: PlannerParameters) -> Vector:
        if not parameters.null_space_motion:
            return np.zeros(self.n)
        wish = parameters.preferences
        z: Vector = window * preferred_velocity(q, wish.preferred, wish.heights, wish.widths)
        return z

    def _by_name(
        self,
        parameters: PlannerParameters,
        jacobian: Matrix,
        twist: Vector,
        weights: Vector,
        z: Vector,
        bounds: tuple[Vector, Vector],
        q: Vector,
        table: Matrix,
        avoiding: _Avoiding | None,
    ) -> ArmCommand:
        """Any other method: the rule base around it, velocity bounds inside it."""
        resolver, width, epsilon = RESOLVERS[parameters.method.name.lower()], z.size, parameters.epsilon
        if avoiding is not None:
            z = z + np.append(avoiding.push, np.zeros(width - self.n))

        def within(rows: Matrix, values: Vector) -> _Named:
            problem = Problem(
                jacobian, twist, B=weights, z=z, A=rows, b=values, lower=bounds[0], upper=bounds[1], epsilon=epsilon
            )
            return _Named(*resolve_within_limits(resolver, problem, q, table))

        around: tuple[str, ...] = ()
        if avoiding is None:
            named = within(np.zeros((0, width)), _NO_VALUES)
        else:
            named, around = circumvent(within, avoiding.zones, width, width - _TASK + avoiding.at_the_cost_of_the_task)
        solution = named.solution
        restrictions = restrictions_of(named.limited[: self.n], solution.status, solution.scale)
        restrictions |= restrictions_around(around)
        return ArmCommand(solution.dq, solution.scale, solution.status, restrictions, solution.sigma)


_COLLISION_ROWS = 2
_BRAKING_CYCLES = 2.0
_NO_RATE = np.zeros(2)
_STOPPED_SHORT = Restriction.COLLISION | Restriction.DEGRADED
_TASK = 6
