"""Who is on the wire and how the mission stands, from the frames alone: what a role knows of the roles in other processes."""

from __future__ import annotations

from drivers.canopen.nmt import ERROR_CONTROL_BASE, NmtState
from drivers.catalogue import PLANNER_ID, STRATEGIC_ID
from drivers.codec import PLANNER_STATE
from drivers.frame import Frame
from logs.tape import SYNC_ID
from stack.messages import PlannerPhase

SILENCE_NS = 350_000_000
_STRATEGIC = ERROR_CONTROL_BASE + STRATEGIC_ID
_PLANNER = ERROR_CONTROL_BASE + PLANNER_ID
_PLANNER_STATE = PLANNER_STATE.can_ids[0]
_AT_WORK = (PlannerPhase.IDLE, PlannerPhase.EXECUTING)


class MissionWatch:
    """Observer of a bus.

    A strategic node that has done its mission stops itself: its heartbeat says «stopped». One that falls silent without that has
    failed, or will come back. `missed_cycles` counts the SYNCs that did not come in time while the planner was at work.
    """

    def __init__(self, sync_period_ns: int) -> None:
        self.finished_ns: int | None = None
        self.strategic_ns: int | None = None
        """Last sign of life, None: never heard."""
        self.planner_ns: int | None = None
        self.began_ns: int | None = None
        """When the planner was at work for the first time."""
        self.missed_cycles = 0
        self._period_ns = sync_period_ns
        self._sync_ns: int | None = None
        self._at_work = False

    def __call__(self, frame: Frame) -> None:
        can_id = frame.can_id
        if can_id == SYNC_ID:
            self._on_sync(frame.t_ns)
        elif can_id == _PLANNER_STATE and frame.data:
            self._at_work = frame.data[0] in _AT_WORK
            if self._at_work and self.began_ns is None:
                self.began_ns = frame.t_ns
        elif can_id == _PLANNER:
            self.planner_ns = frame.t_ns
        elif can_id == _STRATEGIC and len(frame.data) == 1:
            self.strategic_ns = frame.t_ns
            if frame.data[0] != NmtState.STOPPED:
                self.finished_ns = None  # at its mission, or back for another one
            elif self.finished_ns is None:
                self.finished_ns = frame.t_ns

    def silent_for_ns(self, last_ns: int | None, now_ns: int) -> int:
        """How long a node is overdue; 0 while it is alive. One that was never heard is overdue since the start."""
        silence_ns = now_ns - (last_ns or 0)
        return silence_ns if silence_ns > SILENCE_NS else 0

    def _on_sync(self, t_ns: int) -> None:
        if self._sync_ns is not None and self._at_work:
            self.missed_cycles += max(0, round((t_ns - self._sync_ns) / self._period_ns) - 1)
        self._sync_ns = t_ns
