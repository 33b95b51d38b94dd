"""Exported logs, read back by python-can's readers; the table of signals against values that are known."""

import csv
import tomllib
from itertools import pairwise
from pathlib import Path

import can
import pytest

from canipulator.cli import main
from canipulator.log_export import export_log
from config.errors import ConfigError
from drivers import log_formats
from drivers.frame import Frame
from drivers.log_formats import formats
from logs.bus_log import BusLogWriter

FRAMES = [
    Frame(0x701, b"\x00", 56_000),
    Frame(0x000, b"\x01\x01", 125_000),
    Frame(0x080, b"", 10_000_000),
    Frame(0x195, bytes.fromhex("3716E8030000FF7F"), 10_130_000),
    Frame(0x195, bytes.fromhex("37"), 10_200_000),  # too short for its message
    Frame(0x7EF, bytes(range(8)), 86_400_000_001_000),  # unknown to the DBC, a day later
]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    with BusLogWriter(tmp_path / "bus.log") as writer:
        for frame in FRAMES:
            writer(frame)
    return tmp_path


@pytest.mark.parametrize("name", formats())
def test_python_can_reads_the_same_frames_back(run: Path, name: str) -> None:
    path, count = export_log(run, name, None)
    assert (path, count) == (run / f"bus.{name}", len(FRAMES))
    with can.LogReader(path) as reader:
        messages = list(reader)
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in messages] == [
        (frame.can_id, frame.data, False) for frame in FRAMES
    ]
    gaps_ns = [round((b.timestamp - a.timestamp) * 1e9, -2) for a, b in pairwise(messages)]
    assert gaps_ns == [b.t_ns - a.t_ns for a, b in pairwise(FRAMES)]


def test_table_of_signals(run: Path) -> None:
    path, count = export_log(run / "bus.log", "csv", run / "signals.csv")
    assert count == len(FRAMES)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    values = {
        row["signal"]: row["value"] for row in rows if row["message"] == "tower_rotate_feedback" and row["signal"]
    }
    # 1637h, operation enabled; 1000 µrad; 32767 ‰ of the rated torque
    assert float(values["position_actual_value"]) == pytest.approx(0.001)
    assert float(values["torque_actual_value"]) == pytest.approx(32.767)
    position = next(row for row in rows if row["signal"] == "position_actual_value")
    assert (position["sender"], position["unit"], position["time_s"]) == ("tower_rotate", "rad", "0.010130")
    assert [(row["can_id"], row["data"], row["signal"]) for row in rows if row["can_id"] in ("080", "7EF")] == [
        ("080", "", ""),
        ("7EF", "0001020304050607", ""),
    ]
    assert [row["signal"] for row in rows if row["data"] == "37"] == [""]
    assert [row["data"] for row in rows if row["data"]] == [f.data.hex().upper() for f in FRAMES if f.data]


@pytest.mark.parametrize("name", ["xlsx", "BLF", ""])
def test_unknown_formats_are_told_the_valid_ones(run: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"valid: asc, blf, csv, .*trc"):
        export_log(run, name, None)


def test_mf4_says_in_one_line_which_extra_it_needs(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(log_formats, "MF4_PACKAGE", "a_package_that_nobody_has")
    monkeypatch.setattr("sys.argv", ["canipulator", "export", str(run), "--to", "mf4"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith("canipulator: --to mf4: needs asammdf of the extra canipulator[mf4]")
    assert "without it: asc, blf, csv, trc" in said
    assert not (run / "bus.mf4").exists()
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    (needed,) = project["optional-dependencies"]["mf4"]
    assert needed.startswith("asammdf")
    assert not [entry for entry in project["dependencies"] if entry.startswith("asammdf")]


@pytest.mark.skipif("mf4" not in formats(), reason="needs the extra canipulator[mf4]")
def test_times_in_mf4_are_those_of_the_run(run: Path) -> None:
    """Every format but this one is covered above by its gaps alone; here 0 is 0 for tools that show time since the start, too."""
    path, _ = export_log(run, "mf4", None)
    with can.LogReader(path) as reader:
        times = [message.timestamp for message in reader]
    assert times == pytest.approx([frame.t_ns * 1e-9 for frame in FRAMES], abs=1e-9)


@pytest.mark.parametrize("name", ["blf", "csv"])
def test_a_log_that_cannot_be_read_leaves_no_file(run: Path, name: str) -> None:
    with (run / "bus.log").open("a") as log:
        log.write("rubbish\n")
    with pytest.raises(ConfigError, match="line 7"):
        export_log(run, name, None)
    assert not (run / f"bus.{name}").exists()


def test_a_folder_without_a_bus_log(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"bus\.log: no such file"):
        export_log(tmp_path, "blf", None)


def test_the_log_itself_is_not_overwritten(run: Path) -> None:
    before = (run / "bus.log").read_bytes()
    with pytest.raises(ConfigError, match="is the log itself"):
        export_log(run, "trc", run / "bus.log")
    assert (run / "bus.log").read_bytes() == before
