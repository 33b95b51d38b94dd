"""Sequences side by side: steps, what they give back, how they fail; against a real SDO server on the lockstep bus."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.lockstep import LockstepBus
from drivers.canopen.node import CanopenNode
from drivers.canopen.sdo_abort import SdoAborted, StepError
from drivers.canopen.sdo_client import SdoClient
from drivers.canopen.sequence import Delay, Download, Sequence, SequenceFailure, Sequencer, Until, Upload
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.objects import Access, DataType, DeviceDef, ObjectDef

MS = 1_000_000
NODE = 5


class Bench:
    """One device with a real SDO server, and a sequencer that talks to it."""

    def __init__(self) -> None:
        self.clock = LockstepClock()
        bus = LockstepBus(self.clock)
        objects = (
            ObjectDef(0x2000, 0, "Level", DataType.INTEGER16, low=-100, high=100),
            ObjectDef(0x2001, 0, "Gain", DataType.REAL32, default=0.5),
            ObjectDef(0x2002, 0, "Label", DataType.VISIBLE_STRING, default=""),
            ObjectDef(0x2003, 0, "Serial", DataType.UNSIGNED32, Access.RO, 7),
        )
        device = DeviceDef("device", NODE, objects)
        self.types = {entry.key: entry.data_type for entry in objects}
        self.node = CanopenNode(device, self.clock, bus)
        self.node.power_on()
        self.sequencer = Sequencer(self.clock)
        port = bus.attach("client", [0x580 + NODE], self._on_frame)
        self.client = SdoClient(NODE, port.send, self.clock, timeout_ns=10 * MS, attempts=2)
        self.results: list[Any] = []
        self.failures: list[SequenceFailure] = []

    def _on_frame(self, frame: Frame) -> None:
        self.client.on_frame(frame)
        self.sequencer.poll()

    def run(self, sequence: Sequence[Any], milliseconds: float = 1000.0) -> None:
        self.sequencer.start(
            self.client, "trial", sequence, self.results.append, self.failures.append, data_types=self.types
        )
        self.clock.run_until(self.clock.now_ns() + round(milliseconds * MS))


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_values_go_there_and_come_back_with_their_types(bench: Bench) -> None:
    def steps() -> Sequence[tuple[Any, ...]]:
        yield Download(0x2000, 0, -42)
        yield Download(0x2001, 0, -1.5)
        yield Download(0x2002, 0, "a label of more than seven letters")
        level = yield Upload(0x2000, 0)
        gain = yield Upload(0x2001, 0)
        label = yield Upload(0x2002, 0)
        untyped = yield Upload(0x1017, 0)
        return level, gain, label, untyped

    bench.run(steps())
    assert bench.results == [(-42, -1.5, "a label of more than seven letters", 0)]
    assert bench.failures == []


@settings(max_examples=30, deadline=None)
@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=60))
def test_text_of_any_length_survives_segmentation(text: str) -> None:
    bench = Bench()

    def steps() -> Sequence[str]:
        yield Download(0x2002, 0, text)
        return (yield Upload(0x2002, 0))

    bench.run(steps())
    assert bench.results == [text]


def test_an_abort_names_node_step_expectation_and_code(bench: Bench) -> None:
    def steps() -> Sequence[None]:
        yield Delay(MS)
        yield Download(0x2000, 0, 101)

    bench.run(steps())
    (failure,) = bench.failures
    assert bench.results == []
    assert (failure.node_id, failure.sequence, failure.code) == (NODE, "trial", 0x0609_0031)
    assert failure.step == "write 0x65 to 2000h sub 0"
    assert "written too high" in failure.came
    assert "2000h sub 0" in failure.expected


def test_a_sequence_may_catch_an_abort_and_go_on(bench: Bench) -> None:
    def steps() -> Sequence[str]:
        try:
            yield Download(0x2003, 0, 8)
        except SdoAborted as error:
            return error.text
        return "written"

    bench.run(steps())
    assert bench.results == ["attempt to write a read-only object"]


def test_wrong_length_is_a_failure_not_a_number(bench: Bench) -> None:
    def steps() -> Sequence[int]:
        return (yield Upload(0x2000, 0, DataType.UNSIGNED32))

    bench.run(steps())
    (failure,) = bench.failures
    assert "UNSIGNED32" in failure.expected
    assert bench.results == []


def test_a_dead_server_ends_the_sequence(bench: Bench) -> None:
    bench.node.power_off()

    def steps() -> Sequence[int]:
        return (yield Upload(0x2003, 0))

    bench.run(steps(), 19)
    assert bench.failures == []
    bench.clock.run_until(bench.clock.now_ns() + 2 * MS)
    (failure,) = bench.failures
    assert failure.came == "none, 2 times"


def test_until_holds_at_once_later_or_never(bench: Bench) -> None:
    flag: list[bool] = []

    def steps() -> Sequence[str]:
        yield Until(lambda: True, 0, "what is there")
        yield Until(lambda: bool(flag), 100 * MS, "the flag")
        try:
            yield Until(lambda: False, 50 * MS, "the impossible", lambda: "something else")
        except StepError as error:
            return f"{error.expected}, {error.came}"
        return ""

    bench.clock.call_at(bench.clock.now_ns() + 30 * MS, lambda: flag.append(True))
    bench.clock.call_at(bench.clock.now_ns() + 40 * MS, bench.sequencer.poll)
    start_ns = bench.clock.now_ns()
    bench.run(steps(), 89)
    assert bench.results == []  # 40 ms until the poll, 50 ms of the impossible
    bench.clock.run_until(start_ns + 90 * MS)
    assert bench.results == ["the impossible within 50 ms, something else"]


def test_many_sequences_share_one_client_in_order(bench: Bench) -> None:
    def steps(value: int) -> Sequence[int]:
        yield Download(0x2000, 0, value)
        return value

    for value in range(20):
        bench.run(steps(value), 0)
    bench.clock.run_until(100 * MS)
    assert bench.results == list(range(20))
    assert bench.node.dictionary.get(0x2000) == 19


def test_a_cancelled_sequence_never_ends(bench: Bench) -> None:
    cleaned: list[bool] = []

    def steps() -> Sequence[None]:
        try:
            yield Delay(10 * MS)
            yield Until(lambda: False, 10 * MS, "nothing")
        finally:
            cleaned.append(True)

    for cancel_after_ms in (5, 15):
        run = bench.sequencer.start(bench.client, "trial", steps(), bench.results.append, bench.failures.append)
        bench.clock.run_until(bench.clock.now_ns() + cancel_after_ms * MS)
        run.cancel()
        bench.sequencer.poll()
        bench.clock.run_until(bench.clock.now_ns() + 100 * MS)
    assert (bench.results, bench.failures, cleaned) == ([], [], [True, True])


def test_a_programming_error_is_not_taken_for_a_failure_of_the_device(bench: Bench) -> None:
    def steps() -> Sequence[None]:
        yield Download(0x2F00, 0, 1)

    with pytest.raises(KeyError, match="write 0x1 to 2F00h sub 0: its data type is not known"):
        bench.run(steps())
