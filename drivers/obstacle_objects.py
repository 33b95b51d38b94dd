"""What the planner keeps clear of, as objects of its dictionary: boxes, and the leaf of a door."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from drivers.canopen.dictionary import ObjectDictionary
from drivers.objects import Value
from drivers.tables import planner as table
from stack.kinematics.proximity import Box
from stack.planner.leaf import DoorLeaf, LeafMotion

PlaceBoxes = Callable[[tuple[Box, ...]], None]
PlaceDoor = Callable[[DoorLeaf | None], None]


class ObstacleObjects:
    """`boxes` and `door` hear what has been written."""

    def __init__(self, objects: ObjectDictionary, boxes: PlaceBoxes, door: PlaceDoor) -> None:
        self._objects, self._boxes, self._door = objects, boxes, door
        self._obstacles = np.zeros((len(table.OBSTACLES), len(table.OBSTACLE_NAMES)))
        self._leaf = np.zeros(len(table.DOOR_NAMES))
        for number, index in enumerate(table.OBSTACLES):
            for i in range(len(table.OBSTACLE_NAMES)):
                objects.bind(index, i + 1, sink=partial(self._place, number, i))
        for i in range(len(table.DOOR_NAMES)):
            objects.bind(table.DOOR_LEAF, i + 1, sink=partial(self._note, i))
        objects.bind(table.DOOR_MOTION, sink=self._hang)

    def restore(self) -> None:
        """Nothing around, as after power-on."""
        self._obstacles[:] = 0.0
        self._leaf[:] = 0.0
        for index in table.OBSTACLES:
            for i in range(len(table.OBSTACLE_NAMES)):
                self._objects.set(index, i + 1, 0.0)
        for i in range(len(table.DOOR_NAMES)):
            self._objects.set(table.DOOR_LEAF, i + 1, 0.0)
        self._objects.set(table.DOOR_MOTION, 0, int(LeafMotion.ABSENT))

    def _place(self, number: int, i: int, value: Value) -> None:
        """One number of an obstacle; it is there as soon as it has a volume."""
        self._obstacles[number, i] = float(value)
        boxes = (Box(*row) for row in self._obstacles.tolist())
        self._boxes(tuple(box for box in boxes if min(box.length, box.width, box.height) > 0.0))

    def _note(self, i: int, value: Value) -> None:
        self._leaf[i] = float(value)

    def _hang(self, value: Value) -> None:
        """The door as written by now; one without a volume is none."""
        *box, handle_x, handle_y, hinge_x, hinge_y = self._leaf.tolist()
        motion, shut = LeafMotion(int(value)), Box(*box)
        there = motion is not LeafMotion.ABSENT and min(shut.length, shut.width, shut.height) > 0.0
        self._door(DoorLeaf(shut, (handle_x, handle_y), (hinge_x, hinge_y), motion) if there else None)
