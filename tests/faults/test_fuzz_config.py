"""Configuration files that somebody has spoilt: one clear line, never a traceback."""

from __future__ import annotations

import random
import re
import shutil
import sys
from pathlib import Path

import pytest

import stack.kinematics.robot_file as robot_file
from canipulator.cli import main
from config.errors import ConfigError
from config.load import SCENARIO_DIR, load_scenario, scenario_names
from config.robot import load_robot

ROBOTS = robot_file.ROBOTS
VALUES = (
    "nan",
    "-1",
    "1e400",
    '"abc"',
    "[]",
    "{}",
    "true",
    "1979-05-27",
    "9999999999999999999999",
    "[[1]]",
    '""',
    "inf",
    "0",
)


def spoilt(text: str, draw: random.Random) -> str:
    """One thing about a TOML text that is not as it should be."""
    lines = text.splitlines()
    keys = [i for i, line in enumerate(lines) if re.match(r"\s*\w[\w.]*\s*=", line)]
    i = draw.choice(keys)
    key, _, value = lines[i].partition("=")
    how = draw.randrange(8)
    if how == 0:
        lines[i] = f"{key}= {draw.choice(VALUES)}"
    elif how == 1:
        del lines[i]
    elif how == 2:
        lines[i] = f"{key.strip()}x = {value}"
    elif how == 3:
        lines.insert(i, lines[i])
    elif how == 4:
        at = draw.randrange(len(lines[i]) + 1)
        lines[i] = lines[i][:at] + draw.choice('"[]{}=\\#\x00\n.é') + lines[i][at:]
    elif how == 5:
        lines = lines[: draw.randrange(1, len(lines))]
    elif how == 6:
        number = re.search(r"-?\d+(\.\d+)?", value)
        if number is not None:
            changed = draw.choice(("-1e9", "1e9", "-0.5", "0", "nan"))
            lines[i] = f"{key}={value[: number.start()]}{changed}{value[number.end() :]}"
    else:
        del lines[max(0, i - draw.randrange(4)) : i + 1]
    return "\n".join(lines) + "\n"


def one_line(error: ConfigError) -> None:
    text = str(error)
    assert text
    assert "Traceback" not in text
    assert len(" ".join(text.split())) < 400


@pytest.mark.parametrize("name", scenario_names())
def test_spoilt_scenarios(name: str, tmp_path: Path) -> None:
    text = (SCENARIO_DIR / f"{name}.toml").read_text(encoding="utf-8")
    path = tmp_path / "spoilt.toml"
    for seed in range(150):
        path.write_text(spoilt(text, random.Random(seed)), encoding="utf-8")
        try:
            load_scenario(str(path))
        except ConfigError as error:
            one_line(error)


@pytest.mark.parametrize("name", ["robot.toml", "servo.toml", "robot.urdf"])
def test_spoilt_robots(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(ROBOTS / "moma8", tmp_path / "moma8")
    monkeypatch.setattr(robot_file, "ROBOTS", tmp_path)
    path = tmp_path / "moma8" / name
    text = path.read_text(encoding="utf-8")
    refused = 0
    for seed in range(60):
        draw = random.Random(seed)
        path.write_text(spoilt(text, draw) if name.endswith(".toml") else torn(text, draw), encoding="utf-8")
        try:
            load_robot("moma8")
        except ConfigError as error:
            refused += 1
            one_line(error)
    assert refused > 20


def torn(text: str, draw: random.Random) -> str:
    """An XML text with something cut out, doubled, or turned into something else."""
    at = draw.randrange(len(text) - 200)
    how = draw.randrange(3)
    if how == 0:
        return text[:at]
    if how == 1:
        return text[:at] + text[at + draw.randrange(1, 200) :]
    numbers = list(re.finditer(r"-?\d+\.\d+", text))
    number = draw.choice(numbers)
    return text[: number.start()] + draw.choice(("nan", "abc", "", "1e999", "-1")) + text[number.end() :]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--fault", "drive-reboot"],
        ["--fault", "drive-rebot@1"],
        ["--fault", "drive-reboot@x"],
        ["--fault", "drive-reboot@1:node=99"],
        ["--fault", "drive-reboot@1:colour=3"],
        ["--fault", "frame-loss@1:probability=2"],
        ["--fault", "frame-loss@-1"],
        ["--fault", "over-current@1:amount=3"],
        ["--set", "fault.0.kind=frame-loss"],
        ["--set", "fault.1.kind=frame-loss"],
        ["--set", "fault=3"],
        ["--set", "recovery.most=0"],
    ],
)
def test_faults_that_make_no_sense(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["canipulator", "run", "sliding-door", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("canipulator: ")
    assert "\n" not in said


def test_faults_by_set_and_by_option_are_the_same() -> None:
    by_set = load_scenario("sliding-door", ["fault.0.kind=drive-reboot", "fault.0.at=3.2", "fault.0.node=23"])
    by_option = load_scenario("sliding-door", faults=["drive-reboot@3.2:node=23"])
    assert by_set == by_option
