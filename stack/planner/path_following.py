"""A platform that is bound to a path: one unknown ṡ instead of v and ω, forwards and backwards (4.1.2).

The path lies in the reference frame R, from where the platform stands when it begins to follow. In the platform cycle the whole robot is
resolved over `[J_arm | j_s]`; ṡ becomes (v, ω) by the path's curvature, and what the platform is off its path is steered back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stack.kinematics.arm import ArmState, turned_rows
from stack.kinematics.platform import path_column, platform_columns
from stack.messages import Matrix, Restriction, Vector
from stack.planner.arm_command import ArmCommand
from stack.planner.clearance import Standing, must_brake
from stack.planner.coordination import Coordinator
from stack.planner.odometry import PlatformPose, PlatformRate, WheelModel
from stack.planner.parameters import Coordination, Limits, Method, PlannerParameters
from stack.planner.platform_command import PLATFORM_DELAY_S, PlatformCommand, accelerated, platform_wish
from stack.planner.platform_path import PathPoint, PlatformPath, RelativePath

_OMEGA_SHARE, _YAW_SHARE, _BEND_SHARE, _STOP_SHARE = 0.9, 0.8, 0.5, 0.5
"""Shares of the limits that following may use, the rest is the controller's: yaw rate, yaw acceleration by ṡ's acceleration and by
changing curvature; and of the deceleration before an end."""
_APPROACH = 2.5
"""1/s; the last centimetres before an end."""
_REACH_M, _REACTION_S = 0.1, 0.4
"""The way in which a deviation is worked off: 0.1 m at a crawl, more at speed, since the wheels follow late."""
_FARTHEST_M = 0.1


@dataclass(frozen=True, slots=True)
class Deviation:
    """Where the platform is on its path: `point` at `s`; `aside` (m): how far to the left of it; `turn` (rad): its heading against the
    tangent's; `ahead` (m): how far beyond the point, which is 0 but past an end."""

    s: float
    point: PathPoint
    aside: float
    turn: float
    ahead: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PathFollower:
    """Which path is followed, where its frame lies in R, and how far along the platform is; `off`: what `at` found last."""

    given: RelativePath | None = None
    origin: PlatformPose = PlatformPose(0.0, 0.0, 0.0)
    s: float = 0.0
    off: Deviation | None = None

    def following(self, given: RelativePath, pose: PlatformPose) -> PathFollower:
        """Itself if `given` is what it follows already; otherwise a new one, placed where the platform stands: `pose`, in R."""
        if self.given is given:
            return self
        origin = _carried(pose, given.x, given.y, given.heading)
        x, y, _ = _seen_from(origin, pose)
        return PathFollower(given, origin, given.path.closest(x, y, 0.0))

    def moved(self, T: Matrix) -> PathFollower:
        """After the reference frame was placed anew: T (4, 4) carries what lay in the old one into the new."""
        return PathFollower(self.given, in_reference(T, self.origin), self.s, self.off)

    def at(self, pose: PlatformPose) -> tuple[PathFollower, Deviation]:
        """Where the platform at `pose` (in R) is on its path."""
        assert self.given is not None
        path = self.given.path
        x, y, heading = _seen_from(self.origin, pose)
        s = path.closest(x, y, self.s)
        point = path.at(s)
        cosine, sine = math.cos(point.heading), math.sin(point.heading)
        dx, dy = x - point.x, y - point.y
        turn = math.remainder(heading - point.heading, 2.0 * math.pi)
        deviation = Deviation(s, point, cosine * dy - sine * dx, turn, cosine * dx + sine * dy)
        return PathFollower(self.given, self.origin, s, deviation), deviation


def in_reference(T_RO: Matrix, pose: PlatformPose) -> PlatformPose:
    """A platform pose of the odometry frame in R, which T_RO (4, 4) carries it to; level."""
    x, y = (float(T_RO[i, 0] * pose.x + T_RO[i, 1] * pose.y + T_RO[i, 3]) for i in (0, 1))
    return PlatformPose(x, y, pose.heading + math.atan2(T_RO[1, 0], T_RO[0, 0]))


