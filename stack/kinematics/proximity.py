"""How near the robot's links are to each other and to boxes around it, and how that changes with the joints.

Shapes are the collision geometry of the URDF, distances are Coal's (GJK/EPA; negative inside each other).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from stack.kinematics.arm import ArmModel, arm_with_shapes
from stack.kinematics.arrays import Array
from stack.kinematics.robot_file import robot_directory
from stack.kinematics.se3 import rotation_exp

_NEIGHBOURS = 2
"""Links so few joints apart touch by construction."""
_TOLERANCE = 1e-10
"""Coal's own 1e-6 leaves a micrometre, too coarse for a smooth rate."""


class Box(NamedTuple):
    """An obstacle in the reference frame: centre x, y, z, full edge lengths (m), turned by `yaw` (rad) about the vertical."""

    x: float
    y: float
    z: float
    length: float
    width: float
    height: float
    yaw: float = 0.0

    @property
    def pose(self) -> Array:
        """(4, 4)."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_exp(np.array([0.0, 0.0, self.yaw]))
        pose[:3, 3] = self.x, self.y, self.z
        return pose


@dataclass(frozen=True, slots=True, eq=False)
class Proximity:
    """`distance` (m) between the two that `name` says; its rate is `gradient` (n,) · q̇ + `platform` (2,) · (v, ω)."""

    name: str
    distance: float
    gradient: Array
    platform: Array


@dataclass(frozen=True, slots=True, eq=False)
class BodyShape:
    """A link's collision shape with the arm at zero: `kind` box, cylinder or sphere, `size` (edges; radius, length; radius; m),
    `pose` (4, 4) seen from the arm's base, `joint`: how many joints carry it."""

    kind: str
    size: tuple[float, ...]
    pose: Array
    joint: int


@dataclass(frozen=True, slots=True)
class _Body:
    """One link's shape: index in the geometry model, the joint that carries it (0: none), radius of a ball around it."""

    name: str
    index: int
    joint: int
    radius: float


