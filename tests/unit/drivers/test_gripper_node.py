"""The gripper on the bus: takes what the mission frame asks while it is operational, and says what has come of it."""

from __future__ import annotations

import pytest

from drivers.bus.lockstep import LockstepBus
from drivers.catalogue import devices
from drivers.checksum import crc8_j1850
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.gripper_node import GripperNode
from stack.messages import Gripper, GripperPhase


class Fingers:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.phase = GripperPhase.OPEN
        self.told: list[Gripper] = []

    def command(self, asked: Gripper) -> None:
        self.told.append(asked)


class Bench:
    """One gripper node and a port that plays everybody else."""

    def __init__(self) -> None:
        self.clock = LockstepClock()
        self.bus = LockstepBus(self.clock, 1_000_000)
        self.frames: list[Frame] = []
        self.counter = 16
        self.port = self.bus.attach("bench", None, self.frames.append)
        self.fingers = Fingers()
        self.node = GripperNode(devices()[33], self.clock, self.bus, self.fingers)
        self.node.node.power_on()
        self.run()

    def run(self) -> None:
        self.clock.run_until(self.clock.now_ns() + 5_000_000)

    def send(self, can_id: int, data: bytes) -> None:
        self.port.send(can_id, data)
        self.run()

    def start(self) -> None:
        self.send(0x000, bytes([1, 33]))

    def mission(self, gripper: int, checksum: int | None = None) -> None:
        self.counter += 1
        body = bytes([4, 0, gripper, 0, 0, 0, self.counter])
        good = crc8_j1850(bytes([0x81, 0x04]) + body)
        self.send(0x481, body + bytes([good if checksum is None else checksum]))

    def sent(self, can_id: int) -> list[bytes]:
        return [frame.data for frame in self.frames if frame.can_id == can_id]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_it_boots_and_waits_to_be_started(bench: Bench) -> None:
    assert bench.sent(0x721) == [b"\x00"]
    bench.mission(2)
    bench.send(0x080, b"")
    assert bench.fingers.told == []
    assert bench.sent(0x1A1) == []


def test_open_and_close_are_passed_on_and_keep_is_not(bench: Bench) -> None:
    bench.start()
    for asked in (0, 2, 0, 1):
        bench.mission(asked)
    assert bench.fingers.told == [Gripper.CLOSE, Gripper.OPEN]


def test_what_is_no_command_is_left_alone(bench: Bench) -> None:
    bench.start()
    bench.mission(3)
    bench.mission(2, checksum=0)
    bench.send(0x481, b"\x04\x00\x02")
    assert bench.fingers.told == []


def test_every_second_sync_carries_the_state_counter_and_checksum(bench: Bench) -> None:
    bench.start()
    for phase in GripperPhase:
        bench.fingers.phase = phase
        bench.send(0x080, b"")
        bench.send(0x080, b"")
    frames = bench.sent(0x1A1)
    assert [frame[0] for frame in frames] == [0, 1, 2, 3]
    assert [frame[6] for frame in frames] == [2, 4, 6, 8]
    for frame in frames:
        assert len(frame) == 8
        assert frame[1:6] == bytes(5)
        assert frame[7] == crc8_j1850(bytes([0xA1, 0x01]) + frame[:7])