def lead_periods(wheels: WheelModel, period_s: float) -> int:
    """Arm cycles from a reading to when the wheels do what is commanded upon it: two on the bus, dead time, lag."""
    return 2 + round((wheels.dead_time_s + 0.5 / (math.pi * wheels.bandwidth_hz)) / period_s)


class PathCoordinator(Coordinator):
    """A coordinator that can also do without v and ω of the platform's own."""

    def path_cycle(
        self,
        model: ArmState,
        twist: Vector,
        slow_twist: Vector,
        off: Deviation,
        path: PlatformPath,
        rate: PlatformRate,
        window: float,
        parameters: PlannerParameters,
        standing: Standing | None = None,
    ) -> tuple[ArmCommand, PlatformCommand]:
        """The platform cycle on a path: the arm's share, which `unified` sends, and the platform's next command.

        `twist` (6,) of the TCP, `slow_twist` (6,) for the feed-forward, end-point frame; `off`: where the platform will be when the command
        takes effect; `rate`: what it was commanded last.
        """
        limits, unified = parameters.limits, parameters.coordination is Coordination.UNIFIED
        period = parameters.arm_period_s if unified else parameters.platform_period_s
        along = (1.0 - off.point.curvature * off.aside) / math.cos(off.turn)
        bounds = speed_bounds(path, off.s + off.ahead, rate.v / along, limits, period)
        # A program with inequalities takes what is left of ṡ as it is; closed forms would slow the TCP for it, so they know the limit only.
        top = top_speed(path, limits)
        inside = bounds if parameters.method is Method.QP else (-top, top)
        whole = self.on_path(model, twist, slow_twist, off.point.curvature, inside, window, parameters, standing)
        wanted = float(whole.dq[-1])
        speed = min(max(wanted, bounds[0]), bounds[1])
        command = accelerated(steered(off, speed * along), rate, limits, period)
        limited = abs(speed - wanted) > 1e-9 or bool(command.restrictions)
        arm = ArmCommand(whole.dq[:-1].copy(), whole.scale, whole.status, whole.restrictions, whole.sigma)
        return arm, PlatformCommand(command.rate, Restriction.PLATFORM if limited else Restriction.NONE)

    def on_path(
        self,
        model: ArmState,
        twist: Vector,
        slow_twist: Vector,
        curvature: float,
        bounds: tuple[float, float],
        window: float,
        parameters: PlannerParameters,
        standing: Standing | None = None,
    ) -> ArmCommand:
        """`[q̇; ṡ]` (n + 1,) for the TCP `twist` (6,) by whatever method, ṡ within `bounds` (m/s).

        ṡ is 0 where the platform would not stop in time before something is touched.
        The criterion is that of `[q̇; v; ω]` with v = ṡ and ω = κ ṡ put in: weight w_v + κ² w_ω, wish (w_v z_v + κ w_ω z_ω) over it.
        """
        n, wish = self.n, parameters.preferences
        columns = turned_rows(model.rotation.T, platform_columns(model.position + self.base))
        jacobian = np.column_stack((model.end_point_jacobian, path_column(columns, 1.0, curvature)))
        v, omega = platform_wish(model, slow_twist, wish)
        weight_v, weight_omega = wish.weights[n:]
        weight = weight_v + curvature * curvature * weight_omega
        wished = (weight_v * v + curvature * weight_omega * omega) / weight
        z = np.append(self._wishes(model.q, window, parameters), wished)
        arm_table = self.arm_table if parameters.joint_limit_rules else self.arm_table_free
        recovery = 0.2 * max(-bounds[0], bounds[1])
        table = np.column_stack((arm_table, (-np.inf, -np.inf, np.inf, np.inf, recovery, *bounds)))
        avoiding = self._avoidance(model, window, parameters, standing)
        if avoiding is not None and avoiding.zones.platform is not None:
            by_s = avoiding.zones.platform @ np.array([[1.0], [curvature]])
            avoiding = replace(avoiding, zones=replace(avoiding.zones, platform=by_s))
        whole = self._by_name(
            parameters, jacobian, twist, np.append(wish.weights[:n], weight), z, (table[5], table[6]),
            np.append(model.q, 0.0), table, avoiding,
        )  # fmt: skip
        if avoiding is not None:
            rate = whole.dq[n] * np.array([1.0, curvature])
            if must_brake(avoiding.near, whole.dq[:n], rate, parameters.clearance, PLATFORM_DELAY_S):
                return replace(whole, dq=np.append(whole.dq[:n], 0.0))
        return whole


