"""Figures from a recording: which there are, that they are what they say, and that the same recording gives the same files."""

from pathlib import Path

import pytest

from logs.figures import FigureRun, save_figures
from logs.recording_reader import Recording, read_recording
from stack.kinematics import ArmModel

pytestmark = pytest.mark.slow

NAMES = ("path", "error", "manipulability", "platform", "joints")


@pytest.fixture(scope="module")
def drawn(recorded: Path) -> FigureRun:
    return FigureRun("one", read_recording(recorded / "run.rrd"))


def test_every_figure_is_written_as_pdf_and_png(drawn: FigureRun, tmp_path: Path) -> None:
    written = save_figures([drawn], ArmModel.load("moma8"), tmp_path / "figures")
    assert [path.name for path in written] == [f"{name}.{kind}" for name in NAMES for kind in ("pdf", "png")]
    for path in written:
        assert path.read_bytes().startswith(b"\x89PNG" if path.suffix == ".png" else b"%PDF")


def test_the_same_recording_gives_the_same_files(drawn: FigureRun, tmp_path: Path) -> None:
    arm = ArmModel.load("moma8")
    first, second = (save_figures([drawn], arm, tmp_path / name) for name in "ab")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_several_runs_share_all_but_the_joints(drawn: FigureRun, tmp_path: Path) -> None:
    other = FigureRun("two", drawn.recording)
    names = {path.name for path in save_figures([drawn, other], ArmModel.load("moma8"), tmp_path)}
    assert {"joints-1.pdf", "joints-2.pdf", "path.pdf"} <= names
    assert "joints.pdf" not in names


def test_nothing_measured_nothing_drawn(tmp_path: Path) -> None:
    assert save_figures([FigureRun("none", Recording({}, {}))], ArmModel.load("moma8"), tmp_path / "none") == []


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.rrd").write_bytes(b"nothing of the kind")
    with pytest.raises(ValueError, match=r"run\.rrd"):
        read_recording(tmp_path / "run.rrd")
