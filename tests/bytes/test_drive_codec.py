"""Set points and feedback of drives: bytes of the wire in the drive's own units."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.catalogue import DRIVE_IDS, devices, drive
from drivers.drive_codec import DriveCodec
from drivers.frame_codec import InvalidValueError, WrongLengthError
from stack.messages import DriveFeedback

TABLE = devices()


def test_set_point_of_a_joint():
    codec = DriveCodec(drive(21, "axis", rated_torque_mNm=50_000))
    # 1.5 rad = 1,500,000 µrad = 0016 E360h; -10 N·m of 50 N·m = -200 per mille = FF38h
    data, was_limited = codec.encode_set_point(0x000F, 1.5, -10.0)
    assert codec.set_point_id == 0x215
    assert data.hex() == "0f0060e3160038ff"
    assert not was_limited
    assert codec.decode_set_point(data) == (0x000F, pytest.approx(1.5), pytest.approx(-10.0))


def test_feedback_of_the_lift_is_in_metres_and_newtons():
    codec = DriveCodec(drive(22, "lift", rated_torque_mNm=500_000, linear=True))
    feedback = codec.decode_feedback(bytes.fromhex("371680a90300f401"))
    assert codec.feedback_id == 0x196
    assert feedback == DriveFeedback(0x1637, pytest.approx(0.24), pytest.approx(250.0))


@pytest.mark.parametrize("node_id", DRIVE_IDS)
@given(position=st.floats(-2000, 2000), effort_ratio=st.floats(-32, 32), statusword=st.integers(0, 0xFFFF))
def test_feedback_comes_back_within_half_a_unit(node_id, position, effort_ratio, statusword):
    codec = DriveCodec(TABLE[node_id])
    rated = TABLE[node_id].object(0x6076).default * 1e-3
    data, was_limited = codec.encode_feedback(DriveFeedback(statusword, position, effort_ratio * rated))
    received = codec.decode_feedback(data)
    assert not was_limited
    assert received.statusword == statusword
    assert received.position == pytest.approx(position, rel=0, abs=0.51e-6)
    assert received.effort == pytest.approx(effort_ratio * rated, rel=0, abs=0.51e-3 * rated)


def test_what_the_wire_cannot_carry_is_limited_and_reported():
    codec = DriveCodec(TABLE[21])
    data, was_limited = codec.encode_set_point(0, 1e6, -1e9)
    assert was_limited
    assert data.hex() == "0000ffffff7f0180"


@pytest.mark.parametrize(("target", "effort"), [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, -math.inf)])
def test_what_is_not_finite_is_not_sent(target, effort):
    with pytest.raises(InvalidValueError, match="must be finite"):
        DriveCodec(TABLE[21]).encode_set_point(0, target, effort)
    with pytest.raises(InvalidValueError, match="must be finite"):
        DriveCodec(TABLE[21]).encode_feedback(DriveFeedback(0, target, effort))


@pytest.mark.parametrize("length", [0, 7])
def test_a_short_frame_is_an_error_never_a_value(length):
    codec = DriveCodec(TABLE[21])
    with pytest.raises(WrongLengthError):
        codec.decode_feedback(bytes(length))
    with pytest.raises(WrongLengthError):
        codec.decode_set_point(bytes(length))


def test_another_mapping_is_noticed():
    device = TABLE[21]
    remapped = replace(device, pdos=(replace(device.pdos[0], mapping=((0x6040, 0),)), *device.pdos[1:]))
    with pytest.raises(ValueError, match="RPDO1 maps"):
        DriveCodec(remapped)
