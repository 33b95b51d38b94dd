"""Vectorised decoding of process data: bytes written by hand from the bus description, and laws against the drivers' codecs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.checksum import frame_checksum, start_value
from drivers.drive_codec import DriveCodec
from drivers.frame import Frame
from drivers.objects import DataType, PdoKind
from logs.frame_batch import FrameBatch, PdoLayout, checksum_ok, pdo_layouts
from stack.messages import DriveFeedback
from tests.unit.logs.synthetic_run import DEVICES

LAYOUTS = pdo_layouts(DEVICES.values())


def _payload(*rows: bytes) -> np.ndarray:
    return FrameBatch.of([Frame(0x123, row, 0) for row in rows]).payload


def test_signed_24_bit_values_of_the_reference_frame() -> None:
    layout = LAYOUTS[2, PdoKind.TPDO, 2]
    # x = -1 count, y = +2^23 - 1 counts of 2 µm, counter 7
    data = bytes.fromhex("ffffff ffff7f 07 00")
    values = layout.values(_payload(data), (0, 1, 2))
    assert values.tolist() == [[-2e-6, pytest.approx((2**23 - 1) * 2e-6), 7.0]]


def test_feedback_of_a_drive_in_si_units() -> None:
    layout = LAYOUTS[21, PdoKind.TPDO, 1]
    # statusword 1237h, position -1 000 000 µrad, torque 250 per mille of the rated 100 N·m
    values = layout.values(_payload(bytes.fromhex("3712 c0bdf0ff fa00")), (0, 1, 2))
    np.testing.assert_allclose(values, [[0x1237, -1.0, 25.0]])


def test_the_lift_counts_micrometres_and_newtons() -> None:
    layout = LAYOUTS[22, PdoKind.TPDO, 1]
    values = layout.values(_payload(bytes.fromhex("3712 f0490200 0a00")), (1, 2))
    np.testing.assert_allclose(values, [[0.15, 5.0]])


@given(st.floats(-30, 30), st.floats(-150, 150), st.integers(0, 0xFFFF))
def test_any_feedback_reads_as_the_drive_codec_reads_it(position: float, effort: float, word: int) -> None:
    codec = DriveCodec(DEVICES[23])
    data, _ = codec.encode_feedback(DriveFeedback(word, position, effort))
    expected = codec.decode_feedback(data)
    values = LAYOUTS[23, PdoKind.TPDO, 1].values(_payload(data), (0, 1, 2))[0]
    np.testing.assert_allclose(values, [expected.statusword, expected.position, expected.effort], rtol=1e-12)


@given(st.integers(0, 0x7FF), st.binary(min_size=8, max_size=8), st.integers(0, 63))
def test_checksums_agree_with_those_of_the_sender(can_id: int, data: bytes, flipped: int) -> None:
    good = data[:7] + bytes([frame_checksum(start_value(can_id), data[:7])])
    bad = (int.from_bytes(good, "little") ^ 1 << flipped).to_bytes(8, "little")
    assert checksum_ok(can_id, _payload(good, bad)).tolist() == [True, False]


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 2**40)), max_size=20))
def test_a_batch_holds_its_frames(rows: list[tuple[int, bytes, int]]) -> None:
    batch = FrameBatch.of([Frame(*row) for row in rows])
    back = [
        (can_id, bytes(data[:length]), t_ns)
        for can_id, t_ns, length, data in zip(
            batch.can_id.tolist(), batch.t_ns.tolist(), batch.length.tolist(), batch.payload, strict=True
        )
    ]
    assert back == rows


def test_frames_of_another_length_are_not_read_as_this_one() -> None:
    batch = FrameBatch.of([Frame(0x195, b"\0" * 8), Frame(0x195, b"\0" * 4)])
    assert batch.rows(0x195, 8).tolist() == [0]


@pytest.mark.parametrize(("kind", "value"), [(DataType.REAL32, -1.5), (DataType.REAL64, 1e-3)])
def test_floating_point_objects(kind: DataType, value: float) -> None:
    layout = PdoLayout(0x181, 8, ("x",), (0,), (kind,), (1.0,))
    data = np.array([value], "<f4" if kind is DataType.REAL32 else "<f8").tobytes()
    assert layout.values(_payload(data), (0,))[0, 0] == value
