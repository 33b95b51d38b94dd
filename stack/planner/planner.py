"""The local planner: one pure step per arm cycle, the platform cycle inside it where it is due (Fig. 4.3, 4.6, 4.8).

Time of a cycle that begins with SYNC k: feedback was sampled at SYNC k, the set points sent now start at SYNC k + 1 and are reached at
SYNC k + 2. So the arm that is moved "now" is the one of SYNC k + 1 (`q_next`), and everything commanded is meant for k + 2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stack.kinematics.arm import ArmModel, ArmState
from stack.kinematics.platform import platform_of, wheel_speeds
from stack.kinematics.se3 import pose_inverse
from stack.messages import Matrix, Mode, Restriction, Vector
from stack.planner.arm_command import ArmCommand
from stack.planner.clearance import Standing
from stack.planner.cycle import PlannerInputs, PlannerOutputs, PlannerState
from stack.planner.drift import Belief, DriftLaw
from stack.planner.joint_following import JointFollower, velocity_to
from stack.planner.observer import slipping
from stack.planner.odometry import Odometry, PlatformPose, PlatformRate, WheelModel, advance
from stack.planner.parameters import Coordination, Limits, PlannerParameters
from stack.planner.path_following import PathCoordinator, PathFollower, in_reference, lead_periods
from stack.planner.platform_command import PlatformCommand, accelerated, following
from stack.planner.preferences import window
from stack.planner.problem import Status
from stack.planner.reference import CommandFilter
from stack.planner.tracking import arm_in_odometry, follow_path, moved


class Planner:
    """The planner of one robot: holds its model and tables, nothing that changes with time."""

    def __init__(self, arm: ArmModel, limits: Limits) -> None:
        self.arm = arm
        self.platform = platform_of(arm)
        self.base = np.array(self.platform.arm_base)
        self.wheels = WheelModel(self.platform.wheel_bandwidth, self.platform.wheel_dead_time)
        self.coordinator = PathCoordinator(arm, limits, self.base)

    def step(
        self, state: PlannerState, inputs: PlannerInputs, parameters: PlannerParameters
    ) -> tuple[PlannerState, PlannerOutputs]:
        """One arm cycle. The same arguments give the same result, bit for bit."""
        heard, measured = self._listen(state, inputs, parameters)
        if inputs.mode is Mode.OFF:
            return self._rest(heard, inputs, measured)
        if heard.q_next is None:
            if inputs.q is None or inputs.wheels is None:  # nowhere to begin from
                return self._rest(heard, inputs, measured)
            heard = replace(heard, q_next=inputs.q, dq=np.zeros(self.arm.n), commanded=heard.odometry.pose)
        if heard.mode is not inputs.mode:
            heard = _changed_mode(heard, inputs)
        heard, parameters = _eased(heard, inputs.t_ns, parameters)
        if inputs.mode is Mode.PLATFORM_ONLY:
            return self._drive(heard, inputs, parameters, measured)
        if inputs.mode is Mode.JOINTS:
            return self._follow_joints(heard, inputs, parameters, measured)
        return self._reach(heard, inputs, parameters, measured)

    def _listen(
        self, state: PlannerState, inputs: PlannerInputs, parameters: PlannerParameters
    ) -> tuple[PlannerState, Matrix]:
        """Odometry, belief and drift from what was measured at SYNC k; the believed TCP pose T_RE."""
        odometry, drift = state.odometry, state.drift
        if inputs.wheels is not None:
            odometry = odometry.update(self.platform, *inputs.wheels, parameters.arm_period_s)
        else:
            odometry = odometry.without_reading()
        q = inputs.q if inputs.q is not None else self.arm.home if state.q_next is None else state.q_next
        obeys = parameters.coordination is Coordination.UNIFIED and state.q_next is not None
        pose = state.commanded if obeys else odometry.ahead(0, parameters.arm_period_s, self.wheels)
        T_OE = arm_in_odometry(*pose, self.base, self.arm.pose(q))
        believed = drift
        if inputs.q is not None:
            law = self._drift_law(parameters)
            drift = believed = drift.believing(Belief(inputs.t_ns, pose, T_OE), law)
            if inputs.tracked is not None:
                drift = believed.measured_by(inputs.tracked, inputs.t_ns, law)
        heard = replace(state, cycle=state.cycle + 1, odometry=odometry, drift=drift)
        if state.X_RE is not None and drift.placements != believed.placements:
            # The first measurement says where R is, and so does a tracker that was moved: what was commanded so far goes along with it.
            placed = drift.T_RO @ pose_inverse(believed.T_RO)
            heard = replace(heard, X_RE=placed @ state.X_RE, path=state.path.moved(placed))
        return heard, drift.T_RO @ T_OE

    def _drift_law(self, parameters: PlannerParameters) -> DriftLaw:
        """The observer needs what the wheels really turned; unified coordination goes by what they were told, late as they may be."""
        observing = parameters.slip_observer and parameters.coordination is not Coordination.UNIFIED
        return DriftLaw(self.platform.track, parameters.slip_model if observing else None, parameters.tracker_gain)

    def _rest(
        self, state: PlannerState, inputs: PlannerInputs, measured: Matrix
    ) -> tuple[PlannerState, PlannerOutputs]:
        """Nothing to command: set points follow the arm, so that enabling later starts where it is."""
        q = inputs.q if inputs.q is not None else self.arm.home
        outputs = PlannerOutputs(
            q=q,
            dq=np.zeros(self.arm.n),
            effort=self.arm.gravity(q),
            wheels=(0.0, 0.0),
            X_RE=None,
            T_RE=measured,
            arm=ArmCommand.holding(self.arm.n),
            platform=PlatformCommand(PlatformRate(0.0, 0.0)),
            restrictions=Restriction(_staleness(inputs) & ~_STALE_TWIST),
            platform_cycle=False,
            opening=state.door.opening,
        )
        rested = PlannerState(
            state.drift, state.cycle, odometry=state.odometry, commanded=state.odometry.pose, door=state.door
        )
        return rested, outputs

    def _reach(
        self, state: PlannerState, inputs: PlannerInputs, parameters: PlannerParameters, measured: Matrix
    ) -> tuple[PlannerState, PlannerOutputs]:
        """The TCP follows its reference: hold, arm only, coordinated."""
        assert state.q_next is not None and state.dq is not None  # `step` has begun
        period = parameters.arm_period_s
        model = self.arm.state(state.q_next)
        command = state.command.update(inputs.twist, parameters)
        unified = parameters.coordination is Coordination.UNIFIED and inputs.mode is Mode.COORDINATED
        pose_1, pose_2 = self._poses_ahead(state, parameters, obeys=unified)
        T_RO = state.drift.T_RO
        X_1 = state.X_RE if state.X_RE is not None else T_RO @ arm_in_odometry(*pose_1, self.base, model.pose)
        following, deviation, patience = follow_path(
            T_RO, model.pose, X_1, *pose_1, *pose_2, self.base, command.twist,
            parameters.correction_gain, parameters.patience_m, parameters.patience_rad, period,
        )  # fmt: skip
        fade = window((inputs.t_ns - state.began_ns) * 1e-9, parameters.window_s)
        standing, door = None, state.door
        if parameters.collision_avoidance:
            T_RA = T_RO @ arm_in_odometry(*pose_1, self.base, np.eye(4))
            door, leaf = state.door.seen_from(parameters.door, (T_RA @ model.pose)[:3, 3])
            standing = Standing(T_RA, np.array(state.odometry.rate), leaf)
        platform, due, arm, path = PlatformCommand(PlatformRate(0.0, 0.0)), False, None, state.path
        if inputs.mode is Mode.COORDINATED and parameters.coordination is not Coordination.ARM_ONLY:
            due = unified or parameters.platform_cycle_due(state.cycle)
            platform = PlatformCommand(state.rate)
            if due:
                # A platform that drove on while the path waits for the arm would tear the arm along.
                wanted, slow = patience * command.twist, patience * command.slow
                if unified:
                    wanted = wanted + deviation
                path, arm, platform = self._whole_robot(state, model, wanted, slow, fade, parameters, standing)
        if arm is None or not unified:
            arm = self.coordinator.arm_cycle(model, following, state.dq, fade, parameters, standing)
        if patience < 1.0:
            arm = replace(arm, scale=arm.scale * patience)
        X_2 = moved(X_1, command.twist * arm.scale, period)
        return self._send(
            replace(state, path=path, door=door), inputs, parameters, measured, command, arm, platform, X_2, due,
            advance(state.commanded, platform.rate.v * period, platform.rate.omega * period),
        )  # fmt: skip

    def _whole_robot(
        self,
        state: PlannerState,
        model: ArmState,
        twist: Vector,
        slow_twist: Vector,
        fade: float,
        parameters: PlannerParameters,
        standing: Standing | None,
    ) -> tuple[PathFollower, ArmCommand, PlatformCommand]:
        """The platform cycle: free, or bound to a path from where the platform stands when it is first asked to."""
        given = parameters.platform_path
        if given is None:
            arm, platform = self.coordinator.robot_cycle(
                model, twist, slow_twist, state.rate, fade, parameters, standing
            )
            return PathFollower(), arm, platform
        T_RO, period = state.drift.T_RO, parameters.arm_period_s
        pose = state.commanded
        if parameters.coordination is not Coordination.UNIFIED:
            pose = state.odometry.ahead(lead_periods(self.wheels, period), period, self.wheels)
        path, off = state.path.following(given, in_reference(T_RO, pose)).at(in_reference(T_RO, pose))
        arm, platform = self.coordinator.path_cycle(
            model, twist, slow_twist, off, given.path, state.rate, fade, parameters, standing
        )
        return path, arm, platform

    def _drive(
        self, state: PlannerState, inputs: PlannerInputs, parameters: PlannerParameters, measured: Matrix
    ) -> tuple[PlannerState, PlannerOutputs]:
        """The twist is the platform's, the arm rests on it. The commanded TCP path is that of an arm carried by a platform that obeys."""
        assert state.q_next is not None
        period = parameters.arm_period_s
        command = state.command.update(inputs.twist, parameters)
        wanted = PlatformRate(float(command.twist[0]), float(command.twist[5]))
        commanded = advance(state.commanded, wanted.v * period, wanted.omega * period)
        due = parameters.platform_cycle_due(state.cycle)
        platform = PlatformCommand(state.rate)
        if due:
            rate = following(wanted, state.commanded, state.odometry.ahead(1, period, self.wheels))
            platform = accelerated(rate, state.rate, parameters.limits, parameters.platform_period_s)
        carried = arm_in_odometry(*commanded, self.base, self.arm.pose(state.q_next))
        return self._send(
            state, inputs, parameters, measured, command, ArmCommand.holding(self.arm.n), platform,
            state.drift.T_RO @ carried, due, commanded,
        )  # fmt: skip

    def _follow_joints(
        self, state: PlannerState, inputs: PlannerInputs, parameters: PlannerParameters, measured: Matrix
    ) -> tuple[PlannerState, PlannerOutputs]:
        """The joints follow a trajectory of the strategic layer, the platform stands. The commanded TCP path is where they lead it."""
        period = parameters.arm_period_s
        if inputs.joints is not None:
            state = replace(state, joints=state.joints.hearing(*inputs.joints))
        assert state.q_next is not None and state.dq is not None  # `step` has begun
        target = state.joints.at(inputs.t_ns + 2 * parameters.arm_period_ns)
        bounds = self.coordinator.velocity_bounds(state.q_next, state.dq, parameters)
        dq, limited = velocity_to(state.q_next if target is None else target, state.q_next, bounds, period)
        arm = ArmCommand.holding(self.arm.n)
        arm = replace(arm, dq=dq, restrictions=Restriction.ACCELERATION if limited else Restriction.NONE)
        platform = accelerated(PlatformRate(0.0, 0.0), state.rate, parameters.limits, period)
        _, pose_2 = self._poses_ahead(state, parameters, obeys=False)
        X_2 = state.drift.T_RO @ arm_in_odometry(*pose_2, self.base, self.arm.pose(state.q_next + dq * period))
        return self._send(
            state, inputs, parameters, measured, CommandFilter(), arm, platform, X_2, False,
            advance(state.commanded, platform.rate.v * period, platform.rate.omega * period),
        )  # fmt: skip

    def _poses_ahead(
        self, state: PlannerState, parameters: PlannerParameters, *, obeys: bool
    ) -> tuple[PlatformPose, PlatformPose]:
        """Platform poses at SYNC k + 1 and k + 2: measured, extrapolated, slip counted in, or as commanded to a platform that is
        taken to obey."""
        period = parameters.arm_period_s
        if obeys:
            return state.commanded, advance(state.commanded, state.rate.v * period, state.rate.omega * period)
        path = state.odometry.path(2, period, self.wheels)
        _, pose_1, pose_2 = slipping(path, state.drift.slip, period, self.platform.track, parameters.slip_model.tau_s)
        return pose_1, pose_2

    def _send(
        self,
        state: PlannerState,
        inputs: PlannerInputs,
        parameters: PlannerParameters,
        measured: Matrix,
        command: CommandFilter,
        arm: ArmCommand,
        platform: PlatformCommand,
        X_2: Matrix,
        due: bool,
        commanded: PlatformPose,
    ) -> tuple[PlannerState, PlannerOutputs]:
        """Set points, torque offsets and the state that goes with them."""
        assert state.q_next is not None and state.dq is not None
        period = parameters.arm_period_s
        q = state.q_next + arm.dq * period
        limits = parameters.limits
        outputs = PlannerOutputs(
            # Without the rule base the plan runs past a limit; what is sent stops there, joint by joint.
            q=q if parameters.joint_limit_rules else np.clip(q, limits.q_min, limits.q_max),
            dq=arm.dq,
            effort=self._effort(q, arm.dq, (arm.dq - state.dq) / period, state.odometry, period),
            wheels=wheel_speeds(self.platform, *platform.rate),
            X_RE=X_2,
            T_RE=measured,
            arm=arm,
            platform=platform,
            restrictions=Restriction(int(arm.restrictions) | int(platform.restrictions) | _staleness(inputs)),
            platform_cycle=due,
            path=state.path.off,
            opening=state.door.opening,
        )
        following = replace(
            state,
            q_next=q,
            dq=arm.dq,
            X_RE=X_2,
            command=command,
            rate=platform.rate,
            commanded=commanded,
            odometry=state.odometry.commanded(platform.rate),
        )
        return following, outputs

    def _effort(self, q: Vector, dq: Vector, ddq: Vector, odometry: Odometry, period: float) -> Vector:
        """Inverse dynamics on a platform that moves: its yaw is that of a faster first joint, its acceleration tilts gravity."""
        v, omega = odometry.rate
        dv, domega = odometry.acceleration(period, self.wheels)
        yawing, yawing_rate = dq.copy(), ddq.copy()
        yawing[0] += omega
        yawing_rate[0] += domega
        x = self.base[0]
        acceleration = np.array([dv - omega * omega * x, v * omega + domega * x, 0.0])
        return self.arm.inverse_dynamics(q, yawing, yawing_rate, acceleration)


