"""On a kernel that has CAN: three processes on vcan0, candump beside them, `cansend` against them. Real sockets, real time.

In a user-mode kernel system calls take long (12 to 17 µs measured for the shortest, 0.1 outside). The kernel that kernel/build makes
has several processors: `sliding-door` runs in real time there. Debian's has one: at half of real time, all roles alike.
"""

import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.socketcan.attached import FILLER, MASS, PLAYED

HERE = Path(__file__).parent
KERNEL = Path(__file__).parents[2] / ".cache" / "vcan-kernel" / "linux"
PROCESSORS = min(3, len(os.sched_getaffinity(0))) if KERNEL.exists() else 1
ATTEMPTS = ("1.0", "1.0", "0.5", "0.25") if PROCESSORS > 1 else ("0.5", "0.5", "0.25")
"""Paces. Real time on a shared machine: a session in which a SYNC came late is run once more, and the best one is judged."""
LATE_SYNCS = 3
"""Of 2,300 while the hand is led: none on a machine that is left alone, and the drives go on as they were for two periods. A virtual
machine's processors are taken away now and then, which it counts itself: each 10 ms of that may cost one more."""
TICK_MS = 1e3 / os.sysconf("SC_CLK_TCK")
CYCLE_S = 0.01
LOCKSTEP_RATIO = 2.0
"""What real time may make of the TCP error of a lockstep run."""

pytestmark = [pytest.mark.slow, pytest.mark.socketcan, pytest.mark.xdist_group("vcan")]


@pytest.fixture(scope="module")
def lockstep_error_m(tmp_path_factory: pytest.TempPathFactory) -> float:
    """TCP error of the same mission in lockstep. Leaves every compiled function in the cache: compiling in there takes minutes."""
    out = tmp_path_factory.mktemp("lockstep")
    command = [sys.executable, "-m", "canipulator", "run", "sliding-door", "--no-rerun", "--json", "--out", out]
    answer = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=200, check=True)
    error_m: float = json.loads(answer.stdout)["tcp_error_rms_m"]
    return error_m


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory, lockstep_error_m: float) -> Path:
    """What session.py leaves behind."""
    found: dict[Path, list[float]] = {}
    for pace in ATTEMPTS:
        out = tmp_path_factory.mktemp("vcan")
        kernel = [HERE / "with-vcan", "-m", "3G", "-n", PROCESSORS, "-t", "300"]
        command = [*kernel, sys.executable, HERE / "session.py", out, pace]
        before_ms = stolen_ms()
        answer = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=330, check=False)
        machine = {"pace": pace, "processors": PROCESSORS, "stolen_ms": stolen_ms() - before_ms}
        (out / "machine.json").write_text(json.dumps(machine))
        texts = "\n".join(f"--- {path.name}\n{path.read_text()[-2000:]}" for path in sorted(out.glob("*/*.txt")))
        if answer.returncode == 0 and set(codes(out, "mission").values()) == {0}:
            found[out] = missed_at_work(out)
            print(f"{machine}: SYNCs late at {found[out]} s")
            if not found[out]:
                break
        else:
            print(f"{machine}: disturbed\n{answer.stderr[-2000:]}\n{texts}")
    assert found, "no session came to its end"
    return min(found, key=lambda out: len(found[out]))


def stolen_ms() -> float:
    """Time for which the machine's processors were somebody else's, since it was started (`man 5 proc_stat`)."""
    return float(Path("/proc/stat").read_text().split()[8]) * TICK_MS


def codes(session: Path, name: str) -> dict[str, int]:
    found: dict[str, int] = json.loads((session / "codes.json").read_text())[name]
    return found


def missed_at_work(session: Path) -> list[float]:
    """Times (s, of the run) of SYNCs that came a cycle late or more while the hand was led."""
    log = (session / "mission" / "sim" / "bus.log").read_text()
    led = re.findall(r"^\((\d+\.\d+)\) \S+ 481#0402", log, re.MULTILINE)
    syncs = [float(t) for t in re.findall(r"^\((\d+\.\d+)\) \S+ 080#", log, re.MULTILINE)]
    syncs = [t for t in syncs if float(led[0]) <= t <= float(led[-1])]
    return [after for before, after in itertools.pairwise(syncs) if after - before > 1.5 * CYCLE_S]


def frames_of(path: Path, identifier: str = "[0-9A-F]{3}") -> list[str]:
    """`181#1122` for each line of a log in candump's format."""
    return re.findall(rf"^\(\d+\.\d+\) \S+ ({identifier}#[0-9A-F]*)", path.read_text(), re.MULTILINE)


def test_the_mission_in_three_processes_meets_its_expectations(session: Path) -> None:
    assert codes(session, "mission") == {"planner": 0, "sim": 0, "strategic": 0}
    metrics = json.loads((session / "mission" / "sim" / "metrics.json").read_text())
    assert metrics["expectations"]
    assert all(verdict["ok"] for verdict in metrics["expectations"])
    assert metrics["tcp_travel_m"] == pytest.approx(4.0, abs=0.01)
    assert metrics["faults"] == []


def test_no_cycle_is_missed(session: Path) -> None:
    metrics = json.loads((session / "mission" / "sim" / "metrics.json").read_text())
    print({name: metrics[name] for name in ("missed_cycles", "overruns", "max_lateness_us", "wall_time_s")})
    stolen = json.loads((session / "machine.json").read_text())["stolen_ms"]
    late = LATE_SYNCS + int(stolen / (1e3 * CYCLE_S))
    assert len(missed_at_work(session)) <= late
    assert metrics["missed_cycles"] <= late
    assert metrics["frames_lost"] == 0


