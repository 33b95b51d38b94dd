"""What a run leaves on the wire: the same bytes for the same seed, all of them explained, the load that the frame lengths say."""

import json
import os
import subprocess
import sys
from pathlib import Path

import cantools
import pytest

from canipulator.run import Outcome
from config.load import load_scenario
from drivers.catalogue import DRIVE_IDS
from drivers.frame import bit_length
from logs.bus_log import read_bus_log
from tests.scenarios.conftest import Runner

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("door")]

ROOT = Path(__file__).parents[2]
SHORT_S = 3.0


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "canipulator", *arguments]


def bus_log(outcome: Outcome) -> bytes:
    return (outcome.directory / "bus.log").read_bytes()


def test_same_seed_same_bytes_in_another_process_with_and_without_recording(runner: Runner, tmp_path: Path) -> None:
    here = runner("sliding-door", duration_s=SHORT_S, record=True)
    out = tmp_path / "elsewhere"
    # another hash seed, as every new process has one
    subprocess.run(
        command("run", "sliding-door", "--no-rerun", "--duration", str(SHORT_S), "--out", str(out), "--json"),
        check=True,
        stdout=subprocess.DEVNULL,
        env=os.environ | {"PYTHONHASHSEED": "7"},
    )
    assert (out / "bus.log").read_bytes() == bus_log(here)
    assert len(bus_log(here)) > 100_000


def test_another_seed_other_bytes(runner: Runner) -> None:
    assert bus_log(runner("sliding-door", duration_s=SHORT_S)) != bus_log(
        runner("sliding-door", "seed=2", duration_s=SHORT_S)
    )


def test_the_resolved_scenario_reproduces_the_run(runner: Runner) -> None:
    first = runner("sliding-door", "slip.sigma=0.02", duration_s=SHORT_S)
    second = runner(str(first.directory / "scenario.toml"), duration_s=SHORT_S)
    assert bus_log(first) == bus_log(second)


def test_the_dbc_explains_every_frame(standard_door: Outcome) -> None:
    database = cantools.database.load_file(ROOT / "config" / "bus" / "canipulator.dbc")
    known = {message.frame_id: message for message in database.messages}
    seen = set()
    for frame in read_bus_log(standard_door.directory / "bus.log"):
        assert frame.can_id in known, f"{frame.can_id:03X}h is not in the DBC"
        if frame.can_id not in seen or frame.can_id % 7 == frame.t_ns % 7:
            values = known[frame.can_id].decode(frame.data, allow_truncated=True)
            assert values is not None
        seen.add(frame.can_id)
    process_data = {can_id for can_id in known if 0x180 <= can_id < 0x580}
    assert len(seen & process_data) >= 10 + 10 + 3 + 4 + 2 + 3, "process data of some node never came"


def test_the_bus_load_is_what_the_frame_lengths_say(standard_door: Outcome) -> None:
    second = [frame for frame in read_bus_log(standard_door.directory / "bus.log") if 10.0 <= frame.t_ns * 1e-9 < 11.0]
    load = sum(bit_length(frame.can_id, frame.data) for frame in second) / 1e6
    cyclic = {0x080} | {base + node_id for base in (0x180, 0x200) for node_id in DRIVE_IDS}
    drives = [frame for frame in second if frame.can_id in cyclic]
    share = sum(bit_length(frame.can_id, frame.data) for frame in drives) / 1e6
    assert len(drives) == 2100, "one SYNC, ten set points and ten answers, a hundred times a second"
    # 51 + 20 * 111 bits without a single stuff bit, 55 + 20 * 135 with as many as there can be
    assert 0.227 < share < 0.276
    assert load == pytest.approx(standard_door.metrics["bus_load_mean"], abs=0.02)
    assert share + 0.05 < load < 0.45


def test_heartbeats_survive_the_start_up_at_250_hz(runner: Runner) -> None:
    outcome = runner("sliding-door", "planner.arm_cycle_hz=250", duration_s=6.0)
    assert outcome.metrics["faults"] == ()
    assert outcome.metrics["tcp_travel_m"] > 0.1


def test_a_bus_that_is_too_slow_is_reported_not_hidden(runner: Runner) -> None:
    outcome = runner("sliding-door", "bus.bitrate=250000", duration_s=20.0)
    assert any("bus: overloaded" in fault for fault in outcome.metrics["faults"])
    assert outcome.metrics["bus_load_peak"] > 0.99


def test_the_files_of_a_run(standard_door: Outcome) -> None:
    directory = standard_door.directory
    assert {path.name for path in directory.iterdir()} >= {
        "run.rrd", "bus.log", "metrics.json", "scenario.toml", "events.log"
    }  # fmt: skip
    metrics = json.loads((directory / "metrics.json").read_text())
    for key in CONTRACT_KEYS:
        assert key in metrics, key
    assert set(metrics["arm_cycle_us"]) == {"p50", "p99", "max"}
    assert metrics["frames"] == sum(1 for _ in read_bus_log(directory / "bus.log"))
    assert load_scenario(str(directory / "scenario.toml")) == load_scenario("sliding-door")
    events = (directory / "events.log").read_text()
    for milestone in ("READY", "EXECUTING", "'pull' begins", "all steps done"):
        assert milestone in events


CONTRACT_KEYS = [
    *("scenario", "seed", "method", "coordination", "sim_time_s", "wall_time_s", "real_time_factor"),
    *("physics_only_real_time_factor", "arm_cycles", "platform_cycles", "arm_cycle_us"),
    *("tcp_error_rms_m", "tcp_error_p99_m", "tcp_error_max_m", "tcp_orientation_error_max_rad"),
    *("bus_load_mean", "bus_load_peak", "frames", "frames_lost", "limit_violations"),
    *("min_manipulability_arm", "min_manipulability_robot", "faults", "expectations"),
]
