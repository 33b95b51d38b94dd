"""Whether an enabled drive's master still speaks: set points with every SYNC, and SYNC itself."""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.emcy import EmcyCode
from drivers.canopen.node import CanopenNode, CommunicationLoss
from drivers.cia402.bank_axis import BankAxis
from drivers.cia402.parameters import DriveParameters
from drivers.clock import Clock

MISSED_PERIODS = 3
"""SYNC periods without a set point, or without SYNC, until the drive says so. By then it brakes: the loops do that by themselves, two
periods after the last set point; they go on when set points return."""
LOST_PERIODS = 10
"""… until the drive gives its master up: the reaction of 6007h."""


class MasterWatch:
    """Says by EMCY that the master is late (8250h set points, 8700h SYNC), and calls `on_loss` when it is lost.

    `missing`: SYNC periods without a set point, on end.
    """

    def __init__(
        self,
        node: CanopenNode,
        axis: BankAxis,
        parameters: DriveParameters,
        clock: Clock,
        on_loss: Callable[[CommunicationLoss], None],
    ) -> None:
        self.missing = 0
        self._emcy = node.emcy
        self._axis = axis
        self._parameters = parameters
        self._clock = clock
        self._on_loss = on_loss
        self._sync_late = False

    @property
    def follows(self) -> bool:
        """Set points come, or have not been missed for long enough to say so."""
        return self.missing < MISSED_PERIODS

    def begin(self, cyclic: bool) -> None:
        """The drive is enabled; `cyclic`: in a mode that lives on set points."""
        self.missing = 0
        self._sync_late = False
        self._axis.expect_sync(self._in_periods(MISSED_PERIODS) if cyclic else None)

    def on_missing(self) -> None:
        """A SYNC without a set point before it."""
        self.missing += 1
        if self.missing == MISSED_PERIODS:
            self._emcy.report(EmcyCode.RPDO_TIMEOUT)
        elif self.missing >= LOST_PERIODS:
            self._on_loss(CommunicationLoss.RPDO)

    def on_sync(self) -> None:
        """A SYNC came in time: the next one is waited for."""
        self._sync_late = False
        self._axis.expect_sync(self._in_periods(MISSED_PERIODS))

    def on_late_sync(self) -> None:
        """The first time: said, and waited for; the second time: given up."""
        if self._sync_late:
            self._on_loss(CommunicationLoss.SYNC)
        else:
            self._sync_late = True
            self._emcy.report(EmcyCode.SYNC_LOST)
            self._axis.expect_sync(self._in_periods(LOST_PERIODS - MISSED_PERIODS))

    def _in_periods(self, count: int) -> int:
        return self._clock.now_ns() + count * self._parameters.period_ns
