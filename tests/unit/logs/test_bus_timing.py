"""Load by class, time after SYNC, and how evenly SYNC comes: on frames whose answer is known."""

from __future__ import annotations

import numpy as np

from drivers.frame import Frame, bit_length
from logs.bus_timing import ANSWERING, CLASSES, after_sync, classes, sync_error
from logs.decoder import SignalDecoder
from logs.frame_batch import FrameBatch
from logs.tape import Block
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS

CLASS_OF = classes(DEVICES.values())


def test_every_sender_has_its_class() -> None:
    named = {can_id: CLASSES[CLASS_OF[can_id]] for can_id in (0x199, 0x29C, 0x219, 0x20B, 0x182, 0x4E2, 0x181, 0x481)}
    assert named == {
        0x199: "feedback",
        0x29C: "feedback",
        0x219: "set points",
        0x20B: "set points",
        0x182: "planner",
        0x4E2: "planner",
        0x181: "strategic",
        0x481: "strategic",
    }
    assert CLASSES[CLASS_OF[0x19F]] == CLASSES[CLASS_OF[0x1A0]] == "sensors"
    assert {CLASSES[CLASS_OF[can_id]] for can_id in (0, 0x080, 0x099, 0x582, 0x602, 0x702)} == {"services"}


def test_the_last_frame_of_a_class_counts_and_a_missing_class_is_unknown() -> None:
    frames = [Frame(0x080, b"", 0), Frame(0x199, bytes(8), 700_000), Frame(0x19A, bytes(8), 900_000)]
    frames += [Frame(0x080, b"", PERIOD_NS), Frame(0x219, bytes(8), PERIOD_NS + 2_500_000)]
    batch = FrameBatch.of(frames)
    found = after_sync(batch, CLASS_OF, np.array([0, 0, 0, 1, 1]), batch.sync_times())
    feedback, set_points = ANSWERING.index("feedback"), ANSWERING.index("set points")
    assert abs(found.values[0, feedback] - 900e-6) < 1e-12
    assert abs(found.values[1, set_points] - 2.5e-3) < 1e-12
    assert np.isnan(found.values[1, feedback])
    assert np.isnan(found.values[0, set_points])


def test_sync_that_is_late_is_late_once_and_early_after() -> None:
    found = sync_error(np.array([PERIOD_NS + 300_000, 2 * PERIOD_NS]), 0, PERIOD_NS)
    assert found is not None
    np.testing.assert_allclose(found.values[:, 0], [300e-6, -300e-6])
    assert sync_error(np.array([5]), None, PERIOD_NS) is None


def test_the_classes_add_up_to_the_load() -> None:
    frames = [Frame(0x080, b"", k * PERIOD_NS) for k in range(30)]
    frames += [Frame(0x199, bytes(8), k * PERIOD_NS + 500_000) for k in range(30)]
    frames.sort(key=lambda frame: frame.t_ns)
    decoder = SignalDecoder(DEVICES.values(), sync_period_ns=PERIOD_NS, wheel_radius=0.1, track=0.4)
    signals = decoder.decode(Block(frames, [], []), last=True).signals
    by_class, load = signals["bus/load_by_class"].values, signals["bus/load"].values
    np.testing.assert_allclose(by_class.sum(axis=1), load[:, 0])
    wanted = 10 * bit_length(0x199, bytes(8)) / 100_000
    np.testing.assert_allclose(by_class[:, CLASSES.index("feedback")], wanted)
