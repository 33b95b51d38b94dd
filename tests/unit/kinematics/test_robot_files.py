"""config/robots: what is checked in is what is generated, and the robot stands and can be built."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from config.robots.generate import urdf_text
from stack.kinematics import ArmModel
from stack.kinematics.robot_file import ROBOTS, read_robot_file

FILES = sorted(ROBOTS.glob("*/robot.toml"))
MOMA8 = ROBOTS / "moma8" / "robot.urdf"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.parent.name)
def test_checked_in_urdf_is_the_generated_one(path: Path) -> None:
    spec = read_robot_file(path)
    assert spec.name == path.parent.name
    assert path.with_name("robot.urdf").read_text(encoding="utf-8") == urdf_text(spec), (
        "run `python -m config.robots.generate`"
    )


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.parent.name)
def test_every_link_has_a_possible_inertia(path: Path) -> None:
    """Positive principal moments that obey the triangle inequality; PyBullet would invent what is missing."""
    for link in ET.parse(path.with_name("robot.urdf")).iter("link"):
        tensor = link.find("inertial/inertia")
        assert tensor is not None, link.get("name")
        moments = [float(tensor.attrib[key]) for key in ("ixx", "iyy", "izz")]
        assert float(link.find("inertial/mass").get("value")) > 0
        assert min(moments) > 0
        assert max(moments) <= sum(moments) - max(moments) + 1e-12


def test_parts_of_the_mobile_manipulator_have_their_names() -> None:
    root = ET.parse(MOMA8).getroot()
    assert {link.get("name") for link in root.iter("link")} == {
        "base_link", "wheel_left", "wheel_right", "castor", "arm_base", "tower", "lift", "shoulder", "upper_arm",
        "elbow", "lower_arm", "wrist_tilt", "wrist_pan", "force_sensor", "gripper", "tcp",
    }  # fmt: skip
    kinds = {joint.get("name"): joint.get("type") for joint in root.iter("joint")}
    assert {name for name, kind in kinds.items() if kind == "continuous"} == {"wheel_left_joint", "wheel_right_joint"}
    assert {name for name, kind in kinds.items() if kind == "fixed"} == {
        "arm_base_joint", "castor_joint", "force_sensor_joint", "gripper_joint", "tcp_joint",
    }  # fmt: skip


def test_wheels_and_castor_touch_the_ground_with_spheres() -> None:
    root = ET.parse(MOMA8).getroot()
    origin = {j.find("child").get("link"): j.find("origin").get("xyz").split() for j in root.iter("joint")}
    for name in ("wheel_left", "wheel_right", "castor"):
        shapes = root.findall(f"link[@name='{name}']/collision/geometry/sphere")
        assert len(shapes) == 1
        assert float(shapes[0].get("radius")) == pytest.approx(float(origin[name][2]), abs=1e-12)


def test_wrist_is_heavy_enough_for_explicit_servo_loops(moma8: ArmModel) -> None:
    """Each joint's inertia with the others held: at least 0.01 kg·m² everywhere; loops at 1 kHz rely on it."""
    rng = np.random.default_rng(11)
    held = [np.diag(moma8.mass_matrix(q)) for q in rng.uniform(moma8.q_min, moma8.q_max, (300, 8))]
    assert np.min(held) > 0.01


def test_centre_of_mass_stays_over_the_wheels_and_the_castor() -> None:
    arm = ArmModel.load("moma8")
    model = pin.buildModelFromUrdf(str(MOMA8))
    data, rest, base = model.createData(), pin.neutral(model), model.inertias[0]
    feet = {frame.name: frame.placement.translation[:2] for frame in model.frames if frame.parentJoint == 0}
    track = ArmModel.load("moma8").description.platform.track
    corners = [np.array([0.0, -track / 2]), feet["castor"], np.array([0.0, track / 2])]
    margins = []
    for q in np.random.default_rng(12).uniform(arm.q_min, arm.q_max, (5000, 8)):
        rest[:8] = q
        moving = pin.centerOfMass(model, data, rest)  # without what is fixed to the base
        centre = (data.mass[0] * moving + base.mass * base.lever) / (data.mass[0] + base.mass)
        margins.append(min(_left_of(a, b, centre[:2]) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)))
    assert min(margins) > 0.02


def _left_of(start: np.ndarray, end: np.ndarray, point: np.ndarray) -> float:
    """How far a point lies to the left of a directed edge, m."""
    (x, y), (px, py) = end - start, point - start
    return (x * py - y * px) / float(np.hypot(x, y))


def change(tmp_path: Path, old: str, new: str) -> Path:
    text = (ROBOTS / "moma8" / "robot.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "robot.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("padding = 0.1", "", "key 'padding' is missing"),
        ('type = "revolute"', 'type = "sliding"', "type 'sliding' is neither revolute nor prismatic"),
        ("home = [0.0, ", "home = [", "arm.home has 7 values, the robot has 8 joints"),
        ("lower = 0.35", "lower = 1.35", "joint tower_lift: lower limit 1.35 is not below the upper limit 1.15"),
        ("track = 0.45", "trak = 0.45", "trak"),
        ("wheel_radius = 0.1", 'wheel_radius = "wide"', "wide"),
    ],
)
def test_errors_in_a_robot_file_name_file_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = change(tmp_path, old, new)
    with pytest.raises(ValueError, match=message) as raised:
        read_robot_file(path)
    assert str(path) in str(raised.value)


def test_a_robot_file_that_does_not_fit_its_urdf_is_refused(tmp_path: Path) -> None:
    spec = read_robot_file(change(tmp_path, 'name = "wrist_pan"', 'name = "wrist_roll"'))
    with pytest.raises(ValueError, match=r"differ from robot\.toml"):
        ArmModel(spec, MOMA8)
