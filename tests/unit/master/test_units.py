"""Unit words, the conversion of limits, and interpolation periods; from the notation of CiA 303-2 and from drive makers' defaults."""

from __future__ import annotations

import math
import struct
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from drivers.catalogue import devices
from drivers.cia402.axis import AxisClient
from drivers.cia402.cyclic import CyclicData
from drivers.cia402.drive_units import NO_LIMIT, DriveUnits, in_drive_units, units_of_table
from drivers.cia402.units import Scale, UnitError, converted, interpolation_period, unit_scale
from drivers.clock import LockstepClock

TABLE = devices()


@pytest.mark.parametrize(
    ("word", "derivative", "factor"),
    [
        (0xFA10_0000, 0, 1e-6),  # µrad
        (0xFD41_0000, 0, 1e-3 * math.pi / 180),  # thousandth of a degree
        (0x0041_0000, 0, math.pi / 180),
        (0x0042_0000, 0, math.pi / 180 / 60),  # minute of arc
        (0x0043_0000, 0, math.pi / 180 / 3600),  # second of arc
        (0x0040_0000, 0, math.pi / 200),  # grade: 400 are a turn
        (0xFAB4_0000, 0, 2e-6 * math.pi),  # µ-revolution
        (0x0210_0000, 0, 100.0),
        (0xFD10_0300, 1, 1e-3),  # mrad/s
        (0x00B4_4700, 1, 2 * math.pi / 60),  # rev/min, the usual default of 60A9h
        (0xFDB4_4700, 1, 2e-3 * math.pi / 60),
        (0xFAB4_5700, 2, 2e-6 * math.pi),  # µ-revolutions/s²
        (0xFDC0_0300, 2, 2e-3 * math.pi / 60),  # thousandths of a rev/min, per second
        (0x00B5_0000, 0, 2 * math.pi / 4096),
        (0x01B5_0300, 1, 20 * math.pi / 4096),
    ],
)
def test_unit_word_of_a_joint(word: int, derivative: int, factor: float) -> None:
    increment = Scale(Fraction(2, 4096), 1)
    scale = unit_scale(word, derivative, linear=False, increment=increment)
    assert float(scale) == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(("word", "derivative", "factor"), [(0xFA01_0000, 0, 1e-6), (0x0001_0300, 1, 1.0)])
def test_unit_word_of_the_lift(word: int, derivative: int, factor: float) -> None:
    assert float(unit_scale(word, derivative, linear=True)) == factor


@pytest.mark.parametrize(
    ("word", "derivative", "linear"),
    [
        (0x00B5_0000, 0, False),  # increments of nobody knows what
        (0xFA10_5500, 1, False),
        (0xFA10_0001, 0, False),
        (0, 0, False),
        (0xFA10_0300, 0, False),  # a velocity where a position belongs
        (0xFA10_0000, 1, False),
        (0xFA10_0300, 2, False),
        (0xFA01_0000, 0, False),  # metres of a joint that turns
        (0xFA10_0000, 0, True),
        (0x00C0_0300, 1, False),
    ],
)
def test_a_unit_that_cannot_be_is_named_with_one_that_would_be_right(word: int, derivative: int, linear: bool) -> None:
    with pytest.raises(UnitError, match=f"60A[89A]h.*e.g. FA.*h, came SI unit {word:08X}h"):
        unit_scale(word, derivative, linear=linear)


@pytest.mark.parametrize(
    ("value", "drive", "down", "up"),
    [
        (2_356_194, Scale(Fraction(1, 180_000), 1), 134_999, 135_000),  # 134.99996 degrees in thousandths
        (-2_356_194, Scale(Fraction(1, 180_000), 1), -135_000, -134_999),
        (115_500, Scale(Fraction(1, 10**5)), 11_550, 11_550),
        (115_509, Scale(Fraction(1, 10**5)), 11_550, 11_551),
        (1_650_000, Scale(Fraction(2, 60), 1), 15, 16),  # 15.756 rev/min
        (3_141_592, Scale(Fraction(1), 1), 0, 1),  # a hair below π
        (3_141_593, Scale(Fraction(1), 1), 1, 2),
    ],
)
def test_numbers_by_hand(value: int, drive: Scale, down: int, up: int) -> None:
    table = Scale(Fraction(1, 10**6))
    assert (converted(value, table, drive, up=False), converted(value, table, drive, up=True)) == (down, up)


