"""`canipulator drives`: a bench of simulated drives for somebody else's master."""

import contextlib
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from canipulator.cli import main
from canipulator.drives import node_ids
from config.errors import ConfigError
from drivers.bus.carrier import BusError, open_carrier
from drivers.catalogue import DRIVE_IDS

ROOT = Path(__file__).parents[2]
PATIENCE_S = 90.0


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("25", {25}),
        ("11,12", {11, 12}),
        ("21-28", set(range(21, 29))),
        ("11, 12, 21-23", {11, 12, 21, 22, 23}),
        ("25,25,24-26", {24, 25, 26}),
        ("11,12,21-28", set(DRIVE_IDS)),
    ],
)
def test_nodes_are_ids_and_ranges(text: str, ids: set[int]) -> None:
    assert node_ids(text) == ids


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "''"),
        ("11,,12", "''"),
        ("elbow", "'elbow'"),
        ("21-", "'21-'"),
        ("-21", "'-21'"),
        ("21-x", "'21-x'"),
        ("21-22-23", "'21-22-23'"),
        ("2", "'2'"),  # the planner
        ("11-21", "'11-21'"),  # 13 to 20 are nobody
        ("31", "'31'"),  # the force sensor
        ("28-21", "'28-21'"),  # nothing
        ("25,0x15", "'0x15'"),
    ],
)
def test_what_is_no_drive_is_named(text: str, part: str) -> None:
    with pytest.raises(ConfigError) as refused:
        node_ids(text)
    message = str(refused.value)
    assert message.startswith(f"--nodes {text!r}: {part} must be ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--bus URL or --serve PORT, one of the two"),
        (["--bus", "virtual:x", "--serve", "0"], "one of the two"),
        (["--serve", "0", "--duration", "0"], "--duration 0"),
        (["--serve", "0", "--nodes", "29"], "--nodes '29'"),
        (["--serve", "70000"], "port 70000"),
    ],
)
def test_command_refuses_in_one_line(
    arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["canipulator", "drives", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert words in said


@contextlib.contextmanager
def bench(nodes: str, *more: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A served bench: (process, port)."""
    command = [sys.executable, "-m", "canipulator", "drives", "--serve", "0", "--nodes", nodes, *more]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            announced = process.stderr.readline()
            found = re.search(r"127\.0\.0\.1:(\d+), any bus name, tools may send", announced)
            assert found is not None, announced + process.stderr.read()
            yield process, int(found[1])
        finally:
            process.terminate()
            process.stderr.read()


@pytest.mark.slow
@pytest.mark.xdist_group("realtime")
def test_drives_that_were_asked_for_are_there_and_the_others_are_silent() -> None:
    present = (12, 21, 25)
    heard: dict[int, int] = {}
    answers: dict[int, bytes] = {}
    with bench("12,21,25") as (process, port):
        assert process.stderr is not None
        said = {process.stderr.readline().strip() for _ in present}
        where = {"interface": "socketcand", "channel": "can0", "host": "127.0.0.1", "port": port, "tcp_tune": True}
        with can.Bus(**where) as bus:
            for node_id in (*DRIVE_IDS, 2, 31, 32, 33):
                request = bytes.fromhex("40 00 10 00 00 00 00 00")
                bus.send(can.Message(arbitration_id=0x600 + node_id, data=request, is_extended_id=False))
            deadline = time.monotonic() + PATIENCE_S
            while min(heard.get(node_id, 0) for node_id in present) < 10 or len(answers) < len(present):
                assert time.monotonic() < deadline, (heard, answers)
                message = bus.recv(1.0)
                if message is None:
                    continue
                if message.arbitration_id & 0x780 == 0x580:
                    answers[message.arbitration_id & 0x7F] = bytes(message.data)
                elif message.arbitration_id & 0x780 == 0x700:
                    heard[message.arbitration_id & 0x7F] = heard.get(message.arbitration_id & 0x7F, 0) + 1
                    assert message.data == b"\x7f", "pre-operational: nobody has started it"
                else:  # our own requests come back; nothing else is on the bus, least of all the planner's SYNC
                    assert message.arbitration_id & 0x780 == 0x600, message
    assert said == {
        "12 wheel_right: switch on disabled",
        "21 tower_rotate: switch on disabled",
        "25 elbow: switch on disabled",
    }
    assert set(heard) == set(present), "one second of heartbeats, and none of anybody else"
    assert answers == dict.fromkeys(present, bytes.fromhex("43 00 10 00 92 01 02 00"))


PACE = "0.2"
"""Two processes in real time beside whatever else the machine does."""


@pytest.mark.slow
@pytest.mark.xdist_group("realtime")
def test_a_drive_of_another_process_takes_the_place_of_one_of_the_ten(tmp_path: Path) -> None:
    """Robot, planner and mission here, the elbow's drive there; between them the served bus, on 127.0.0.1."""
    with bench("25", "--pace", PACE) as (process, port):
        assert process.stderr is not None
        assert process.stderr.readline().strip() == "25 elbow: switch on disabled"
        short = ("--set", "step.0.duration_s=1", "--set", "duration_s=3")
        where = ("--bus", f"served:{port}", "--external", "25", "--pace", PACE, "--out", str(tmp_path / "run"))
        drive = ("--set", "drives.25.identity=any", "--no-rerun", "--no-dashboard")
        command = [sys.executable, "-m", "canipulator", "run", "hold-still", *where, *short, *drive]
        answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert answer.returncode == 0, answer.stderr
        states = [process.stderr.readline().strip().removeprefix("25 elbow: ")]
        while states[-1] != "switch on disabled":
            states.append(process.stderr.readline().strip().removeprefix("25 elbow: "))
    assert "operation enabled" in states
    events = (tmp_path / "run" / "events.log").read_text()
    assert "drive 25 (elbow): set up with a difference: vendor-ID 0x0, product code 0x1: taken as it is" in events
    assert "drive 25 (elbow): drive configured: mode 8" in events
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert all(verdict["ok"] for verdict in metrics["expectations"])
    assert metrics["faults"] == []
    frames = (tmp_path / "run" / "bus.log").read_text()
    assert frames.count(" 199#") > 100, "feedback of the drive over there, in the log of the run"


@pytest.mark.parametrize("port", ["0", "65536", "can0", "29536x"])
def test_a_served_bus_is_a_port(port: str) -> None:
    with pytest.raises(BusError, match="must be served:PORT"):
        open_carrier(f"served:{port}", 1_000_000)


@pytest.mark.slow
@pytest.mark.xdist_group("realtime")
def test_it_ends_by_itself_when_its_time_is_over() -> None:
    with bench("25", "--duration", "0.5") as (process, _):
        assert process.stderr is not None
        rest = process.stderr.read()
        assert process.wait(PATIENCE_S) == 0
    assert "25 elbow: switch on disabled" in rest
    assert "tools: 0 served" in rest


@pytest.mark.slow
@pytest.mark.xdist_group("realtime")
def test_master_of_the_documentation_runs_as_it_stands() -> None:
    text = (ROOT / "docs" / "tools.md").read_text()
    (program,) = (block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "BaseNode402" in block)
    assert len([line for line in program.splitlines() if line.strip()]) <= 18
    with bench("25") as (process, port):
        assert process.stderr is not None
        assert process.stderr.readline().strip() == "25 elbow: switch on disabled"
        command = [sys.executable, "-c", program, str(port)]
        answer = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert answer.returncode == 0, answer.stderr
        states = [process.stderr.readline().strip().removeprefix("25 elbow: ")]
        while states[-1] != "switch on disabled" or len(states) < 2:
            states.append(process.stderr.readline().strip().removeprefix("25 elbow: "))
    state, position = answer.stdout.rsplit(maxsplit=1)
    assert state == "OPERATION ENABLED"
    assert int(position) == pytest.approx(-1_300_000 + 200_000, abs=1_000)  # the elbow stands at -1.3 rad in hold-still
    assert "operation enabled" in states
