"""The log of the bus: candump's format, complete lines, readable after a kill, harmless when the disk is full."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import LockstepClock
from drivers.frame import Frame
from logs.bus_log import BusLogError, BusLogWriter, parse_line, read_bus_log

FRAMES = [
    Frame(0x080, b"", 10_000_000),
    Frame(0x181, bytes.fromhex("1122AABB"), 1_234_567_891),
    Frame(0x7FF, bytes(range(8)), 12_345_678_901_234_000),
]
LINES = (
    "(0000000000.010000) can0 080#\n"
    "(0000000001.234567) can0 181#1122AABB\n"
    "(0012345678.901234) can0 7FF#0001020304050607\n"
)


def write_log(path: Path, frames: list[Frame]) -> None:
    with BusLogWriter(path) as writer:
        for frame in frames:
            writer(frame)


def test_lines_are_those_of_candump(tmp_path):
    write_log(tmp_path / "bus.log", FRAMES)
    assert (tmp_path / "bus.log").read_text() == LINES


def test_python_can_reads_it(tmp_path):
    write_log(tmp_path / "bus.log", FRAMES)
    with can.LogReader(tmp_path / "bus.log") as reader:
        messages = list(reader)
    assert [(m.arbitration_id, bytes(m.data), m.channel) for m in messages] == [
        (frame.can_id, frame.data, "can0") for frame in FRAMES
    ]
    assert not any(message.is_extended_id or message.is_remote_frame for message in messages)
    assert messages[1].timestamp == pytest.approx(1.234567, abs=1e-9)


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 10**9)), max_size=30))
def test_what_is_written_is_read(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("log") / "bus.log"
    t_us, frames = 0, []
    for can_id, data, step_us in rows:
        t_us += step_us
        frames.append(Frame(can_id, data, t_us * 1000))
    write_log(path, frames)
    assert list(read_bus_log(path)) == frames


def test_no_line_waits_longer_than_two_milliseconds_of_bus_time(tmp_path):
    clock = LockstepClock()
    writer = BusLogWriter(tmp_path / "bus.log", clock=clock)
    clock.call_at(1_000_000, lambda: writer(Frame(0x80, b"", clock.now_ns())))
    clock.call_at(2_000_000, lambda: writer(Frame(0x81, b"", clock.now_ns())))
    clock.run_until(2_999_999)
    assert (tmp_path / "bus.log").read_text() == ""
    clock.run_until(3_000_000)  # and no further frame
    assert (tmp_path / "bus.log").read_text().count("\n") == 2
    writer.close()


def test_only_whole_lines_are_ever_in_the_file(tmp_path):
    path = tmp_path / "bus.log"
    writer = BusLogWriter(path)
    for i in range(2000):
        writer(Frame(0x181, bytes(8), i * 130_000))
        text = path.read_text() if i % 97 == 0 else ""
        assert text == "" or text.endswith("\n")
    assert path.read_text().count("\n") >= 1950  # 5 ms are 39 of these frames
    writer.close()
    assert path.read_text().count("\n") == 2000


KILLED = """
import os, sys
from pathlib import Path
from drivers.frame import Frame
from logs.bus_log import BusLogWriter
writer = BusLogWriter(Path(sys.argv[1]))
for i in range(10_000):
    writer(Frame(0x181, bytes(8), i * 130_000))
os.kill(os.getpid(), 9)
"""


def test_a_killed_run_leaves_a_readable_log(tmp_path):
    path = tmp_path / "bus.log"
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    ended = subprocess.run([sys.executable, "-c", KILLED, str(path)], env=environment, check=False, cwd=root)
    assert ended.returncode == -signal.SIGKILL
    assert len(list(read_bus_log(path))) >= 10_000 - 40


def test_a_full_disk_is_reported_once_and_never_raised():
    reports: list[OSError] = []
    writer = BusLogWriter(Path("/dev/full"), on_error=reports.append)
    for i in range(1000):
        writer(Frame(0x181, bytes(8), i * 1_000_000))
    writer.close()
    writer.close()
    assert [error.errno for error in reports] == [28]
    assert writer.error is reports[0]
    assert writer.frames == 0


def test_a_last_line_without_its_end_is_left_out(tmp_path):
    path = tmp_path / "bus.log"
    path.write_text(LINES + "(0012345679.000000) can0 18")
    assert list(read_bus_log(path)) == [frame._replace(t_ns=frame.t_ns // 1000 * 1000) for frame in FRAMES]


def test_one_channel_of_several(tmp_path):
    path = tmp_path / "bus.log"
    path.write_text("(0000000000.000001) can0 080#\n(0000000000.000002) can1 081#\n")
    assert [frame.can_id for frame in read_bus_log(path)] == [0x80, 0x81]
    assert [frame.can_id for frame in read_bus_log(path, "can1")] == [0x81]


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "(0000000001.234567) can0 181#1122AABB extra",
        "(0000000001.2345) can0 181#11",
        "(0000000001.234567) can0 181#112",
        "(0000000001.234567) can0 181#112233445566778899",
        "(0000000001.234567) can0 00000181#11",
        "(0000000001.234567) can0 181##111",
        "(0000000001.234567) can0 181#R",
        "(0000000001.234567) can0 FFF#11",
    ],
)
def test_a_line_that_is_no_frame_is_an_error_with_its_number(tmp_path, line):
    with pytest.raises(ValueError, match=r"must"):
        parse_line(line)
    path = tmp_path / "bus.log"
    path.write_text(LINES + line + "\n")
    with pytest.raises(BusLogError, match=r"bus\.log, line 4: "):
        list(read_bus_log(path))


def test_time_that_runs_backwards_is_an_error(tmp_path):
    path = tmp_path / "bus.log"
    path.write_text("(0000000002.000000) can0 080#\n(0000000001.999999) can0 080#\n")
    with pytest.raises(BusLogError, match="line 2: 1000 ns before"):
        list(read_bus_log(path))


def test_a_channel_name_that_would_break_the_format_is_refused(tmp_path):
    with pytest.raises(ValueError, match="without spaces"):
        BusLogWriter(tmp_path / "bus.log", "can 0")
