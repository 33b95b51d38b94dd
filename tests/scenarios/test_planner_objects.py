"""The planner's dictionary in mid-motion, by raw SDO frames of a stranger on the bus (bytes after CiA 301, 7.2.4.3)."""

import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from canipulator.run import LockstepRun, RunOptions
from config.load import load_scenario
from config.robot import load_robot
from drivers.frame import Frame
from stack.messages import PlannerPhase
from stack.planner.parameters import Method

pytestmark = pytest.mark.slow


class Stranger:
    """An SDO client made of nothing but frames."""

    def __init__(self, run: LockstepRun) -> None:
        self.run = run
        self.answers: list[bytes] = []
        self.port = run.bus.attach("stranger", [0x582], self._on_frame)

    def _on_frame(self, frame: Frame) -> None:
        self.answers.append(frame.data)

    def ask(self, request: str) -> bytes:
        """The answer to a request of 8 bytes in hex, waited for in virtual time."""
        self.answers.clear()
        self.port.send(0x602, bytes.fromhex(request))
        self.run.clock.run_until(self.run.clock.now_ns() + 20_000_000)
        assert len(self.answers) == 1
        return self.answers[0]

    def read_float(self, index: int, subindex: int) -> float:
        answer = self.ask((b"\x40" + struct.pack("<HB", index, subindex) + bytes(4)).hex())
        assert answer[:4] == b"\x43" + struct.pack("<HB", index, subindex)
        return struct.unpack("<f", answer[4:])[0]

    def write_float(self, index: int, subindex: int, value: float) -> None:
        answer = self.ask((b"\x23" + struct.pack("<HBf", index, subindex, value)).hex())
        assert answer == b"\x60" + struct.pack("<HB", index, subindex) + bytes(4)


@pytest.fixture
def moving(tmp_path: Path) -> Iterator[tuple[LockstepRun, Stranger]]:
    """Four seconds into the sliding-door task."""
    scenario = load_scenario("sliding-door")
    with LockstepRun(scenario, load_robot(scenario.robot), RunOptions(record=False, quiet=True), tmp_path) as run:
        stranger = Stranger(run)
        run.power_on()
        run.clock.run_until(4_000_000_000)
        assert run.planner.phase is PlannerPhase.EXECUTING
        yield run, stranger


def test_state_configuration_and_pose_are_read(moving: tuple[LockstepRun, Stranger]) -> None:
    run, stranger = moving
    assert stranger.ask("40 03 20 00 00 00 00 00") == bytes.fromhex("4F 03 20 00 05 00 00 00")
    truth = run.sim.world.truth(0)
    for i in range(8):
        assert stranger.read_float(0x2020, i + 1) == pytest.approx(
            truth.q[i], abs=0.05
        )  # read one after the other, in motion
    truth = run.sim.world.truth(0)
    position = [stranger.read_float(0x2021, i + 1) for i in range(3)]
    assert position == pytest.approx(truth.pose_WE[:3, 3], abs=0.03)  # asked one after the other, while it moves


def test_method_is_changed_in_mid_motion_without_leaving_the_path(moving: tuple[LockstepRun, Stranger]) -> None:
    run, stranger = moving
    assert stranger.ask("2F 01 20 00 02 00 00 00") == bytes.fromhex("60 01 20 00 00 00 00 00")
    assert stranger.ask("40 01 20 00 00 00 00 00") == bytes.fromhex("4F 01 20 00 02 00 00 00")
    assert run.planner.parameters.method is Method.GRADIENT
    run.clock.run_until(6_000_000_000)
    run.log.close()
    assert run.metrics(judged=False).tcp_error_max_m < 0.006


def test_a_new_preferred_lift_height_raises_the_lift(moving: tuple[LockstepRun, Stranger], tmp_path: Path) -> None:
    run, stranger = moving
    height = float(run.sim.world.truth(0).q[1])
    stranger.write_float(0x2010, 2, height + 0.2)
    stranger.write_float(0x2011, 2, 0.2)
    stranger.write_float(0x2013, 2, 20.0)
    assert stranger.read_float(0x2010, 2) == pytest.approx(height + 0.2, abs=1e-6)
    run.clock.run_until(8_000_000_000)
    run.log.close()
    assert run.sim.world.truth(0).q[1] > height + 0.1
    assert run.metrics(judged=False).tcp_error_max_m < 0.006, "the TCP must not notice"


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("2F 01 20 00 09 00 00 00", "80 01 20 00 31 00 09 06"),  # method 9: value too high
        ("2F 03 20 00 01 00 00 00", "80 03 20 00 02 00 01 06"),  # phase: read-only
        ("40 FF 2F 00 00 00 00 00", "80 FF 2F 00 00 00 02 06"),  # no such object
        ("40 11 20 0B 00 00 00 00", "80 11 20 0B 11 00 09 06"),  # no such subindex
        ("23 11 20 01 00 00 C0 7F", "80 11 20 01 30 00 09 06"),  # a height that is not a number
        ("23 13 20 01 00 00 00 00", "80 13 20 01 32 00 09 06"),  # a weight of zero: too low
        ("23 12 20 01 00 00 80 BF", "80 12 20 01 32 00 09 06"),  # a negative width
    ],
)
def test_what_may_not_be_written_is_refused(moving: tuple[LockstepRun, Stranger], request_: str, answer: str) -> None:
    run, stranger = moving
    assert stranger.ask(request_) == bytes.fromhex(answer)
    run.clock.run_until(4_500_000_000)
    assert run.planner.phase is PlannerPhase.EXECUTING
