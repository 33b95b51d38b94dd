"""Why a run stopped, told from its recording: somebody who has not seen it, and does not know what was injected, gets it right."""

import subprocess
import sys
from pathlib import Path

import pytest

from canipulator.outcome import RunOptions
from canipulator.run import run_scenario
from config.load import load_scenario
from logs.detail import Detail
from logs.story import Story, read_evidence, story_of, tell

pytestmark = pytest.mark.slow
AT_S = 2.5


def faulted(folder: Path, *faults: str, detail: Detail = Detail.MINIMAL, duration_s: float = 4.0) -> Path:
    options = RunOptions(out=folder, duration_s=duration_s, quiet=True, detail=detail)
    run_scenario(load_scenario("sliding-door", (), faults), options)
    return folder / "run.rrd"


@pytest.mark.parametrize(
    ("fault", "node", "words"),
    [
        ("over-current:node=23", "shoulder", "over current"),
        ("over-current:node=12", "wheel_right", "over current"),
        ("encoder-lost:node=27", "wrist_tilt", "sensor"),
        ("following-error:node=22,amount=0", "tower_lift", "fault of drive tower_lift: EMCY 8"),
        ("drive-reboot:node=25", "elbow", "fell silent"),
        ("bus-off:node=26", "lower_arm", "fell silent"),
        ("planner-killed", "planner", "the planner fell silent"),
        ("strategic-killed", "strategic", "the strategic node fell silent"),
        ("sync-loss", None, "SYNC was lost"),
        ("babbling-idiot:for_s=0.3", None, "the bus was full"),
    ],
)
def test_the_story_names_the_fault_that_was_injected(fault: str, node: str | None, words: str, tmp_path: Path) -> None:
    kind, _, parameters = fault.partition(":")
    path = faulted(tmp_path, f"{kind}@{AT_S}" + (f":{parameters}" if parameters else ""))
    story = tell(path)
    assert story.stopped_ns is not None, story.text()
    assert AT_S < story.stopped_ns * 1e-9 < AT_S + 0.6, story.text()
    assert words in story.headline, story.text()
    assert story.node == node, story.text()
    assert story.before, "how the robot stood before"
    assert story.evidence
    assert all("injected" not in event.text for event in story.evidence), "the injector is no witness"


def test_the_witness_is_not_needed(tmp_path: Path) -> None:
    """The same story when the injector's own events are cut out of the evidence."""
    evidence = read_evidence(faulted(tmp_path, f"over-current@{AT_S}:node=24"))
    without = [event for event in evidence.events if event.source != "fault"]
    assert len(without) < len(evidence.events)
    blind = type(evidence)(tuple(without), evidence.states, evidence.series, evidence.joints)
    assert story_of(blind) == story_of(evidence)
    assert story_of(blind).node == "upper_arm"


def test_a_run_that_went_well_has_no_story(tmp_path: Path) -> None:
    assert tell(faulted(tmp_path)) == Story("no fault: the recording ends while all is well", None, None)


def test_the_command_says_it_with_an_exit_code(tmp_path: Path) -> None:
    path = faulted(tmp_path, f"over-current@{AT_S}:node=23", detail=Detail.FULL)
    line = [sys.executable, "-m", "canipulator", "why", str(path.parent)]
    answer = subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)
    assert answer.returncode == 1, answer.stderr
    assert answer.stdout.startswith(f"stopped at {AT_S:.0f}") or answer.stdout.startswith("stopped at 2.5")
    assert "over current" in answer.stdout
    answer = subprocess.run([*line[:-1], "/nowhere"], capture_output=True, text=True, timeout=60, check=False)
    assert answer.returncode == 2
    assert answer.stderr.startswith("canipulator: /nowhere")
