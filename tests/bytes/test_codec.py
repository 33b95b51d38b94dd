"""Messages to bytes and back: layout from the bus description, limits, and everything that must not be accepted."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.catalogue import devices
from drivers.checksum import crc8_j1850
from drivers.codec import (
    GRIPPER_STATE,
    JOINT_REFERENCE,
    MESSAGES,
    MISSION,
    PLANNER_STATE,
    REFERENCE,
    TRACKED_POSE,
    TWIST,
    WRENCH,
    Decoder,
    ReferencePose,
)
from drivers.frame_codec import CodecError, InvalidValueError, UnknownFrameError, WrongChecksumError, WrongLengthError
from stack.messages import (
    Gripper,
    GripperPhase,
    GripperState,
    JointReference,
    MissionCommand,
    Mode,
    PlannerPhase,
    PlannerState,
    Restriction,
    TrackedPose,
    TwistCommand,
    Wrench,
)


def sealed(can_id: int, payload: bytes) -> bytes:
    """Payload of seven bytes with its checksum, from the definition."""
    return payload + bytes([crc8_j1850(can_id.to_bytes(2, "little") + payload)])


def i24(*values: int) -> bytes:
    return b"".join(value.to_bytes(3, "little", signed=True) for value in values)


LAYOUTS = [
    (
        TWIST,
        TwistCommand(np.array([0.05, -0.05, 1.0, 0.1, -0.1, 3.2767]), 7),
        [
            (0x181, struct.pack("<hhhB", 1000, -1000, 20000, 7)),
            (0x281, struct.pack("<hhhB", 1000, -1000, 32767, 7)),
        ],
    ),
    (MISSION, MissionCommand(Mode.COORDINATED, 3, 255), [(0x481, bytes([4, 3, 0, 0, 0, 0, 255]))]),
    (MISSION, MissionCommand(Mode.JOINTS, 1, 2, Gripper.CLOSE), [(0x481, bytes([5, 1, 2, 0, 0, 0, 2]))]),
    (
        JOINT_REFERENCE,
        JointReference(np.array([1e-6, -1e-6, 0.5, -0.5, 1.0, -1.0, 3.0, -3.0]), 7),
        [
            (0x1E3, bytes([0x01, 0, 0, 0xFF, 0xFF, 0xFF, 7])),
            (0x2E3, bytes([0x20, 0xA1, 0x07, 0xE0, 0x5E, 0xF8, 7])),
            (0x3E3, bytes([0x40, 0x42, 0x0F, 0xC0, 0xBD, 0xF0, 7])),
            (0x4E3, bytes([0xC0, 0xC6, 0x2D, 0x40, 0x39, 0xD2, 7])),
        ],
    ),
    (
        PLANNER_STATE,
        PlannerState(PlannerPhase.EXECUTING, 1, Restriction.JOINT_8 | Restriction.COLLISION, 1.0, 0),
        [(0x182, struct.pack("<BBHHB", 5, 1, 0x8080, 65535, 0))],
    ),
    (
        REFERENCE,
        ReferencePose(np.array([2e-6, -2e-6, 1.5]), np.array([1e-4, -1e-4, math.pi]), True, 0xABCD, 9),
        [
            (0x282, i24(1, -1) + b"\x09"),
            (0x382, i24(750_000) + b"\x01\xcd\xab\x09"),
            (0x482, struct.pack("<hhhB", 1, -1, 31416, 9)),
        ],
    ),
    (
        WRENCH,
        Wrench(np.array([10.0, -10.0, 0.01, 1.0, -1.0, 0.001]), 2),
        [(0x19F, struct.pack("<hhhB", 1000, -1000, 1, 2)), (0x29F, struct.pack("<hhhB", 1000, -1000, 1, 2))],
    ),
    (
        TRACKED_POSE,
        TrackedPose(np.array([1.0, -1.0, 0.5]), np.array([0.1, 0.2, 0.3]), 12_340_000, 3),
        [
            (0x1A0, i24(500_000, -500_000) + b"\x03"),
            (0x2A0, i24(250_000) + b"\x01" + struct.pack("<HB", 1234, 3)),
            (0x3A0, struct.pack("<hhhB", 1000, 2000, 3000, 3)),
        ],
    ),
    (GRIPPER_STATE, GripperState(GripperPhase.HOLDING, 7), [(0x1A1, b"\x02" + bytes(5) + b"\x07")]),
]
NAMES = [codec.message_type.__name__ for codec, _, _ in LAYOUTS]


@pytest.mark.parametrize(("codec", "message", "expected"), LAYOUTS, ids=NAMES)
def test_bytes_are_those_of_the_bus_description(codec, message, expected):
    frames, was_limited = codec.encode(message)
    assert frames == [(can_id, sealed(can_id, payload)) for can_id, payload in expected]
    assert not was_limited


@pytest.mark.parametrize(("codec", "message", "expected"), LAYOUTS, ids=NAMES)
def test_messages_are_put_together_in_any_order_of_their_frames(codec, message, expected):
    frames = [(can_id, sealed(can_id, payload)) for can_id, payload in expected]
    for order in (frames, frames[::-1]):
        *before, last = feed(codec, order)
        assert before == [None] * (len(order) - 1)
        assert same(last, message)


def feed(codec, frames):
    assembler = codec.assembler()
    return [assembler.feed(*frame) for frame in frames]


def same(a, b) -> bool:
    fields = type(b).__dataclass_fields__
    return type(a) is type(b) and all(np.allclose(getattr(a, f), getattr(b, f), rtol=0, atol=5.1e-5) for f in fields)


@given(st.lists(st.floats(-1.6, 1.6), min_size=6, max_size=6), st.integers(0, 255))
def test_a_twist_comes_back_within_half_a_unit_of_the_wire(values, counter):
    frames, was_limited = TWIST.encode(TwistCommand(np.array(values), counter))
    message = feed(TWIST, frames)[-1]
    assert not was_limited
    assert message.counter == counter
    assert np.all(np.abs(message.twist[:3] - values[:3]) <= 25e-6 * (1 + 1e-9))
    assert np.all(np.abs(message.twist[3:] - values[3:]) <= 50e-6 * (1 + 1e-9))


@given(st.integers(0, 5), st.sampled_from([-1.0, 1.0]))
def test_a_value_that_the_wire_cannot_carry_is_limited_and_reported(axis, sign):
    twist = np.zeros(6)
    twist[axis] = sign * 100.0
    frames, was_limited = TWIST.encode(TwistCommand(twist, 0))
    received = feed(TWIST, frames)[-1].twist
    assert was_limited
    raw = 32767 if sign > 0 else -32768
    assert received[axis] == pytest.approx(raw * (50e-6 if axis < 3 else 1e-4), rel=1e-12)
    assert np.count_nonzero(received) == 1


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_not_sent(value):
    with pytest.raises(InvalidValueError, match="vy"):
        TWIST.encode(TwistCommand(np.array([0, value, 0, 0, 0, 0]), 0))


def test_a_vector_of_the_wrong_length_is_not_sent():
    with pytest.raises(ValueError, match="5 entries; must be 6"):
        TWIST.encode(TwistCommand(np.zeros(5), 0))


def test_the_counter_wraps():
    frames, _ = TWIST.encode(TwistCommand(np.zeros(6), 256 + 4))
    assert feed(TWIST, frames)[-1].counter == 4


def test_path_scale_one_is_exactly_one():
    (frame,), _ = PLANNER_STATE.encode(PlannerState(PlannerPhase.IDLE, 0, Restriction.NONE, 1.0, 0))
    assert PLANNER_STATE.assembler().feed(*frame).path_scale == 1.0


@given(st.sampled_from([can_id for codec in MESSAGES for can_id in codec.can_ids]), st.binary(max_size=8))
def test_a_wrong_length_is_an_error_never_a_value(can_id, data):
    if len(data) < 8:
        with pytest.raises(WrongLengthError, match="must be 8"):
            Decoder(MESSAGES).feed(can_id, data)


@pytest.mark.parametrize(("codec", "message", "expected"), LAYOUTS, ids=NAMES)
def test_every_flipped_bit_is_a_wrong_checksum(codec, message, expected):
    for can_id, data in codec.encode(message)[0]:
        for bit in range(64):
            flipped = (int.from_bytes(data, "little") ^ 1 << bit).to_bytes(8, "little")
            with pytest.raises(WrongChecksumError):
                codec.assembler().feed(can_id, flipped)


def test_a_frame_under_another_identifier_is_a_wrong_checksum():
    (linear, angular), _ = TWIST.encode(TwistCommand(np.zeros(6), 0))
    with pytest.raises(WrongChecksumError):
        TWIST.assembler().feed(angular[0], linear[1])


def test_an_unknown_identifier_is_an_error():
    for reader in (Decoder(MESSAGES), TWIST.assembler()):
        with pytest.raises(UnknownFrameError, match="123h"):
            reader.feed(0x123, bytes(8))


def test_a_mode_or_phase_that_does_not_exist_is_an_error():
    with pytest.raises(InvalidValueError, match="mode = 6"):
        MISSION.assembler().feed(0x481, sealed(0x481, bytes([6, 0, 0, 0, 0, 0, 0])))
    with pytest.raises(InvalidValueError, match="gripper = 3"):
        MISSION.assembler().feed(0x481, sealed(0x481, bytes([4, 0, 3, 0, 0, 0, 0])))
    with pytest.raises(InvalidValueError, match="phase = 8"):
        PLANNER_STATE.assembler().feed(0x182, sealed(0x182, bytes([8, 0, 0, 0, 0, 0, 0])))


def test_halves_of_different_messages_are_never_mixed():
    old, _ = TWIST.encode(TwistCommand(np.full(6, 0.1), 1))
    new, _ = TWIST.encode(TwistCommand(np.full(6, 0.2), 2))
    assembler = TWIST.assembler()
    assert assembler.feed(*old[0]) is None
    assert assembler.feed(*new[1]) is None
    assert assembler.incomplete == 1
    assert np.allclose(assembler.feed(*new[0]).twist, 0.2)


def test_a_damaged_frame_leaves_no_trace():
    frames, _ = TWIST.encode(TwistCommand(np.full(6, 0.1), 1))
    assembler = TWIST.assembler()
    assert assembler.feed(*frames[0]) is None
    with pytest.raises(CodecError):
        assembler.feed(frames[0][0], bytes(8))
    assert assembler.feed(*frames[1]) is not None


def test_a_tracker_that_sees_nothing_gives_no_pose():
    assembler = TRACKED_POSE.assembler()
    frames = [(0x1A0, i24(1, 1) + b"\x01"), (0x2A0, i24(1) + b"\x00\x00\x00\x01"), (0x3A0, bytes(6) + b"\x01")]
    assert [assembler.feed(can_id, sealed(can_id, payload)) for can_id, payload in frames] == [None] * 3
    assert assembler.incomplete == 0


def test_every_fast_frame_of_the_catalogue_has_a_codec():
    table = devices()
    fast = {pdo.cob_id for node_id in (1, 2, 31, 32, 33) for pdo in table[node_id].pdos}
    assert set(Decoder(MESSAGES).can_ids) == fast