scales = st.builds(
    lambda mantissa, exponent, pi: Scale(Fraction(mantissa) * Fraction(10) ** exponent, pi),
    st.integers(1, 999),
    st.integers(-9, -2),
    st.integers(0, 1),
)
LIMITS = [(0x6065, 0), (0x607D, 1), (0x607D, 2), (0x607F, 0), (0x6085, 0), (0x60C5, 0), (0x6072, 0)]
PI = Fraction("3.14159265358979323846264338327950288419716939937510")


def exact(value: int, scale: Scale) -> Fraction:
    return value * scale.ratio * PI**scale.pi


@given(scales, scales, scales, scales, st.sampled_from(LIMITS), st.integers(1, 1 << 31))
def test_a_limit_is_never_looser_in_the_units_of_a_drive(
    position: Scale, velocity: Scale, acceleration: Scale, effort: Scale, key: tuple[int, int], size: int
) -> None:
    device = TABLE[25]
    units = DriveUnits(position, velocity, acceleration, effort)
    value = -size if key == (0x607D, 1) else size % 65_536 if key[0] == 0x6072 else size
    assume(value != NO_LIMIT.get(key))
    try:
        number = in_drive_units(device, units, key, value)
    except UnitError:
        return
    table, drive = units_of_table(device).of(key[0]), units.of(key[0])
    assert table is not None
    assert drive is not None
    if key in ((0x607D, 1), (0x6085, 0)):  # the lower end of the joint, and a ramp that must not be weaker
        assert exact(number, drive) >= exact(value, table)
    else:
        assert exact(number, drive) <= exact(value, table)
    if key[0] == 0x607D:
        assert abs(exact(number, drive) - exact(value, table)) < exact(1, drive)
    elif key[0] != 0x6072:
        assert abs(exact(number, drive) / exact(value, table) - 1) <= Fraction(1, 10)
    else:
        assert number <= value, "nor more than so much of what the motor bears"


@given(scales, scales, scales, st.floats(-2.9, 2.9), st.floats(-40.0, 40.0))
def test_set_points_and_feedback_are_within_half_a_unit(
    position: Scale, velocity: Scale, effort: Scale, target: float, torque: float
) -> None:
    sent: list[bytes] = []
    axis = AxisClient(TABLE[25], timeout_ns=1)

    def send(_: int, data: bytes) -> bool:
        sent.append(data)
        return True

    clock = LockstepClock()
    cyclic = CyclicData((axis,), clock, send, 10_000_000, lambda *_: None)
    try:
        axis.set_units(DriveUnits(position, velocity, velocity, effort))
    except UnitError:
        return
    cyclic.rescale(axis)
    axis.follows_planner = True
    cyclic.send_targets(np.array([target]), np.array([torque]))
    _, wire_target, wire_torque = struct.unpack("<Hih", sent[-1])
    a_bit = Fraction(1, 10**12)
    assert abs(exact(wire_target, position) - Fraction(target)) <= exact(1, position) / 2 + a_bit
    if abs(Fraction(torque)) < exact(32_000, effort):
        assert abs(exact(wire_torque, effort) - Fraction(torque)) <= exact(1, effort) / 2 + a_bit
    axis.take_feedback(struct.pack("<Hih", 0x1637, wire_target, wire_torque), clock.now_ns())
    axis.take_velocity(struct.pack("<ib", 12_345, 8), clock.now_ns())
    feedback = axis.feedback(clock.now_ns())
    assert feedback is not None
    assert feedback.position == pytest.approx(float(exact(wire_target, position)), rel=1e-12)
    assert feedback.effort == pytest.approx(float(exact(wire_torque, effort)), rel=1e-12)
    assert axis.velocity(clock.now_ns(), 1) == pytest.approx(float(exact(12_345, velocity)), rel=1e-12)


@given(st.sampled_from(sorted(NO_LIMIT)), scales)
def test_no_limit_stays_no_limit(key: tuple[int, int], scale: Scale) -> None:
    assert in_drive_units(TABLE[11], DriveUnits(scale, scale, scale, scale), key, NO_LIMIT[key]) == NO_LIMIT[key]


@pytest.mark.parametrize("node_id", sorted(node for node in TABLE if 11 <= node <= 28))
def test_in_its_own_units_the_table_is_the_table(node_id: int) -> None:
    device = TABLE[node_id]
    for entry in device.objects:
        if entry.index >= 0x6000:
            value = int(entry.default)
            assert in_drive_units(device, units_of_table(device), entry.key, value) == value


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