def top_speed(path: PlatformPath, limits: Limits) -> float:
    """|ṡ| that keeps v and ω inside their limits, the yaw acceleration too, at the tightest bend of the path: one speed for all of it."""
    top = limits.v_max
    if path.sharpest > 0.0:
        top = min(top, _OMEGA_SHARE * limits.omega_max / path.sharpest)
    if path.steepest > 0.0:
        top = min(top, math.sqrt(_BEND_SHARE * limits.domega_max / path.steepest))
    return top


def speed_bounds(path: PlatformPath, s: float, speed: float, limits: Limits, period_s: float) -> tuple[float, float]:
    """Lower and upper bound of the next ṡ for a platform at s (m) that goes at `speed` (m/s): limits of speed, acceleration, and the
    path's ends, which it can stop at and past which it comes back. Where acceleration cannot meet the others, it wins."""
    top = top_speed(path, limits)
    change = limits.dv_max
    if path.sharpest > 0.0:
        change = min(change, _YAW_SHARE * limits.domega_max / path.sharpest)
    upper = min(top, _approach(path.end - s, _STOP_SHARE * change))
    lower = -min(top, _approach(s - path.start, _STOP_SHARE * change))
    step = change * period_s
    return min(max(lower, speed - step), speed + step), min(max(upper, speed - step), speed + step)


def _approach(left: float, deceleration: float) -> float:
    """Speed (m/s) at `left` (m) before an end: constant deceleration, then an exponential approach; negative beyond it."""
    linear = deceleration / (_APPROACH * _APPROACH)
    if left <= linear:
        return max(_APPROACH * left, -0.05)
    return math.sqrt(2.0 * deceleration * (left - 0.5 * linear))


def steered(off: Deviation, v: float) -> PlatformRate:
    """v and the ω that belongs to it: the path's curvature, and what works off the deviation over the way that is driven.

    `aside'' + (2/L) aside' + aside/L² = 0` over |ds| whichever the direction: backwards the lateral term changes its sign, the turn does
    not, and the platform never turns round. Nothing is steered while it stands.
    """
    length = _REACH_M + _REACTION_S * abs(v)
    aside = min(max(off.aside, -_FARTHEST_M), _FARTHEST_M)
    curvature = off.point.curvature / (1.0 - off.point.curvature * aside)
    bend = curvature * math.cos(off.turn) - aside * math.cos(0.5 * off.turn) / (length * length)
    return PlatformRate(v, v * bend - 2.0 * abs(v) * off.turn / length)


def _carried(pose: PlatformPose, x: float, y: float, heading: float) -> PlatformPose:
    """A pose given in the axes of `pose`, in the axes that `pose` is given in."""
    cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
    return PlatformPose(pose.x + cosine * x - sine * y, pose.y + sine * x + cosine * y, pose.heading + heading)


def _seen_from(origin: PlatformPose, pose: PlatformPose) -> PlatformPose:
    """`pose` in the axes of `origin`."""
    dx, dy = pose.x - origin.x, pose.y - origin.y
    cosine, sine = math.cos(origin.heading), math.sin(origin.heading)
    return PlatformPose(cosine * dx + sine * dy, cosine * dy - sine * dx, pose.heading - origin.heading)
