"""A serial arm: pose, Jacobians and dynamics from its URDF, by Pinocchio, in the arm's own base frame.

Joint angles are those of the DH rows in robot.toml. Everything is SI; twists are `[v; ω]`, wrenches `[f; m]`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from stack.kinematics.arrays import Array, finite, frozen
from stack.kinematics.robot_file import RobotFile, read_robot_file, robot_directory

GRAVITY = 9.81


@dataclass(frozen=True, slots=True)
class ArmState:
    """What one forward pass gives: `q` (n,), TCP `pose` (4, 4) and `jacobian` (6, n), both in the arm's base frame."""

    q: Array
    pose: Array
    jacobian: Array

    @property
    def rotation(self) -> Array:
        """(3, 3), end-point axes as columns."""
        return self.pose[:3, :3]

    @property
    def position(self) -> Array:
        """(3,) of the TCP."""
        return self.pose[:3, 3]

    @property
    def end_point_jacobian(self) -> Array:
        """(6, n): the same twist, written in the axes of the end-point frame."""
        return turned_rows(self.pose[:3, :3].T, self.jacobian)


def turned_rows(rotation: Array, jacobian: Array) -> Array:
    """Both halves of a (6, k) Jacobian multiplied by one (3, 3) rotation."""
    k = jacobian.shape[1]
    turned: Array = (rotation @ jacobian.reshape(2, 3, k)).reshape(6, k)
    return turned


class ArmModel:
    """One arm, its platform locked away; the base frame is the arm's, fixed under the first joint.

    Pure for its callers: no input is modified and every result is a fresh array. The scratch memory inside is reused,
    so one instance belongs to one thread. Every method raises ValueError for a wrong shape or a number that is not
    finite.

    Attributes: `name`, `description` (the robot file), `n`, `joint_names`, and read-only vectors (n,): `q_min`,
    `q_max`, `dq_max`, `ddq_max`, `effort_max` (peak), `effort_rated`, `home`, `preferred`, `padding` (width of the
    padding zone inside each limit, rad or m).
    """

    def __init__(self, description: RobotFile, urdf: Path) -> None:
        self.description = description
        self.name = description.name
        rows = description.joints
        self.n = len(rows)
        self.joint_names = tuple(row.name for row in rows)
        self._model, base = _arm_only(urdf, self.joint_names, description.base_link)
        self._data: Any = self._model.createData()
        self._gravity = base.rotation.T @ np.array([0.0, 0.0, -GRAVITY])
        self._still = np.zeros(self.n)
        self._no_acceleration = np.zeros(3)
        self._tcp = self._frame(description.tcp_link)
        self._wrist = None if description.wrist_link is None else self._frame(description.wrist_link)
        self._points = {point: self._frame(link) for point, link in description.points.items()}
        self.q_min, self.q_max = frozen(self._model.lowerPositionLimit), frozen(self._model.upperPositionLimit)
        self.dq_max, self.effort_max = frozen(self._model.velocityLimit), frozen(self._model.effortLimit)
        self.ddq_max = frozen([row.acceleration for row in rows])
        self.effort_rated = frozen([row.rated_effort for row in rows])
        self.home, self.preferred = frozen(description.home), frozen(description.preferred)
        self.padding = frozen(description.padding * (self.q_max - self.q_min))

    @classmethod
    def load(cls, name: str) -> ArmModel:
        """The robot under config/robots/<name>; ValueError lists the known ones."""
        directory = robot_directory(name)
        return cls(read_robot_file(directory / "robot.toml"), directory / "robot.urdf")

    def state(self, q: ArrayLike) -> ArmState:
        """Pose and Jacobian from one forward pass: the control cycle's call."""
        q = np.array(self._checked(q))
        pin.computeJointJacobians(self._model, self._data, q)
        pose = pin.updateFramePlacement(self._model, self._data, self._tcp).homogeneous
        jacobian = pin.getFrameJacobian(self._model, self._data, self._tcp, pin.LOCAL_WORLD_ALIGNED)
        return ArmState(q, pose, jacobian)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) of the TCP in the arm's base frame."""
        pin.forwardKinematics(self._model, self._data, self._checked(q))
        pose: Array = pin.updateFramePlacement(self._model, self._data, self._tcp).homogeneous
        return pose

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, n), rows `[v; ω]` of the TCP in the axes of the arm's base frame."""
        return self._frame_jacobian(q, self._tcp, pin.LOCAL_WORLD_ALIGNED)

    def end_point_jacobian(self, q: ArrayLike) -> Array:
        """(6, n), rows `[v; ω]` of the TCP in the axes of the end-point frame."""
        return self._frame_jacobian(q, self._tcp, pin.LOCAL)

    def wrist_jacobian(self, q: ArrayLike) -> Array:
        """(3, k): velocity of the wrist centre by the k joints before the wrist (moma8: 5), arm's base frame.

        ValueError if the robot has no wrist whose axes meet in a point.
        """
        if self._wrist is None:
            raise ValueError(f"robot {self.name} has no spherical wrist, hence no wrist centre")
        whole = self._frame_jacobian(q, self._wrist, pin.LOCAL_WORLD_ALIGNED)
        return np.ascontiguousarray(whole[:3, : self.description.first_wrist_joint])

    def points(self, q: ArrayLike) -> dict[str, Array]:
        """Named points (3,) in the arm's base frame; moma8: A, B, C, D (wrist centre), E (TCP)."""
        pin.forwardKinematics(self._model, self._data, self._checked(q))
        placed = {name: pin.updateFramePlacement(self._model, self._data, i) for name, i in self._points.items()}
        return {name: np.array(placement.translation) for name, placement in placed.items()}

    def joint_positions(self, q: ArrayLike) -> Array:
        """(n + 1, 3): origins of the joints' frames in the order of the chain, then the TCP; for drawing."""
        pin.forwardKinematics(self._model, self._data, self._checked(q))
        tcp = pin.updateFramePlacement(self._model, self._data, self._tcp).translation
        return np.array([*(self._data.oMi[i].translation for i in range(1, self.n + 1)), tcp])

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        base_acceleration: ArrayLike | None = None,
        wrench: ArrayLike | None = None,
    ) -> Array:
        """Joint torques and forces (n,) that produce `ddq`, gripper and gravity included, friction not.

        `base_acceleration` (3,): linear acceleration of the arm's base frame over ground, in that frame's axes; it acts
        like a change of gravity. A base that also yaws about a first joint's vertical axis is exactly a faster first
        joint: add the yaw rate and acceleration to `dq[0]` and `ddq[0]`.
        `wrench` (6,): force and torque from outside at the TCP, in the end-point frame.
        """
        q, dq, ddq = self._checked(q), finite("dq", dq, (self.n,)), finite("ddq", ddq, (self.n,))
        self._set_gravity(base_acceleration)
        effort: Array = np.array(pin.rnea(self._model, self._data, q, dq, ddq))
        if wrench is not None:
            effort -= self.end_point_jacobian(q).T @ finite("wrench", wrench, (6,))
        return effort

    def gravity(self, q: ArrayLike) -> Array:
        """Torques (n,) that hold the arm still."""
        return self.inverse_dynamics(q, self._still, self._still)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """(n, n), symmetric positive definite, kg·m² (kg, kg·m with the lift)."""
        mass: Array = np.triu(pin.crba(self._model, self._data, self._checked(q)))
        return mass + np.triu(mass, 1).T

    def _checked(self, q: ArrayLike) -> Array:
        return finite("q", q, (self.n,))

    def _frame(self, link: str) -> int:
        index: int = self._model.getFrameId(_LINK + link)
        if index >= self._model.nframes:
            raise ValueError(f"robot {self.name}: link {link} of robot.toml is not in the URDF")
        return index

    def _frame_jacobian(self, q: ArrayLike, frame: int, axes: Any) -> Array:
        jacobian: Array = pin.computeFrameJacobian(self._model, self._data, self._checked(q), frame, axes)
        return jacobian

    def _set_gravity(self, base_acceleration: ArrayLike | None) -> None:
        if base_acceleration is None:
            self._model.gravity.linear = self._gravity
        else:
            self._model.gravity.linear = self._gravity - finite("base_acceleration", base_acceleration, (3,))


