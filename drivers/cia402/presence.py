"""Waiting for a drive to appear: patient, audible, and not for ever."""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.sdo_abort import StepError
from drivers.canopen.sequence import Sequence, Until
from drivers.cia402.axis import AxisClient
from drivers.clock import Clock


def wait_for_drive(
    axis: AxisClient,
    clock: Clock,
    timeout_ns: int,
    report_ns: int,
    report: Callable[[str], None],
    ask: Callable[[], object],
) -> Sequence[None]:
    """Ends with the first sign of life. Every `report_ns` tells whom it waits for and asks the drive for an answer.

    A drive that booted before the master came, and whose heartbeat is off, is found by its answer.
    """
    began_ns = clock.now_ns()
    while not axis.heard:
        left_ns = began_ns + timeout_ns - clock.now_ns()
        try:
            yield Until(lambda: axis.heard, min(report_ns, left_ns), "boot-up, heartbeat or SDO answer")
        except StepError as nothing:
            waited_s = (clock.now_ns() - began_ns) * 1e-9
            if left_ns <= report_ns:
                raise StepError(
                    f"boot-up, heartbeat or SDO answer within {timeout_ns * 1e-9:g} s", "nothing"
                ) from nothing
            report(f"no boot-up, heartbeat or SDO answer for {waited_s:g} s")
            ask()
