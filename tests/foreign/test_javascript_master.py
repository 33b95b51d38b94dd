"""A CANopen stack that is neither ours nor Python's judges a drive: `canopen` of the npm registry as its master.

The bus is served on 127.0.0.1 in real time; the package is installed from package-lock.json on first use.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
NODE = 25
LIMIT_S = 180

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("realtime")]


def missing(what: str) -> None:
    if os.environ.get("CANIPULATOR_REQUIRE") == "all":
        pytest.fail(f"needs {what}, and everything is required here")
    pytest.skip(f"needs {what}")


@pytest.fixture(scope="module")
def package() -> None:
    if shutil.which("node") is None or shutil.which("npm") is None:
        missing("node and npm")
    if not (HERE / "node_modules" / "canopen").is_dir():
        answer = subprocess.run(["npm", "ci"], cwd=HERE, capture_output=True, text=True, timeout=LIMIT_S, check=False)
        if answer.returncode != 0:
            missing(f"the npm registry ({answer.stderr.strip().splitlines()[-1:]})")


@pytest.fixture(scope="module")
def port(package: None) -> Iterator[int]:
    command = [sys.executable, "-m", "canipulator", "drives", "--serve", "0", "--nodes", str(NODE)]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as bench:
        assert bench.stderr is not None
        found = re.search(r"127\.0\.0\.1:(\d+)", bench.stderr.readline())
        assert found is not None
        try:
            yield int(found[1])
        finally:
            bench.terminate()


@pytest.fixture(scope="module")
def seen(port: int) -> dict:
    command = ["node", "master.js", str(port), str(NODE), str(ROOT / "config" / "bus" / "joint_drive.eds")]
    answer = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert answer.returncode == 0, answer.stderr
    found: dict = json.loads(answer.stdout)
    return found


def test_it_identifies_the_drive_and_reads_our_eds(seen: dict) -> None:
    assert seen["profile"] == 402
    assert seen["name"] == seen["nameInEds"] == "joint drive"  # eleven bytes: a segmented transfer
    assert seen["entriesInEds"] > 50


def test_it_gets_the_abort_codes_of_cia_301(seen: dict) -> None:
    assert seen["aborts"] == {
        "write to a constant": 0x0601_0002,
        "object that is not there": 0x0602_0000,
        "sub-index that is not there": 0x0609_0011,
        "mode that is not supported": 0x0609_0030,
        "wrong length": 0x0607_0013,
    }


def test_it_enables_moves_and_quick_stops_the_drive(seen: dict) -> None:
    states = seen["states"]
    # On a busy machine the drive is on its way before its first frame is looked at.
    if states[0] == "switch on disabled":
        states = states[1:]
    assert states == [
        "ready to switch on",
        "switched on",
        "operation enabled",
        "quick stop active",
        "switch on disabled",
    ]
    assert abs(seen["moved"] - 100_000) < 1000  # µrad
    assert seen["emergencies"] == []


def test_heartbeat_and_nmt_state_are_as_it_asked_for(seen: dict) -> None:
    assert seen["heartbeats"] > 5
    assert seen["nmtState"] == "operational"
