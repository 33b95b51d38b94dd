"""servo.toml: what is read, and what is said when it is wrong."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from stack.kinematics import ArmModel
from stack.kinematics.robot_file import robot_directory
from stack.servo import gains, load_servo_parameters


def test_limits_are_those_of_the_robot() -> None:
    parameters, arm = load_servo_parameters("moma8"), ArmModel.load("moma8")
    assert parameters.count == 10
    assert np.array_equal(parameters.lower[2:], arm.q_min)
    assert np.array_equal(parameters.upper[2:], arm.q_max)
    assert np.array_equal(parameters.torque_limit[2:], arm.effort_max)
    assert np.isinf(parameters.upper[:2]).all()
    assert (parameters.velocity_limit[2:] > arm.dq_max).all()
    assert list(parameters.outputs_velocity) == [True, True] + [False] * 8


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of moma8's folder that can be spoilt."""
    copy = tmp_path / "moma8"
    shutil.copytree(robot_directory("moma8"), copy)
    monkeypatch.setattr(gains, "robot_directory", lambda name: copy)
    return copy / "servo.toml"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("position_gain = [0, 0, 12,", "position_gain = [0, 12,", "position_gain must have 10 entries, has 9"),
        ("velocity_headroom", "velocity_headrom", "unknown velocity_headrom"),
        ('"tower_lift"', '"lift"', "axes"),
        ("stop_deceleration = [7,", "stop_deceleration = [-7,", "stop_deceleration"),
    ],
)
def test_a_broken_file_is_told_by_field(robot: Path, old: str, new: str, said: str) -> None:
    text = robot.read_text()
    assert old in text
    robot.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=said):
        load_servo_parameters("moma8")


def test_a_robot_without_servo_settings_is_named() -> None:
    with pytest.raises(ValueError, match="iiwa14 has no servo settings"):
        load_servo_parameters("iiwa14")
