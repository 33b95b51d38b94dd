"""SI unit words and interpolation periods, from the notation of CiA 303-2 and from drive makers' defaults."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cia402.units import interpolation_period, si_factor


@pytest.mark.parametrize(
    ("word", "factor"),
    [
        (0xFA10_0000, 1e-6),  # µrad
        (0xFA01_0000, 1e-6),  # µm
        (0xFD10_0300, 1e-3),  # mrad/s
        (0x0001_0300, 1.0),  # m/s
        (0x0041_0000, math.pi / 180),  # degree
        (0x00B4_4700, 2 * math.pi / 60),  # rev/min, the usual default of 60A9h
        (0x0210_0000, 100.0),
    ],
)
def test_si_factor(word: int, factor: float) -> None:
    assert si_factor(word) == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("word", [0x00B5_0000, 0xFA10_5500, 0xFA10_0001, 0])
def test_unknown_units_are_refused(word: int) -> None:
    with pytest.raises(ValueError, match=f"{word:08X}h"):
        si_factor(word)


@pytest.mark.parametrize(
    ("period_ns", "expected"),
    [(10_000_000, (10, -3)), (5_000_000, (5, -3)), (4_000_000, (4, -3)), (2_500_000, (25, -4)), (100_000, (100, -6))],
)
def test_usual_periods_are_exact(period_ns: int, expected: tuple[int, int]) -> None:
    value, index = interpolation_period(period_ns)
    assert value * 10 ** (9 + index) == period_ns
    assert (value, index) == expected or period_ns < 1_000_000


@given(st.integers(100_000, 25_000_000_000))
def test_any_period_is_met_within_two_percent(period_ns: int) -> None:
    value, index = interpolation_period(period_ns)
    assert 1 <= value <= 255
    assert value * 10 ** (9 + index) == pytest.approx(period_ns, rel=0.02)


@pytest.mark.parametrize("period_ns", [0, 400, 26_000_000_000])
def test_impossible_periods_are_refused(period_ns: int) -> None:
    with pytest.raises(ValueError, match=str(period_ns)):
        interpolation_period(period_ns)