def test_the_hand_is_led_about_as_well_as_in_lockstep(session: Path, lockstep_error_m: float) -> None:
    real_time = json.loads((session / "mission" / "sim" / "metrics.json").read_text())["tcp_error_rms_m"]
    print(f"TCP error {1e3 * real_time:.2f} mm rms in real time, {1e3 * lockstep_error_m:.2f} in lockstep")
    assert real_time <= LOCKSTEP_RATIO * lockstep_error_m


def test_candump_sees_what_the_bus_logs_hold_frame_for_frame(session: Path) -> None:
    """In the same order, where frames are received by one processor; with several, each identifier's in the same order."""
    heard = frames_of(session / "mission" / "candump.log")
    for role in ("sim", "planner", "strategic"):
        logged = frames_of(session / "mission" / role / "bus.log")
        assert len(logged) > 10_000
        if PROCESSORS == 1:
            assert starts_of(logged, heard), role
        for identifier in {frame[:4] for frame in logged}:
            of_it, heard_of_it = ([f for f in frames if f.startswith(identifier)] for frames in (logged, heard))
            assert starts_of(of_it, heard_of_it), f"{role} {identifier}"


def starts_of(part: list[str], whole: list[str]) -> list[int]:
    """Where `part` is found in `whole`, in one piece."""
    head = part[:20]
    starts = [i for i in range(len(whole)) if whole[i : i + len(head)] == head]
    return [i for i in starts if whole[i : i + len(part)] == part]


def test_the_planner_leaves_its_drives_switched_off(session: Path) -> None:
    last = {frame[:3]: frame[4:8] for frame in frames_of(session / "mission" / "planner" / "bus.log")}
    for node_id in (11, 12, *range(21, 29)):
        low_byte = int(last[f"{0x180 + node_id:03X}"][:2], 16)
        assert low_byte & 0x4F == 0x40, "statusword: switch on disabled"


def test_cansend_of_a_quick_stop_stops_the_drive_and_the_planner_reacts(session: Path) -> None:
    frames = frames_of(session / "stopped" / "sim" / "bus.log")
    sent = frames.index("617#2B40600002000000")
    assert frames[sent:].count("597#6040600000000000") == 1, "the drive has confirmed it"
    words = [int(frame[6:8] + frame[4:6], 16) for frame in frames[sent:] if frame.startswith("197#")]
    assert any(word & 0x6F in (0x07, 0x40) for word in words), "quick stop active, or switched off by it"
    after = [int(frame[4:6], 16) for frame in frames[sent:] if frame.startswith("182#")]
    assert after[-1] == 7, "the planner is in FAULT"
    for node_id in (11, 12, *range(21, 29)):
        answers = [frame for frame in frames[sent:] if frame.startswith(f"{0x180 + node_id:03X}#")]
        enabled = [int(frame[4:6], 16) & 0x6F == 0x27 for frame in answers]
        assert not enabled[-1], f"drive {node_id} goes on"
    assert "drive 23 (shoulder): drive left operation enabled" in (session / "stopped" / "planner.txt").read_text()
    assert codes(session, "stopped") == {"strategic": 1, "planner": 143, "sim": 143}


# `canipulator attach` on vcan0, in a kernel of its own: about 50 s


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What attached.py leaves behind."""
    for _ in ATTEMPTS:
        out = tmp_path_factory.mktemp("attach") / "tools"
        command = [HERE / "with-vcan", "-m", "2G", "-t", "200", sys.executable, HERE / "attached.py", out]
        answer = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=250, check=False)
        if answer.returncode == 0 and len(frames_of(out / "logger.log", "321")) == MASS:
            break
        print(f"disturbed:\n{answer.stdout[-2000:]}")
    assert answer.returncode == 0, f"{answer.stdout[-2000:]}\n{answer.stderr[-2000:]}"
    print((out / "times.json").read_text(), (out / "attach.txt").read_text())
    return out


def test_a_logger_on_attach_sees_every_frame_of_candump_though_another_tool_stalls(tools: Path) -> None:
    """All frames of all senders but the fillers, in the order of the wire."""
    heard = [frame for frame in frames_of(tools / "candump.log") if not frame.startswith(FILLER)]
    logged = [frame for frame in frames_of(tools / "logger.log") if not frame.startswith(FILLER)]
    assert len(heard) == MASS + PLAYED
    assert logged == heard


def test_what_a_player_sends_on_attach_is_on_the_wire_complete_and_in_order(tools: Path) -> None:
    assert frames_of(tools / "candump.log", "456") == frames_of(tools / "played.log")
    assert len(frames_of(tools / "played.log")) == PLAYED


def test_a_stalled_tool_loses_its_own_frames_and_is_told_of(tools: Path) -> None:
    found = re.search(r"(\d+) served, \d+ frames to them, (\d+) lost by slow ones, (\d+) from them", report_of(tools))
    assert found is not None, report_of(tools)
    served, lost, injected = map(int, found.groups())
    assert served == 3  # logger, player, and the one that stalls
    assert lost > 0, "more than a queue and its socket hold"
    assert injected == PLAYED


def report_of(tools: Path) -> str:
    return (tools / "attach.txt").read_text()
