"""The planner's parameters as objects of its dictionary: written by SDO in mid-run, valid from the next cycle on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from drivers.canopen.node import CanopenNode
from drivers.objects import Value
from drivers.obstacle_objects import ObstacleObjects
from drivers.platform_path_objects import PlatformPathObjects
from drivers.slip_watch import SlipObjects
from drivers.tables import planner as table
from drivers.tables.platform_path import PATH_STATE
from stack.kinematics.se3 import rotation_log
from stack.messages import PlannerPhase, Vector
from stack.planner.parameters import Coordination, Method, PlannerParameters
from stack.planner.planner import PlannerOutputs


class Reported(Protocol):
    """What the read-only objects show."""

    phase: PlannerPhase
    outputs: PlannerOutputs | None


_ARRAYS = {
    table.PREFERRED_CONFIGURATION: "preferred",
    table.HEIGHTS: "heights",
    table.WIDTHS: "widths",
    table.WEIGHTS: "weights",
}
_PLATFORM = {
    table.PLATFORM_ANGLE: "platform_angle",
    table.PLATFORM_GAIN: "platform_gain",
    table.PLATFORM_MAX_RATE: "platform_max_rate",
    table.PLATFORM_FEED_FORWARD: "platform_feed_forward",
    table.PLATFORM_SPEED: "platform_speed",
}


class PlannerObjects:
    """`parameters` follows what is written; `restore` puts the initial ones into dictionary and parameters."""

    def __init__(self, node: CanopenNode, initial: PlannerParameters, reported: Callable[[], Reported]) -> None:
        self.parameters = initial
        self._initial = initial
        self._dictionary = node.dictionary
        self._reported = reported
        self._bind_choices()
        self._bind_preferences()
        self._slip = SlipObjects(node, lambda: self.parameters, self._change)
        self._around = ObstacleObjects(
            node.dictionary, lambda boxes: self._change(obstacles=boxes), lambda door: self._change(door=door)
        )
        PlatformPathObjects(node.dictionary, lambda path: self._change(platform_path=path))
        self._bind_reports(initial.limits.q_min.size)

    def restore(self) -> None:
        """Power-on values: those of the robot and the scenario, not the catalogue's."""
        self.parameters = self._initial
        objects, wish = self._dictionary, self._initial.preferences
        objects.set(table.METHOD, 0, int(self._initial.method))
        objects.set(table.COORDINATION, 0, int(self._initial.coordination))
        objects.set(table.NULL_SPACE_MOTION, 0, int(self._initial.null_space_motion))
        objects.set(table.JOINT_LIMIT_RULES, 0, int(self._initial.joint_limit_rules))
        objects.set(table.REPULSION, 0, int(self._initial.repulsion))
        objects.set(table.CIRCUMVENTION, 0, int(self._initial.circumvention))
        objects.set(table.COLLISION_AVOIDANCE, 0, int(self._initial.collision_avoidance))
        self._slip.restore(self._initial)
        self._around.restore()
        for index, name in _ARRAYS.items():
            for i, value in enumerate(getattr(wish, name)):
                objects.set(index, i + 1, float(value))
        for subindex, name in _PLATFORM.items():
            objects.set(table.PLATFORM, subindex, float(getattr(wish, name)))

    def _bind_choices(self) -> None:
        bind = self._dictionary.bind
        bind(table.METHOD, sink=lambda value: self._change(method=Method(int(value))))
        bind(table.COORDINATION, sink=lambda value: self._change(coordination=Coordination(int(value))))
        bind(table.NULL_SPACE_MOTION, sink=lambda value: self._change(null_space_motion=bool(value)))
        bind(table.JOINT_LIMIT_RULES, sink=lambda value: self._change(joint_limit_rules=bool(value)))
        bind(table.REPULSION, sink=lambda value: self._change(repulsion=bool(value)))
        bind(table.CIRCUMVENTION, sink=lambda value: self._change(circumvention=bool(value)))
        bind(table.COLLISION_AVOIDANCE, sink=lambda value: self._change(collision_avoidance=bool(value)))

    def _change(self, **fields: Any) -> None:
        self.parameters = replace(self.parameters, **fields)

    def _bind_preferences(self) -> None:
        for index, name in _ARRAYS.items():
            for i in range(getattr(self._initial.preferences, name).size):
                self._dictionary.bind(index, i + 1, sink=self._element(name, i))
        for subindex, name in _PLATFORM.items():
            self._dictionary.bind(table.PLATFORM, subindex, sink=self._scalar(name))

    def _element(self, name: str, i: int) -> Callable[[Value], None]:
        def write(value: Value) -> None:
            array: Vector = getattr(self.parameters.preferences, name).copy()
            array[i] = float(value)
            self._prefer(name, array)

        return write

    def _scalar(self, name: str) -> Callable[[Value], None]:
        return lambda value: self._prefer(name, float(value))

    def _prefer(self, name: str, value: Vector | float) -> None:
        changed: dict[str, Any] = {name: value}
        self._change(preferences=replace(self.parameters.preferences, **changed))

    def _bind_reports(self, joints: int) -> None:
        self._dictionary.bind(table.PHASE, source=lambda: int(self._reported().phase))
        for i in range(joints):
            self._show(table.CONFIGURATION, i + 1, partial(_configuration, i))
        for i in range(3):
            self._show(table.TCP_POSITION, i + 1, partial(_position, i))
            self._show(table.TCP_ROTATION_VECTOR, i + 1, partial(_rotation, i))
        for i in range(6):
            self._show(table.SINGULAR_VALUES, i + 1, partial(_singular_value, i))
        self._show(table.DOOR_OPENING, 0, lambda o: o.opening)
        self._show(table.MANIPULABILITY, 1, lambda o: np.prod(o.arm.sigma))
        for i in range(3):
            self._show(PATH_STATE, i + 1, partial(_on_path, i))

    def _show(self, index: int, subindex: int, read: Callable[[PlannerOutputs], Any]) -> None:
        """Shows a number of the last cycle, 0 before the first one."""

        def source() -> float:
            outputs = self._reported().outputs
            return 0.0 if outputs is None else float(read(outputs))

        self._dictionary.bind(index, subindex, source=source)


def _configuration(joint: int, outputs: PlannerOutputs) -> float:
    return float(outputs.q[joint])


def _position(axis: int, outputs: PlannerOutputs) -> float:
    return float(outputs.T_RE[axis, 3])


def _rotation(axis: int, outputs: PlannerOutputs) -> float:
    return float(rotation_log(outputs.T_RE[:3, :3])[axis])


def _on_path(number: int, outputs: PlannerOutputs) -> float:
    off = outputs.path
    return 0.0 if off is None else (off.s, off.aside, off.turn)[number]


def _singular_value(number: int, outputs: PlannerOutputs) -> float:
    return float(outputs.arm.sigma[number])