class BodyDistances:
    """Distances for one robot. Pure for its callers; the scratch memory inside belongs to one thread."""

    def __init__(self, arm: ArmModel) -> None:
        urdf = robot_directory(arm.name) / "robot.urdf"
        self._model, self._shapes = arm_with_shapes(urdf, arm.joint_names, arm.description.base_link)
        self._data: Any = self._model.createData()
        self._places: Any = self._shapes.createData()
        self._request = coal.DistanceRequest(True)
        self._request.gjk_tolerance = _TOLERANCE
        self.n = arm.n
        platform = arm.description.platform
        self._base = np.zeros(3) if platform is None else np.array(platform.arm_base)
        bodies = [self._body(i) for i in range(self._shapes.ngeoms)]
        self.carried = tuple(body for body in bodies if body.joint > _NEIGHBOURS)
        """Those that the arm moves and that obstacles are kept from."""
        self._pairs = tuple(
            (first, second)
            for i, first in enumerate(bodies)
            for second in bodies[i + 1 :]
            if abs(first.joint - second.joint) > _NEIGHBOURS and not _rolls(first) and not _rolls(second)
        )
        self._first = np.array([first.index for first, _ in self._pairs])
        self._second = np.array([second.index for _, second in self._pairs])
        self._reach = np.array([first.radius + second.radius for first, second in self._pairs])
        self._carried = np.array([body.index for body in self.carried])
        self._carried_radius = np.array([body.radius for body in self.carried])
        self._middles = np.array([_middle(shape) for shape in self._shapes.geometryObjects])

    @property
    def pairs(self) -> tuple[str, ...]:
        """Names of the pairs that are kept apart."""
        return tuple(f"{first.name} - {second.name}" for first, second in self._pairs)

    @property
    def body_pairs(self) -> frozenset[tuple[int, int]]:
        """The same pairs as positions in `shapes_at_zero`, the smaller first."""
        return frozenset((first.index, second.index) for first, second in self._pairs)

    def shapes_at_zero(self) -> list[BodyShape]:
        """Every shape; ValueError for one that is neither box, cylinder nor sphere."""
        pin.forwardKinematics(self._model, self._data, np.zeros(self.n))
        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._places)
        return [
            BodyShape(*_kind_and_size(shape), np.array(self._places.oMg[i].homogeneous), int(shape.parentJoint))
            for i, shape in enumerate(self._shapes.geometryObjects)
        ]

    def _body(self, index: int) -> _Body:
        shape = self._shapes.geometryObjects[index]
        shape.geometry.computeLocalAABB()
        return _Body(shape.name.rsplit("_", 1)[0], index, int(shape.parentJoint), float(shape.geometry.aabb_radius))

    def near(self, q: Array, within: float, boxes: Sequence[Box] = (), T_AR: Array | None = None) -> list[Proximity]:
        """Every pair nearer than `within` (m) at `q` (n,), own links first, then links and `boxes`.

        `T_AR` (4, 4): the reference frame seen from the arm's base; needed for boxes only.
        """
        pin.computeJointJacobians(self._model, self._data, np.asarray(q, dtype=float))
        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._places)
        centres = np.array([place.act(middle) for place, middle in zip(self._places.oMg, self._middles, strict=True)])
        found = [*self._own(within, centres)]
        if boxes:
            assert T_AR is not None  # the caller places its boxes
            found += self._around(within, boxes, T_AR, centres)
        return found

    def _own(self, within: float, centres: Array) -> Iterator[Proximity]:
        apart = np.linalg.norm(centres[self._first] - centres[self._second], axis=1)
        for i in np.flatnonzero(apart < self._reach + within):
            first, second = self._pairs[i]
            there = self._places.oMg[second.index]
            result = self._distance(first, self._shapes.geometryObjects[second.index].geometry, there)
            if result.min_distance < within:
                rate = self._rate(second, result.getNearestPoint2(), result.normal)
                rate -= self._rate(first, result.getNearestPoint1(), result.normal)
                yield Proximity(f"{first.name} - {second.name}", result.min_distance, rate, np.zeros(2))

    def _around(self, within: float, boxes: Iterable[Box], T_AR: Array, centres: Array) -> Iterator[Proximity]:
        for number, box in enumerate(boxes, start=1):
            shape = coal.Box(box.length, box.width, box.height)
            there = pin.SE3(T_AR @ box.pose)
            reach = 0.5 * float(np.linalg.norm(box[3:6])) + within
            apart = np.linalg.norm(centres[self._carried] - there.translation, axis=1)
            for i in np.flatnonzero(apart < self._carried_radius + reach):
                body = self.carried[i]
                result = self._distance(body, shape, there)
                if result.min_distance < within:
                    point, normal = result.getNearestPoint1(), result.normal
                    x, y, _ = point + self._base
                    # The link rides on the platform: j_v and j_ω of its nearest point (3.14).
                    platform = -np.array([normal[0], x * normal[1] - y * normal[0]])
                    name = f"{body.name} - obstacle {number}"
                    yield Proximity(name, result.min_distance, -self._rate(body, point, normal), platform)

    def _distance(self, body: _Body, shape: Any, there: Any) -> Any:
        here, result = self._places.oMg[body.index], coal.DistanceResult()
        coal.distance(
            self._shapes.geometryObjects[body.index].geometry,
            coal.Transform3s(here.rotation, here.translation),
            shape,
            coal.Transform3s(there.rotation, there.translation),
            self._request,
            result,
        )
        return result

    def _rate(self, body: _Body, point: Array, normal: Array) -> Array:
        """(n,): velocity along `normal` of the point of `body` that is at `point`, by the joints."""
        if body.joint == 0:
            return np.zeros(self.n)
        jacobian = pin.getJointJacobian(self._model, self._data, body.joint, pin.LOCAL_WORLD_ALIGNED)
        lever = point - self._data.oMi[body.joint].translation
        rate: Array = normal @ jacobian[:3] + np.cross(lever, normal) @ jacobian[3:]
        return rate


def _kind_and_size(shape: Any) -> tuple[str, tuple[float, ...]]:
    geometry = shape.geometry
    if isinstance(geometry, coal.Box):
        return "box", tuple(2.0 * float(half) for half in geometry.halfSide)
    if isinstance(geometry, coal.Cylinder):
        return "cylinder", (float(geometry.radius), 2.0 * float(geometry.halfLength))
    if isinstance(geometry, coal.Sphere):
        return "sphere", (float(geometry.radius),)
    raise ValueError(f"shape {shape.name} is a {type(geometry).__name__}, must be a box, a cylinder or a sphere")


def _middle(shape: Any) -> Array:
    """(3,): centre of the ball around a shape, in the shape's own frame."""
    middle: Array = np.array(shape.geometry.aabb_center)
    return middle


def _rolls(body: _Body) -> bool:
    return body.name.startswith(("wheel", "castor"))
