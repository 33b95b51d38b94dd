"""The gate of one drive: its limits from the drive's own objects, before RPDO1, and what is said of what it refuses."""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.emcy import EmcyCode
from drivers.canopen.node import CanopenNode
from drivers.cia402.axis import COMMAND_OBJECTS
from drivers.cia402.parameters import I32_MAX, I32_MIN, DriveParameters
from drivers.clock import Clock
from drivers.gate import JUMP_MARGIN, OFFSET_SHARE, Reason, SetPointGate, SetPointLimits
from drivers.objects import DeviceDef

MARGIN, REFUSED, LIMITED = 0x2100, 0x2101, 0x2102
GATE_MARGIN, GATE_MARGIN_PER_MILLE = (MARGIN, 0), round(1000 * JUMP_MARGIN)
"""What a master that plans smooth motions writes into its drives."""
I16_MAX = (1 << 15) - 1


def has_gate(device: DeviceDef) -> bool:
    """Whether a drive has the object that sets its gate up."""
    return any(entry.key == GATE_MARGIN for entry in device.objects)


class GateKeeper:
    """Asks the gate about every frame of RPDO1 while its mapping is that of COMMAND_OBJECTS; another one passes unseen.

    The first frame that does not pass is an emergency message FF01h with the reason; it is resolved by the next SYNC after which
    everything passed. `follows`: whether set points move the axis.
    """

    def __init__(
        self, node: CanopenNode, parameters: DriveParameters, clock: Clock, follows: Callable[[], bool]
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._clock = clock
        self._follows = follows
        self._refused_now = False
        self.gate = SetPointGate(self._limits())
        self._pdo = node.rpdo[1]
        self._pdo.guard = self._judge
        dictionary = node.dictionary
        dictionary.bind(REFUSED, source=lambda: self.gate.counts.refused)
        dictionary.bind(LIMITED, source=lambda: self.gate.counts.by_reason[Reason.LIMITED])

    def on_sync(self) -> None:
        """A SYNC."""
        self.gate.on_sync(self._clock.now_ns())
        if self._refused_now:
            self._refused_now = False
        elif EmcyCode.GATE in self._node.emcy.errors:
            self._node.emcy.resolve(EmcyCode.GATE)

    def seed(self, target: int) -> None:
        """The axis is enabled where it is; limits may have changed since."""
        self.gate.limits = self._limits()
        self.gate.seed(target, 0)

    def _judge(self, data: bytes) -> bytes | None:
        if self._pdo.mapped not in COMMAND_OBJECTS:
            return data
        passed, reason = self.gate.judge(data, self._follows(), self._clock.now_ns())
        if passed is None and reason is not None:
            self._refused_now = True
            self._node.emcy.report(EmcyCode.GATE, bytes((reason,)))
        return passed

    def _limits(self) -> SetPointLimits:
        dictionary = self._node.dictionary
        cyclic_position = self._pdo_maps_position()
        velocity, period_ns = dictionary.integer(0x607F), max(self._parameters.period_ns, 1)
        margin = dictionary.integer(MARGIN)
        jump = round(1e-3 * margin * velocity * period_ns * 1e-9) if margin and cyclic_position else None
        torque = min(dictionary.integer(0x6072), I16_MAX)
        lower, upper = (
            (dictionary.integer(0x607D, 1), dictionary.integer(0x607D, 2)) if cyclic_position else (I32_MIN, I32_MAX)
        )
        return SetPointLimits(lower, upper, jump, None, torque, round(OFFSET_SHARE * torque), period_ns)

    def _pdo_maps_position(self) -> bool:
        return (0x607A, 0) in self._node.rpdo[1].mapped
