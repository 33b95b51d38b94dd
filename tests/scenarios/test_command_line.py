"""The command line as a person meets it: one clear line and exit code 2 for what is wrong, 130 for Ctrl-C, JSON where asked for."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from logs.bus_log import read_bus_log

pytestmark = pytest.mark.slow


def canipulator(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "canipulator", *arguments], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["run", "sliding-dor"], ["did you mean 'sliding-door'?"]),
        (["rum", "sliding-door"], ["unknown command 'rum'", "did you mean 'run'?"]),
        (["run", "sliding-door", "--set", "slip.sigm=1"], ["sliding-door.toml", "slip.sigm", "'sigma'"]),
        (["run", "sliding-door", "--set", "slip.sigma=nan"], ["slip.sigma", "NaN"]),
        (["run", "sliding-door", "--duration", "0"], ["--duration 0", "positive"]),
        (["run", "sliding-door", "--duration", "nan"], ["--duration nan", "positive"]),
        (["run", "sliding-door", "--out", "/proc/no"], ["/proc/no"]),
        (["run", "sliding-door", "--method", "pnx"], ["planner.method", "pnx"]),
        (["run", "sliding-door", "--set", "robot=moma9"], ["moma9", "moma8"]),
        (["run", "sliding-door", "--set", "start.configuration=[0.0]"], ["1 values, must have 8"]),
        (
            ["run", "sliding-door", "--set", "start.configuration=[0.0,0.1,0.0,0.0,0.0,0.0,0.0,0.0]"],
            ["tower_lift", "0.35 to 1.15"],
        ),
        (["run", "sliding-door", "--set", "expect.1.metric=tcp_error_rms"], ["did you mean 'tcp_error_rms_m'?"]),
        (["run", "sliding-door", "--bus", "socketcn:vcan0"], ["--bus", "no interface 'socketcn'"]),
        (["planner", "--bus", "socketcan:no_such_bus"], ["socketcan:no_such_bus", "cannot be opened"]),
        (["run", "sliding-door", "--bus", "virtual:cli", "--pace", "2"], ["--pace 2", "at most 1"]),
        (["run", "sliding-door", "--bus", "virtual:cli", "--external", "plannr"], ["--external", "plannr"]),
        (["run", "sliding-door", "--external", "planner"], ["--external", "real wire"]),
        (["sim"], ["--bus"]),
        (["view", "/nowhere"], ["/nowhere", "no recording"]),
        (["bus", "export", "pdf"], ["pdf"]),
        (["run"], ["SCENARIO"]),
    ],
)
def test_what_is_wrong_gets_one_line_and_exit_code_2(arguments: list[str], parts: list[str]) -> None:
    answer = canipulator(*arguments)
    assert answer.returncode == 2, answer.stderr
    assert answer.stdout == ""
    assert answer.stderr.startswith("canipulator: ")
    assert answer.stderr.count("\n") == 1
    for part in parts:
        assert part in answer.stderr


def test_list_has_a_line_for_each_scenario() -> None:
    lines = canipulator("list").stdout.splitlines()
    assert {line.split()[0] for line in lines} >= {"sliding-door", "hold-still", "drive-square"}
    assert all(len(line.split()) > 3 for line in lines)


def test_help_names_every_option() -> None:
    text = canipulator("run", "--help").stdout
    for option in [
        "--out",
        "--seed",
        "--duration",
        "--method",
        "--coordination",
        "--set",
        "--bus",
        "--no-rerun",
        "--json",
    ]:
        assert option in text


def test_json_is_all_that_is_on_stdout(tmp_path: Path) -> None:
    answer = canipulator("run", "hold-still", "--duration", "1", "--out", str(tmp_path), "--no-rerun", "--json")
    assert answer.returncode == 0, answer.stderr
    assert json.loads(answer.stdout)["expectations"] == [], "a run cut short is not judged"


def test_bus_export_writes_where_it_is_told(tmp_path: Path) -> None:
    assert canipulator("bus", "export", "dbc", str(tmp_path)).returncode == 0
    assert canipulator("bus", "export", "eds", str(tmp_path)).returncode == 0
    assert (tmp_path / "canipulator.dbc").is_file()
    assert (tmp_path / "joint_drive.eds").is_file()


def test_ctrl_c_leaves_readable_files_and_130(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "canipulator", "run", "sliding-door", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    log = tmp_path / "bus.log"
    deadline = time.monotonic() + 90.0
    while not (log.exists() and log.stat().st_size > 200_000):
        assert time.monotonic() < deadline, "the run did not get going"
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)  # the process under test lives in real time
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "canipulator: interrupted" in errors
    assert "Traceback" not in errors
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["sim_time_s"] > 1.0
    assert metrics["frames"] == sum(1 for _ in read_bus_log(log))
    assert (tmp_path / "run.rrd").stat().st_size > 100_000
    assert "interrupted" in (tmp_path / "events.log").read_text()
