"""An ideal arm on a platform that lags, stepped with the planner: no bus, no physics, the timing of both."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from config.load import load_scenario
from config.robot import load_robot, planner_parameters
from stack.kinematics.platform import integrate_unicycle, platform_twist
from stack.messages import Mode
from stack.planner.drift import DriftEstimate
from stack.planner.parameters import Coordination, PlannerParameters
from stack.planner.planner import Planner, PlannerInputs, PlannerOutputs, PlannerState
from stack.planner.tracking import arm_in_odometry

ROBOT = load_robot("moma8")
PERIOD = 0.01


def parameters(coordination: Coordination = Coordination.ABC, **changes: object) -> PlannerParameters:
    """The robot's own, with a platform that turns along the path."""
    base = planner_parameters(ROBOT, load_scenario("sliding-door"))
    wishes = replace(base.preferences, platform_gain=1.0, platform_feed_forward=1.0)
    return replace(base, coordination=coordination, preferences=wishes, **changes)  # type: ignore[arg-type]


@dataclass
class Loop:
    """Set points sent in cycle k are reached two periods later; wheels have dead time and a lag."""

    parameters: PlannerParameters
    planner: Planner = field(default_factory=lambda: Planner(ROBOT.arm, ROBOT.limits))
    state: PlannerState = field(default_factory=lambda: PlannerState(DriftEstimate()))
    q: np.ndarray = field(default_factory=lambda: ROBOT.arm.home.copy())
    wheels: np.ndarray = field(default_factory=lambda: np.zeros(2))
    base: np.ndarray = field(default_factory=lambda: np.zeros(3))
    cycle: int = 0

    def __post_init__(self) -> None:
        model = self.planner.wheels
        self._set_points = deque([self.q, self.q])
        self._speed = np.zeros(2)
        self._share = model.share(0.001)
        self._delay = deque([np.zeros(2)] * (round(model.dead_time_s * 1e3) + 15))
        self._references: deque[np.ndarray | None] = deque([None, None])

    def step(self, mode: Mode, twist: np.ndarray | None, *, heard: bool = True) -> tuple[PlannerOutputs, float | None]:
        """One cycle: the outputs and how far the TCP is from the reference that was meant for this instant (m)."""
        reference, error = self._references.popleft(), None
        if reference is not None:
            error = float(np.linalg.norm(self.tcp()[:3, 3] - reference[:3, 3]))
        inputs = PlannerInputs(
            t_ns=round(self.cycle * PERIOD * 1e9),
            mode=mode,
            q=self.q.copy() if heard else None,
            wheels=(float(self.wheels[0]), float(self.wheels[1])) if heard else None,
            twist=twist,
            tracked=None,
        )
        self.state, outputs = self.planner.step(self.state, inputs, self.parameters)
        self._references.append(outputs.X_RE)
        self._move(outputs)
        self.cycle += 1
        return outputs, error

    def tcp(self) -> np.ndarray:
        """True TCP pose in the world."""
        pose: np.ndarray = arm_in_odometry(*self.base, self.planner.base, ROBOT.arm.pose(self.q))
        return pose

    def _move(self, outputs: PlannerOutputs) -> None:
        self._set_points.append(outputs.q)
        self._set_points.popleft()
        self.q = self._set_points[0]
        for _ in range(round(PERIOD * 1e3)):
            self._delay.append(np.array(outputs.wheels))
            self._speed = self._speed + self._share * (self._delay.popleft() - self._speed)
            self.wheels = self.wheels + 0.001 * self._speed
            v, omega = platform_twist(self.planner.platform, *self._speed)
            self.base = integrate_unicycle(self.base, v, omega, 0.001)


def along_y(speed: float) -> np.ndarray:
    """Twist (6,) in the end-point frame at home, along the world's y."""
    twist = np.zeros(6)
    twist[:3] = ROBOT.arm.pose(ROBOT.arm.home)[:3, :3].T @ np.array([0.0, speed, 0.0])
    return twist
