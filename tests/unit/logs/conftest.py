"""A short computed run that the tests of the logs share, and Rerun in strict mode."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import rerun as rr

from logs.run_log import RunInfo, RunLog
from logs.signals import SignalTable
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Motion, motion, play

CYCLES = 350


@pytest.fixture(autouse=True)
def _strict() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="session")
def run() -> Motion:
    """3.5 s; the commanded path leaves the true one by 4 mm/s from 1 s on."""
    return motion(CYCLES, error_m=0.004 * CYCLES * 0.01)


@pytest.fixture(scope="session")
def table(run: Motion) -> SignalTable:
    """Its signals, in one-second blocks, without a recording."""
    log = RunLog(DEVICES.values(), "moma8", RunInfo("test"), sync_period_ns=PERIOD_NS, recording=None, event_log=None)
    play(run, log.on_frame, log.on_truth)
    return log.close()


@pytest.fixture(scope="session")
def recorded(run: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the same run, recorded."""
    folder = tmp_path_factory.mktemp("run")
    info = RunInfo("sliding-door", 7, "pns", "abc", "0123abc", {"slip.sigma": 0.01})
    log = RunLog(
        DEVICES.values(),
        "moma8",
        info,
        sync_period_ns=PERIOD_NS,
        recording=folder / "run.rrd",
        event_log=folder / "events.log",
        compact=False,
    )
    play(run, log.on_frame, log.on_truth, log.on_timing)
    log.close()
    assert log.recorder_fault is None
    return folder
