"""The slip observer's frame, 4E4h: bytes worked out by hand, the DBC's view of it, and what the logs read off it."""

from pathlib import Path

import cantools
import numpy as np
import pytest

from drivers.catalogue import PLANNER_ID, devices
from drivers.codec import SLIP
from drivers.frame import Frame
from drivers.tables import slip as table
from logs.decoder import SignalDecoder
from logs.tape import Block
from stack.messages import SlipReport
from stack.planner.observer import SlipModel
from tests.bytes.test_singularity_frame import crc8_j1850

REPORT = SlipReport((0.0123, -0.02), 200, 3, 0x21)
PAYLOAD = bytes((0xCE, 0x04, 0x30, 0xF8, 200, 3, 0x21))  # 1230, -2000 in units of 1e-5
FRAME = PAYLOAD + bytes((crc8_j1850(bytes((0xE4, 0x04)) + PAYLOAD),))
DBC = Path(__file__).parents[2] / "config" / "bus" / "canipulator.dbc"


def test_bytes_on_the_wire() -> None:
    ((can_id, data),), limited = SLIP.encode(REPORT)
    assert (can_id, data, limited) == (0x4E4, FRAME, False)
    back = SLIP.assembler().feed(can_id, FRAME)
    assert back is not None
    assert back.slip == pytest.approx(REPORT.slip)
    assert (back.measured, back.rejected, back.counter) == (200, 3, 0x21)


def test_the_dbc_reads_it() -> None:
    decoded = cantools.database.load_file(str(DBC)).decode_message(0x4E4, FRAME)
    assert decoded["slip_left"] == pytest.approx(0.0123)
    assert decoded["slip_right"] == pytest.approx(-0.02)
    assert (decoded["measured"], decoded["rejected"]) == (200, 3)


def test_the_model_is_in_the_dictionary_with_its_defaults() -> None:
    planner, model = devices()[PLANNER_ID], SlipModel()
    assert planner.object(0x1805, 1).default & 0x7FF == 0x4E4
    assert planner.object(table.SLIP_OBSERVER).default == 1
    for i, name in enumerate(("position_noise_m", "rotation_noise_rad", "sigma", "tau_s", "learning_s"), start=1):
        assert planner.object(0x2015, i).default == getattr(model, name)


def test_the_logs_have_it() -> None:
    bad = FRAME[:-1] + bytes((FRAME[-1] ^ 1,))  # a wrong checksum says nothing
    frames = [Frame(0x080, b"", 0), Frame(0x4E4, FRAME, 1_000), Frame(0x4E4, bad, 50_001_000)]
    decoder = SignalDecoder(devices().values(), sync_period_ns=10_000_000, wheel_radius=0.1, track=0.45)
    estimate = decoder.decode(Block(frames, [], []), last=True).signals["slip/estimate"]
    np.testing.assert_allclose(estimate.values, [[0.0123, -0.02, 200, 3]], atol=1e-9)
