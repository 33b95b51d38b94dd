"""The singularity monitor on the bus: one frame per platform cycle, and the same in full by SDO."""

from __future__ import annotations

from functools import partial

import numpy as np

from drivers.canopen.node import CanopenNode
from drivers.codec import SINGULARITY
from drivers.publisher import Publisher
from drivers.tables import planner as table
from stack.kinematics.arm import ArmModel
from stack.messages import SingularityReport, Vector
from stack.planner.monitor import monitor_arm
from stack.planner.singularities import manifolds


class SingularityWatch:
    """Margins of one arm at its set points. What it costs: 0.2 ms per update, most of it the exact list of manifolds.

    Raises ValueError for an arm whose manifolds are not those that the frame names; the margins of the four kinds need none.
    """

    def __init__(self, node: CanopenNode, arm: ArmModel) -> None:
        names = tuple(manifolds(arm, arm.home))
        if names != table.MANIFOLD_NAMES:
            raise ValueError(f"{arm.name}: manifolds {names}, the frame has {table.MANIFOLD_NAMES}")
        self.margins = (1.0, 1.0, 1.0, 1.0)
        self.manifolds: dict[str, float] = {}
        self._arm = arm
        monitor_arm(arm, arm.home)  # compiles the kernels where nothing is cached yet, before there is a cycle to delay
        self._radius = 0.1
        self._out = Publisher(node, SINGULARITY)
        bind = node.dictionary.bind
        bind(table.SINGULARITY_RADIUS, sink=self._set_radius)
        for i in range(len(table.KIND_NAMES)):
            bind(table.SINGULARITY_MARGINS, i + 1, source=partial(self._margin, i))
        for i, name in enumerate(table.MANIFOLD_NAMES, 1):
            bind(table.MANIFOLD_MARGINS, i, source=partial(self._distance, name))

    def _margin(self, kind: int) -> float:
        return self.margins[kind]

    def _distance(self, manifold: str) -> float:
        """0 before the first update."""
        return self.manifolds.get(manifold, 0.0)

    def _set_radius(self, value: int | float | str) -> None:
        self._radius = float(value)

    def update(self, q: Vector, counter: int) -> None:
        """Computes and publishes the margins at q (n,)."""
        found = monitor_arm(self._arm, q)
        self.margins = (found.kinematic, found.algorithmic, found.semi, found.semi_algorithmic)
        self.manifolds = manifolds(self._arm, q)
        nearest = 1 + int(np.argmin(list(self.manifolds.values())))
        self._out.publish(SingularityReport(found.kind(self._radius), nearest, self.margins, counter & 0xFF))
