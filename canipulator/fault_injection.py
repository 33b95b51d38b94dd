"""Injected faults of a lockstep run: each begins and ends at its time on the run's own clock, on the bus or in the robot itself.

Everything random is drawn from the scenario's seed, the fault's place in the list and nothing else: same scenario, same faults.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

from canipulator.fault_effects import INJECTIONS, Parts, Undo, port_name
from canipulator.frame_faults import FrameFault, frame_fault
from config.faults import BUS_KINDS, FaultTable
from drivers.bus.interception import Verdict
from drivers.frame import Frame
from logs.events import Level

FAULT_LOG = "faults.log"
"""Beside bus.log, in its format: frames that faults swallowed or changed, as they were sent. A replay needs them."""


@dataclass
class FaultInjector:
    """Arms the faults of a scenario. `dropped`: frames that its faults of frames have swallowed."""

    faults: tuple[FaultTable, ...]
    seed: int
    parts: Parts
    dropped: int = 0
    injected: int = 0
    _active: list[FrameFault] = field(default_factory=list)

    def arm(self) -> None:
        """Every fault is due at its time, counted from now."""
        clock = self.parts.clock
        begin_ns = clock.now_ns()
        for index, fault in enumerate(self.faults):
            clock.call_at(begin_ns + round(1e9 * fault.at), partial(self._begin, index, fault))

    def _begin(self, index: int, fault: FaultTable) -> None:
        self.injected += 1
        self.parts.on_event(Level.WARN, "fault", f"fault injected: {fault.text}")
        undo = self._inject(index, fault)
        for_s = fault.value("for_s")
        if for_s is not None:
            clock = self.parts.clock
            clock.call_at(clock.now_ns() + round(1e9 * for_s), partial(self._end, fault, undo))

    def _end(self, fault: FaultTable, undo: Undo) -> None:
        undo()
        self.parts.on_event(Level.INFO, "fault", f"fault over: {fault.text}")

    def _inject(self, index: int, fault: FaultTable) -> Undo:
        if fault.kind in BUS_KINDS:
            return self._judge_frames(index, fault)
        return INJECTIONS[fault.kind](self.parts, fault)

    # ---- faults of frames

    def _judge_frames(self, index: int, fault: FaultTable) -> Undo:
        parts = self.parts
        node = fault.value("node")
        sender = None if node is None else port_name(parts, node)
        judge = frame_fault(fault, sender, parts.devices, [self.seed, index])
        self._active.append(judge)
        parts.bus.intercept = self._intercept

        def stop() -> None:
            self._active.remove(judge)
            if not self._active:
                parts.bus.intercept = None

        return stop

    def _intercept(self, sender: str, frame: Frame) -> Verdict | None:
        for judge in self._active:
            verdict = judge(sender, frame)
            if verdict is not None:
                self.dropped += verdict.drop
                if verdict.drop or verdict.data is not None:
                    self.parts.on_spoilt(frame)
                return verdict
        return None
