"""The slip observer on the bus: its model as objects, its estimate as one frame per platform cycle, and what does not fit as events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from drivers.canopen.node import CanopenNode
from drivers.codec import SLIP
from drivers.objects import Value
from drivers.publisher import Publisher
from drivers.tables import slip as table
from stack.messages import SlipReport
from stack.planner.drift import DriftEstimate
from stack.planner.parameters import PlannerParameters

_QUIET_CYCLES = 100
"""So long no word of further rejected measurements after the first."""


class SlipObjects:
    """200Ch and 2015h: `change` is called with the fields of the planner's parameters that were written."""

    def __init__(
        self, node: CanopenNode, current: Callable[[], PlannerParameters], change: Callable[..., None]
    ) -> None:
        self._dictionary = node.dictionary
        self._dictionary.bind(table.SLIP_OBSERVER, sink=lambda value: change(slip_observer=bool(value)))
        for i, name in enumerate(table.MODEL_FIELDS, start=1):

            def write(value: Value, name: str = name) -> None:
                field: dict[str, Any] = {name: float(value)}
                change(slip_model=replace(current().slip_model, **field))

            self._dictionary.bind(table.SLIP_MODEL, i, sink=write)

    def restore(self, initial: PlannerParameters) -> None:
        """Shows the power-on values."""
        self._dictionary.set(table.SLIP_OBSERVER, 0, int(initial.slip_observer))
        for i, name in enumerate(table.MODEL_FIELDS, start=1):
            self._dictionary.set(table.SLIP_MODEL, i, float(getattr(initial.slip_model, name)))


class SlipWatch:
    """Tells what the planner's drift estimate has come to. `on_event(level, text)`."""

    def __init__(self, node: CanopenNode, on_event: Callable[[str, str], None]) -> None:
        self._out = Publisher(node, SLIP)
        self._on_event = on_event
        self._drift = DriftEstimate()
        self._cycle = 0
        self._quiet_until = 0
        bind = node.dictionary.bind
        bind(table.SLIP, 1, source=lambda: float(self._drift.slip[0]))
        bind(table.SLIP, 2, source=lambda: float(self._drift.slip[1]))
        bind(table.MEASUREMENTS, 1, source=lambda: self._drift.count)
        bind(table.MEASUREMENTS, 2, source=lambda: self._drift.rejected)

    def update(self, drift: DriftEstimate) -> None:
        """Every cycle: events."""
        before, self._drift = self._drift, drift
        self._cycle += 1
        if drift.rejected > before.rejected:
            if self._cycle >= self._quiet_until:
                self._on_event("warning", f"a tracked pose does not fit and is left out ({drift.rejected} so far)")
            self._quiet_until = self._cycle + _QUIET_CYCLES
        if drift.placements > max(1, before.placements):
            self._on_event(
                "warning", "the tracker sees the TCP elsewhere for good: the commanded path goes along with it"
            )

    def publish(self, counter: int) -> None:
        """The frame."""
        left, right = self._drift.slip.tolist()
        counts = self._drift.count & 0xFF, self._drift.rejected & 0xFF
        self._out.publish(SlipReport((left, right), *counts, counter & 0xFF))
