"""How near the robot's links are to each other and to boxes around it, and how that changes with the joints.

Shapes are the collision geometry of the URDF, distances are Coal's (GJK/EPA; negative inside each other).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from stack.kinematics.arm import ArmModel, arm_with_shapes
from stack.kinematics.arrays import Array
from stack.kinematics.robot_file import robot_directory

_NEIGHBOURS = 2
"""Links so few joints apart touch by construction."""
_TOLERANCE = 1e-10
"""Coal's own 1e-6 leaves a micrometre, too coarse for a smooth rate."""


DOOR = "door"
"""What pairs with a door's leaf are called after."""


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
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return np.array(
            [[cosine, -sine, 0.0, self.x], [sine, cosine, 0.0, self.y], [0.0, 0.0, 1.0, self.z], [0.0, 0.0, 0.0, 1.0]]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Proximity:
    """`distance` (m) between the two that `name` says; its rate is `gradient` (n,) · q̇ + `platform` (2,) · (v, ω).

    `point` (3,): the nearest point of the second one, `normal` (3,): from the first to the second, in the arm's base frame.
    """

    name: str
    distance: float
    gradient: Array
    platform: Array
    point: Array
    normal: Array


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


@dataclass(frozen=True, slots=True, eq=False)
class _Around:
    """Bodies that are kept from things around: their positions among the shapes, and radii."""

    bodies: tuple[_Body, ...]
    indices: Array
    radii: Array

    @staticmethod
    def of(chosen: Iterable[_Body]) -> _Around:
        bodies = tuple(chosen)
        return _Around(bodies, np.array([body.index for body in bodies]), np.array([body.radius for body in bodies]))


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
        self.base = np.zeros(3) if platform is None else np.array(platform.arm_base)
        """(3,): where the arm stands on the platform, m."""
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
        self._from_boxes = _Around.of(self.carried)
        self._from_doors = _Around.of(body for body in bodies if body.joint < self.n and not _rolls(body))
        self._middles = np.array([_middle(shape) for shape in self._shapes.geometryObjects])
        self._geometry: list[Any] = [shape.geometry for shape in self._shapes.geometryObjects]
        self._transforms: list[Any] = [None] * len(self._geometry)

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

    def near(
        self,
        q: Array,
        within: float,
        boxes: Sequence[Box] = (),
        T_AR: Array | None = None,
        door: Box | None = None,
    ) -> list[Proximity]:
        """Every pair nearer than `within` (m) at `q` (n,), own links first, then links and `boxes`, then the whole robot without its
        hand and wheels and the leaf of a `door`, taken as standing still.

        `T_AR` (4, 4): the reference frame seen from the arm's base; needed for boxes and doors only.
        """
        pin.computeJointJacobians(self._model, self._data, np.asarray(q, dtype=float))
        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._places)
        self._transforms = [None] * len(self._geometry)
        centres = np.array([place.act(middle) for place, middle in zip(self._places.oMg, self._middles, strict=True)])
        found = [*self._own(within, centres)]
        things = [(f"obstacle {number}", box, self._from_boxes) for number, box in enumerate(boxes, start=1)]
        if door is not None:
            things.append((DOOR, door, self._from_doors))
        if things:
            assert T_AR is not None  # the caller places its boxes
            found += self._around(within, things, T_AR, centres)
        return found

    def _own(self, within: float, centres: Array) -> Iterator[Proximity]:
        apart = np.linalg.norm(centres[self._first] - centres[self._second], axis=1)
        for i in np.flatnonzero(apart < self._reach + within):
            first, second = self._pairs[i]
            result = self._distance(first, self._geometry[second.index], self._transform(second))
            if result.min_distance < within:
                rate = self._rate(second, result.getNearestPoint2(), result.normal)
                rate -= self._rate(first, result.getNearestPoint1(), result.normal)
                point, normal = result.getNearestPoint2(), result.normal
                yield Proximity(f"{first.name} - {second.name}", result.min_distance, rate, np.zeros(2), point, normal)

    def _around(
        self, within: float, things: Iterable[tuple[str, Box, _Around]], T_AR: Array, centres: Array
    ) -> Iterator[Proximity]:
        """`things`: name, box, and what is kept from it."""
        for name, box, kept in things:
            shape = coal.Box(box.length, box.width, box.height)
            pose = T_AR @ box.pose
            there = coal.Transform3s(pose[:3, :3], pose[:3, 3])
            inside = abs((centres[kept.indices] - pose[:3, 3]) @ pose[:3, :3]) - 0.5 * np.array(box[3:6])
            apart = np.linalg.norm(np.maximum(inside, 0.0), axis=1)
            for i in np.flatnonzero(apart < kept.radii + within):
                body = kept.bodies[i]
                result = self._distance(body, shape, there)
                if result.min_distance < within:
                    point, normal = result.getNearestPoint1(), result.normal
                    x, y, _ = point + self.base
                    # The link rides on the platform: j_v and j_ω of its nearest point (3.14).
                    platform = -np.array([normal[0], x * normal[1] - y * normal[0]])
                    rate = -self._rate(body, point, normal)
                    there_point = result.getNearestPoint2()
                    yield Proximity(f"{body.name} - {name}", result.min_distance, rate, platform, there_point, normal)

    def _distance(self, body: _Body, shape: Any, there: Any) -> Any:
        result = coal.DistanceResult()
        coal.distance(self._geometry[body.index], self._transform(body), shape, there, self._request, result)
        return result

    def _transform(self, body: _Body) -> Any:
        """Where a body is, as Coal wants it; made once in a call of `near`."""
        transform = self._transforms[body.index]
        if transform is None:
            here = self._places.oMg[body.index]
            transform = self._transforms[body.index] = coal.Transform3s(here.rotation, here.translation)
        return transform

    def _rate(self, body: _Body, point: Array, normal: Array) -> Array:
        """(n,): velocity along `normal` of the point of `body` that is at `point`, by the joints."""
        if body.joint == 0:
            return np.zeros(self.n)
        jacobian = pin.getJointJacobian(self._model, self._data, body.joint, pin.LOCAL_WORLD_ALIGNED)
        x, y, z = (point - self._data.oMi[body.joint].translation).tolist()
        a, b, c = normal.tolist()
        wrench = np.array([a, b, c, y * c - z * b, z * a - x * c, x * b - y * a])  # np.cross takes ten times as long
        rate: Array = wrench @ jacobian
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