def _changed_mode(state: PlannerState, inputs: PlannerInputs) -> PlannerState:
    """Set points go on from where they are, the command starts from zero."""
    if Mode.PLATFORM_ONLY in (state.mode, inputs.mode):
        state = replace(state, commanded=state.odometry.pose, X_RE=None, path=PathFollower())
    return replace(state, mode=inputs.mode, began_ns=inputs.t_ns, command=CommandFilter(), joints=JointFollower())


def _eased(state: PlannerState, t_ns: int, parameters: PlannerParameters) -> tuple[PlannerState, PlannerParameters]:
    """Preferences that were written since the last cycle come in gradually."""
    change = state.preferences.towards(parameters.preferences, t_ns, parameters.window_s)
    if change is not state.preferences:
        state = replace(state, preferences=change)
    in_force = change.in_force(t_ns, parameters.window_s)
    return state, parameters if in_force is parameters.preferences else replace(parameters, preferences=in_force)


def _staleness(inputs: PlannerInputs) -> int:
    """Bits of what is missing."""
    stale = _STALE_TWIST if inputs.twist is None and inputs.mode is not Mode.HOLD else 0
    return stale | (_STALE_DRIVE if inputs.q is None or inputs.wheels is None else 0)


_STALE_TWIST, _STALE_DRIVE = int(Restriction.STALE_TWIST), int(Restriction.STALE_DRIVE)


__all__ = ["Planner", "PlannerInputs", "PlannerOutputs", "PlannerState", "Status"]
