"""When the roles of a process have nothing left to do on a real wire: the mission is over, has failed, or will not begin."""

from __future__ import annotations

from collections.abc import Callable

from canipulator.run import SETTLE_NS
from canipulator.wire_watch import MissionWatch
from config.scenario import Scenario
from drivers.canopen.nmt import NmtCommand
from drivers.cia402.phases import MasterPhase
from drivers.planner_node import PlannerNode
from drivers.strategic_node import StrategicNode
from stack.strategic.mission import Stage

PLANNER_PATIENCE_NS = 120_000_000_000
"""How long a mission waits for a planner that is ready."""
RETURN_PATIENCE_NS = 60_000_000_000
"""How long sim and planner wait for a strategic node that has left without having finished."""
FAREWELL_NS = 500_000_000
"""How long a strategic node that has finished goes on saying so."""
LEAVE_NS = {"planner": 5_000_000_000, "sim": 8_000_000_000}
"""From the end of the mission to the end of a role at the latest: the planner comes to rest and switches the drives off."""
SWITCHED_OFF = (MasterPhase.OFF, MasterPhase.BOOT, MasterPhase.CONFIGURE, MasterPhase.READY, MasterPhase.FAULT)


class MissionEnd:
    """Every role ends with the mission: the strategic node when it has said so, the planner when its drives are off, the robot last."""

    def __init__(
        self,
        roles: tuple[str, ...],
        scenario: Scenario,
        watch: MissionWatch,
        planner: PlannerNode | None,
        strategic: StrategicNode | None,
        fail: Callable[[str], None],
    ) -> None:
        """`planner`, `strategic`: those of this process. `fail` hears why a mission has come to nothing."""
        self.failed = False
        """The mission itself; whoever leads it has said why."""
        self._roles, self._scenario, self._watch = roles, scenario, watch
        self._planner, self._strategic = planner, strategic
        self.waiting_since_ns = 0
        self._ended_ns: int | None = None
        self._fail = fail

    @property
    def began(self) -> bool:
        """The strategic node of this process has ended its mission; the others are waited for."""
        return self._ended_ns is not None

    def reached(self, now_ns: int) -> bool:
        """Whether there is nothing left to do for the roles of this process."""
        if self._strategic is not None:
            return self._mission_done(self._strategic, now_ns)
        watch = self._watch
        if watch.finished_ns is not None:
            return self._all_at_rest(now_ns, watch.finished_ns)
        if watch.strategic_ns is None or watch.silent_for_ns(watch.strategic_ns, now_ns) < RETURN_PATIENCE_NS:
            return False
        self._fail("the strategic node has left without having finished, and has not come back")
        return True

    def _mission_done(self, strategic: StrategicNode, now_ns: int) -> bool:
        stage, began_ns = strategic.stage, self._watch.began_ns
        if stage is Stage.WAITING and now_ns - self.waiting_since_ns > PLANNER_PATIENCE_NS:
            self._fail("no planner got ready")
            return True
        over_ns = None if began_ns is None else began_ns + round(2e9 * self._scenario.duration_s)
        if over_ns is not None and now_ns > over_ns and self._ended_ns is None:
            self._fail("the mission takes more than twice the scenario's time")
            return True
        if stage not in (Stage.FINISHED, Stage.FAILED):
            return False
        if self._ended_ns is None:
            self._ended_ns = now_ns
            self.failed = stage is Stage.FAILED
        if now_ns < self._ended_ns + SETTLE_NS:
            return False
        if stage is Stage.FINISHED:
            strategic.node.nmt.command(NmtCommand.STOP)  # its heartbeats tell everybody that it has done its work
        if now_ns < self._ended_ns + SETTLE_NS + FAREWELL_NS:
            return False
        return self._roles == ("strategic",) or self._all_at_rest(now_ns, self._ended_ns)

    def _all_at_rest(self, now_ns: int, ended_ns: int) -> bool:
        """The planner goes when it has switched the drives off, the robot after the planner; neither waits for ever."""
        if now_ns >= ended_ns + max(LEAVE_NS.get(role, 0) for role in self._roles):
            return True
        if self._planner is None:
            return self._watch.silent_for_ns(self._watch.planner_ns, now_ns) > 0
        return now_ns >= ended_ns + FAREWELL_NS and self._planner.master.phase in SWITCHED_OFF
