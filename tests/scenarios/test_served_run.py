"""`canipulator run --serve`: tools watch a lockstep run and may act on it; the run is the same as without them."""

import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from drivers.frame import Frame
from logs.bus_log import read_bus_log

pytestmark = pytest.mark.slow
PATIENCE_S = 60.0


@contextlib.contextmanager
def served(out: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A run of `hold-still` that is served on a port of its own: (process, port)."""
    command = ["run", "hold-still", "--no-rerun", "--json", "--out", str(out), "--serve", "0", *options]
    process = subprocess.Popen(
        [sys.executable, "-m", "canipulator", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stderr is not None
        announced = process.stderr.readline()
        assert announced.startswith("tools: socketcand on 127.0.0.1:"), announced
        yield process, int(announced.split("127.0.0.1:")[1].split(",")[0])
    finally:
        process.kill()
        process.communicate()


def watch(port: int) -> can.BusABC:
    return can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=port)


def everything(bus: can.BusABC, process: subprocess.Popen[str]) -> list[Frame]:
    """All frames until the run ends."""
    found = []
    deadline = time.monotonic() + PATIENCE_S
    while (message := bus.recv(0.2)) is not None or process.poll() is None:
        assert time.monotonic() < deadline
        if message is not None:
            found.append(Frame(message.arbitration_id, bytes(message.data), round(message.timestamp * 1e6) * 1000))
    return found


def test_served_without_a_client_the_log_is_the_same(tmp_path: Path) -> None:
    plain = ["run", "hold-still", "--no-rerun", "--json", "--duration", "1.5", "--out", str(tmp_path / "plain")]
    subprocess.run([sys.executable, "-m", "canipulator", *plain], check=True, capture_output=True)
    with served(tmp_path / "served", "--duration", "1.5", "--allow-inject", "--pace", "3") as (process, _):
        assert process.wait(PATIENCE_S) == 0
    assert (tmp_path / "served" / "bus.log").read_bytes() == (tmp_path / "plain" / "bus.log").read_bytes()


def test_a_client_sees_what_the_log_holds_and_the_run_is_the_same(tmp_path: Path) -> None:
    with served(tmp_path / "a", "--duration", "2") as (process, port), watch(port) as bus:
        seen = everything(bus, process)
    log = list(read_bus_log(tmp_path / "a" / "bus.log"))
    start = log.index(seen[0])
    assert start < len(log) / 2
    assert seen == log[start:]
    with served(tmp_path / "b", "--duration", "2", "--pace", "5") as (process, _):
        assert process.wait(PATIENCE_S) == 0
    assert (tmp_path / "a" / "bus.log").read_bytes() == (tmp_path / "b" / "bus.log").read_bytes()


def test_pace(tmp_path: Path) -> None:
    """Held back to twice real time, whatever the machine could do; never faster."""
    began = time.monotonic()
    with served(tmp_path / "run", "--duration", "1", "--pace", "0.5") as (process, _):
        began = time.monotonic()
        assert process.wait(PATIENCE_S) == 0
    assert time.monotonic() - began >= 1.9


def test_a_quick_stop_from_a_tool_stops_the_drive(tmp_path: Path) -> None:
    """Controlword 0002h in an RPDO1 of the first joint: its statusword leaves `operation enabled`."""
    with served(tmp_path / "run", "--allow-inject") as (process, port), watch(port) as bus:
        enabled = False
        deadline = time.monotonic() + PATIENCE_S
        position = 0
        while True:
            assert time.monotonic() < deadline
            assert process.poll() is None
            message = bus.recv(1.0)
            if message is None or message.arbitration_id != 0x195:
                continue
            status = int.from_bytes(message.data[:2], "little") & 0x6F
            position = int.from_bytes(message.data[2:6], "little")
            if not enabled and status == 0x27:
                enabled = True
                stop = (0x0002).to_bytes(2, "little") + position.to_bytes(4, "little") + bytes(2)
                for _ in range(20):  # the planner sends its own every 10 ms
                    bus.send(can.Message(arbitration_id=0x215, data=stop, is_extended_id=False))
            elif enabled and status != 0x27:
                break
    assert any(f.can_id == 0x215 and f.data[:2] == b"\x02\x00" for f in read_bus_log(tmp_path / "run" / "bus.log"))


def test_nonsense_from_a_tool_does_not_break_the_run(tmp_path: Path) -> None:
    """Frames of every identifier with wrong lengths: nodes and recorder have to live with them."""
    with served(tmp_path / "run", "--allow-inject", "--duration", "4") as (process, port), watch(port) as bus:
        for can_id in range(0x081, 0x800, 3):
            bus.send(can.Message(arbitration_id=can_id, data=bytes(can_id % 9), is_extended_id=False))
        everything(bus, process)
        assert process.returncode == 0, process.communicate()[1]


def test_a_port_that_is_taken_is_known_before_anything_is_written(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        command = ["run", "hold-still", "--out", str(tmp_path / "run"), "--serve", str(port)]
        done = subprocess.run(
            [sys.executable, "-m", "canipulator", *command], capture_output=True, text=True, check=False
        )
    assert done.returncode == 2
    assert (
        done.stderr
        == f"canipulator: port {port} of 127.0.0.1: Address already in use; choose another one, or 0 for any\n"
    )
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["attach", "--bus", "lockstep"], "run SCENARIO --serve"),
        (["attach", "--bus", "vcan0"], "must be interface:channel"),
        (["attach", "--bus", "nothing:can0"], "nothing:can0 cannot be opened"),
        (["run", "hold-still", "--allow-inject"], "--allow-inject: only together with --serve"),
        (["run", "hold-still", "--pace", "2"], "--pace: only together with --serve"),
        (["run", "hold-still", "--serve", "--pace", "-1"], "--pace -1: must be a positive"),
        (["run", "hold-still", "--serve", "65536"], "port 65536"),
        (["run", "semi-algorithmic", "--serve"], "kinematic scenario, it has no bus"),
    ],
)
def test_what_cannot_be_served_is_explained(arguments: list[str], complaint: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "canipulator", *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert complaint in done.stderr
    assert done.stderr.startswith("canipulator: ")
    assert done.stderr.count("\n") == 1
