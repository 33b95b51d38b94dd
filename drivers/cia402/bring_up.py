"""The long ways of one axis: from nothing to READY, and from FAULT back to READY."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.canopen.nmt import NMT_CAN_ID, NmtCommand, NmtState
from drivers.canopen.sdo_client import REQUEST_BASE
from drivers.canopen.sequence import Sequence, Until
from drivers.cia402 import power
from drivers.cia402.axis import AxisClient
from drivers.cia402.configuration import DriveSettings, set_up
from drivers.cia402.master_supervision import Report
from drivers.cia402.phases import AxisPhase, EventKind
from drivers.cia402.presence import wait_for_drive
from drivers.clock import Clock

_READ_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")


@dataclass(frozen=True, slots=True)
class MasterTimes:
    """How long a master waits for what. `late_syncs`: SYNCs without an answer that are still no failure."""

    boot_ns: int = 30_000_000_000
    boot_report_ns: int = 1_000_000_000
    transition_ns: int = 500_000_000
    stop_ns: int = 5_000_000_000
    sdo_ns: int = 100_000_000
    sdo_attempts: int = 8
    late_syncs: int = 10
    standstill: float = 5e-3
    """rad/s or m/s: at most this is standing."""


class BringUp:
    """Sequences that lead an axis to READY."""

    def __init__(
        self,
        settings: DriveSettings,
        times: MasterTimes,
        clock: Clock,
        send: Callable[[int, bytes], bool],
        report: Report,
    ) -> None:
        self._settings = settings
        self._times = times
        self._clock = clock
        self._send = send
        self._report = report

    def start_up(self, axis: AxisClient) -> Sequence[None]:
        """Waits for the drive, sets it up, starts it."""
        yield from self._await(axis)
        axis.phase = AxisPhase.CONFIGURING
        yield from self._set_up(axis)

    def recover(self, axis: AxisClient) -> Sequence[None]:
        """Waits for the drive, sets it up if it may have lost its settings, resets its fault, takes its torque away."""
        yield from self._await(axis)
        if axis.needs_configuration or axis.nmt_state != NmtState.OPERATIONAL:
            yield from self._set_up(axis)
        else:
            axis.statusword = None
            wait_ns = self._settings.answer_timeout_ns
            yield Until(lambda: axis.statusword is not None, wait_ns, "TPDO1 (is SYNC running?)")
        yield from power.clear_fault(axis, self._times.transition_ns, self._times.stop_ns)
        yield from power.disable(axis, self._times.stop_ns)

    def _await(self, axis: AxisClient) -> Sequence[None]:
        yield from wait_for_drive(
            axis,
            self._clock,
            self._times.boot_ns,
            self._times.boot_report_ns,
            lambda text: self._report(axis, EventKind.WAITING, text),
            lambda: self._send(REQUEST_BASE + axis.node_id, _READ_DEVICE_TYPE),
        )

    def _set_up(self, axis: AxisClient) -> Sequence[None]:
        note = partial(self._report, axis, EventKind.NOTED)
        yield from set_up(axis, self._settings, self._clock, partial(self._command, axis), note)

    def _command(self, axis: AxisClient, command: NmtCommand) -> None:
        self._send(NMT_CAN_ID, bytes((command, axis.node_id)))  # refused: the sequence will miss its effect
