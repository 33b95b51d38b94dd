"""The singularity monitor's frame, 4E2h: bytes worked out by hand, the DBC's view of it, and what the logs read off it."""

from pathlib import Path

import cantools
import numpy as np
import pytest

from drivers.catalogue import PLANNER_ID, devices
from drivers.codec import SINGULARITY
from drivers.frame import Frame
from drivers.frame_codec import CodecError
from drivers.tables import planner as table
from logs.decoder import SignalDecoder
from logs.tape import Block
from stack.kinematics import ArmModel
from stack.messages import SingularityKind, SingularityReport
from stack.planner.singularities import manifolds

REPORT = SingularityReport(SingularityKind.SEMI_ALGORITHMIC, 6, (1.0, 0.4, 0.2, 0.0), 0x11)
PAYLOAD = bytes((4, 6, 255, 102, 51, 0, 0x11))
DBC = Path(__file__).parents[2] / "config" / "bus" / "canipulator.dbc"


def crc8_j1850(data: bytes) -> int:
    """SAE J1850, bit by bit."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


FRAME = PAYLOAD + bytes((crc8_j1850(bytes((0xE2, 0x04)) + PAYLOAD),))


def test_bytes_on_the_wire() -> None:
    ((can_id, data),), limited = SINGULARITY.encode(REPORT)
    assert (can_id, data, limited) == (0x4E2, FRAME, False)
    back = SINGULARITY.assembler().feed(can_id, FRAME)
    assert (back.kind, back.manifold, back.counter) == (REPORT.kind, 6, 0x11)
    assert back.margins == pytest.approx(REPORT.margins)


def test_a_kind_without_a_meaning_is_refused() -> None:
    payload = bytes((9,)) + PAYLOAD[1:]
    with pytest.raises(CodecError, match="kind = 9"):
        SINGULARITY.assembler().feed(0x4E2, payload + bytes((crc8_j1850(bytes((0xE2, 0x04)) + payload),)))


def test_the_dbc_reads_it() -> None:
    decoded = cantools.database.load_file(str(DBC)).decode_message(0x4E2, FRAME)
    assert decoded["singularity_kind"] == "semi_algorithmic"
    assert decoded["nearest_manifold"] == "F2"
    assert decoded["margin_AS" if "margin_AS" in decoded else "margin_as"] == pytest.approx(0.4)


def test_the_dictionary_holds_it_in_full() -> None:
    planner = devices()[PLANNER_ID]
    assert planner.object(0x1804, 1).default & 0x7FF == 0x4E2
    assert planner.object(table.SINGULARITY_RADIUS).default == pytest.approx(0.1)
    names = [planner.object(table.MANIFOLD_MARGINS, i + 1).name for i in range(8)]
    arm = ArmModel.load("moma8")
    assert names == list(manifolds(arm, arm.home))


def test_the_logs_have_its_margins_and_a_lane_of_kinds() -> None:
    calm = SINGULARITY.encode(SingularityReport(SingularityKind.NONE, 1, (1.0, 1.0, 1.0, 1.0), 0))[0][0][1]
    frames = [Frame(0x080, b"", 0), Frame(0x4E2, calm, 1_000), Frame(0x4E2, FRAME, 50_001_000)]
    frames.append(Frame(0x4E2, FRAME[:-1] + bytes((FRAME[-1] ^ 1,)), 100_001_000))  # a wrong checksum says nothing
    decoder = SignalDecoder(devices().values(), sync_period_ns=10_000_000, wheel_radius=0.1, track=0.45)
    decoded = decoder.decode(Block(frames, [], []), last=True)
    margins = decoded.signals["singularity/margins"]
    np.testing.assert_allclose(margins.values, [[1, 1, 1, 1, 0, 1], [1, 0.4, 0.2, 0, 4, 6]], atol=1e-9)
    lane = [(c.t_ns, c.state) for c in decoded.states if c.lane == "planner/singularity"]
    assert lane == [(1_000, "none"), (50_001_000, "semi algorithmic")]
    assert decoded.counts["bad_checksums"] == 1