_LINK = "link/"


def _arm_only(urdf: Path, joints: tuple[str, ...], base_link: str) -> tuple[Any, Any]:
    """Pinocchio model of the named joints alone, its universe moved to the arm's base, and where that base was."""
    model = _whole(urdf)
    model = pin.buildReducedModel(model, _others(model, joints), pin.neutral(model))
    if tuple(model.names[1:]) != joints:
        raise ValueError(f"{urdf}: joints {tuple(model.names[1:])} differ from robot.toml's {joints}")
    base = model.frames[model.getFrameId(_LINK + base_link)].placement.copy()
    model.jointPlacements[1] = base.actInv(model.jointPlacements[1])
    return model, base


def arm_with_shapes(urdf: Path, joints: tuple[str, ...], base_link: str) -> tuple[Any, Any]:
    """The same model and the collision shapes of the URDF on it, those of the platform fixed to the universe."""
    shapes: Any = pin.buildGeomFromUrdf(pin.buildModelFromUrdf(str(urdf)), str(urdf), pin.GeometryType.COLLISION)
    model = _whole(urdf)
    _, shapes = pin.buildReducedModel(model, shapes, _others(model, joints), pin.neutral(model))
    arm, base = _arm_only(urdf, joints, base_link)
    for shape in shapes.geometryObjects:
        if shape.parentJoint == 0:
            shape.placement = base.actInv(shape.placement)
    return arm, shapes


def _whole(urdf: Path) -> Any:
    model: Any = pin.buildModelFromUrdf(str(urdf))
    for frame in model.frames:
        # A link and a joint may share a name in URDF; Pinocchio keeps both in one list of frames.
        if frame.type == pin.FrameType.BODY:
            frame.name = _LINK + frame.name
    return model


def _others(model: Any, joints: tuple[str, ...]) -> list[Any]:
    return [model.getJointId(name) for name in model.names[1:] if name not in joints]
