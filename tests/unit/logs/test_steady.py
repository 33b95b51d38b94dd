"""Which part of a run counts as steady motion."""

import numpy as np
import pytest

from logs.metrics import RunFacts, evaluate
from logs.signals import DecodedBlock, Signal, SignalTable
from logs.steady import steady_rows
from stack.kinematics import ArmModel

PERIOD_NS = 10_000_000


def commanded(speed: np.ndarray, t_ns: np.ndarray | None = None) -> Signal:
    """Along y, as rounded by the wire."""
    y = np.round(np.cumsum(speed) * 0.01 / 2e-6) * 2e-6
    values = np.zeros((len(y), 7))
    values[:, 1], values[:, 6] = y, 1.0
    return Signal(np.arange(len(y)) * PERIOD_NS if t_ns is None else t_ns, values)


def trapezoid() -> np.ndarray:
    """0.5 s rest, 1 s ramp to 0.2 m/s, 4 s there, 1 s ramp down, 1 s rest."""
    ramp = np.linspace(0.0, 0.2, 100)
    return np.concatenate((np.zeros(50), ramp, np.full(400, 0.2), ramp[::-1], np.zeros(100)))


def test_only_what_has_been_constant_for_a_second_counts() -> None:
    rows = np.flatnonzero(steady_rows(commanded(trapezoid())))
    # constant from row 150 on; a tenth of a second makes a velocity, the ramp's last 2 % are the same
    assert rows[0] == pytest.approx(150 + 100 + 5, abs=6)
    assert rows[-1] == pytest.approx(549, abs=6)
    assert len(rows) == rows[-1] - rows[0] + 1


def test_rest_is_no_motion_and_a_curve_is_not_steady() -> None:
    assert not steady_rows(commanded(np.zeros(500))).any()
    signal = commanded(np.full(500, 0.2))
    signal.values[:, 0] = 0.1 * np.sin(np.arange(500) * 0.02)
    assert not steady_rows(signal).any()


def test_a_gap_begins_anew() -> None:
    t_ns = np.arange(600) * PERIOD_NS
    t_ns[300:] += 10 * PERIOD_NS
    rows = steady_rows(commanded(np.full(600, 0.2), t_ns))
    assert rows[110:300].all()
    assert not rows[300:408].any()
    assert rows[410:].all()


def test_the_metrics_are_those_of_the_steady_rows() -> None:
    signal = commanded(trapezoid())
    steady = steady_rows(signal)
    error = np.where(steady, 0.001, 0.005)[:, None] * np.ones(3)
    error[np.flatnonzero(steady)[:10]] = 0.003
    block = DecodedBlock({"tcp/commanded": signal, "tcp/error": Signal(signal.t_ns, error)})
    facts = RunFacts("sliding-door", 1, "pns", "abc", 1.0, 1.0)
    metrics = evaluate(SignalTable([block]), ArmModel.load("moma8"), facts)
    n = int(steady.sum())
    assert metrics.tcp_error_steady_rms_m == pytest.approx(np.sqrt((10 * 9e-6 + (n - 10) * 1e-6) / n))
    assert metrics.tcp_error_steady_p99_m == pytest.approx(0.003)
    assert metrics.tcp_error_max_m == 0.005


def test_a_run_without_steady_motion_has_none() -> None:
    metrics = evaluate(SignalTable(), ArmModel.load("moma8"), RunFacts("x", 1, "pns", "abc", 1.0, 1.0))
    assert metrics.tcp_error_steady_rms_m is None
    assert metrics.tcp_error_steady_p99_m is None
