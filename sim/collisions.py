"""Whether the robot touches what it must not: its own links, the floor, and what stands around.

Its own links and the floor are looked at without any force of the physics. Capsules around the links say how near anything is; only what
is nearer than that is asked of PyBullet's own shapes. Joints have a greatest speed, so after a look nothing can touch for a while, and for
that while no look is needed. Contacts with obstacles are those of the physics, forces and all.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sim.bullet import pybullet
from sim.physics import Physics
from sim.rotation import rotation_of
from sim.surroundings import Surroundings
from stack.compiled import compiled
from stack.messages import Matrix, Vector

OVERSPEED = 2.0
"""Times its limit is the fastest that a joint can get: a motor has no torque left there."""
NEAR = 0.05
"""m, how far PyBullet looks for the distance of what the capsules cannot tell apart"""


class Collisions:
    """Call `check` after every step. `ticks`: steps with an unwanted contact; `pairs`: how many of them by the names of what touched."""

    def __init__(self, physics: Physics, surroundings: Surroundings) -> None:
        self.ticks = 0
        self.pairs: dict[str, int] = {}
        self._physics = physics
        self._surroundings = surroundings
        names = physics.names
        hand = (names.force_sensor, names.gripper)
        chain = ["platform", *names.arm, *hand]
        self._links = [-1, *(physics.link[name] for name in (*names.arm, *hand))]
        self._names = dict(zip(self._links, chain, strict=True))
        self._name_of_body = {body: name for name, body in surroundings.obstacles}
        self._name_of_body |= {thing.body: thing.parameters.name for thing in surroundings.objects}
        if surroundings.door is not None:
            self._name_of_body[surroundings.door.body] = "door"
        self._solid = bool(self._name_of_body)
        self._capsules = _capsules(physics.urdf, [physics.base_name, *names.arm, *hand])
        com = physics.com_from_base  # PyBullet says where the platform's centre of mass is, not its frame
        self._capsules[0, :3] = com[:3, :3] @ self._capsules[0, :3] + com[:3, 3]
        self._capsules[0, 3:6] = com[:3, :3] @ self._capsules[0, 3:6]
        self._pairs = np.array([pair for pair in itertools.combinations(range(len(chain)), 2) if _may_touch(*pair)])
        self._frames = np.zeros((len(chain), 7))
        self._distance = np.zeros(len(self._pairs))
        self._height = np.zeros(len(chain) - 1)
        self._speed = OVERSPEED * _closing_speeds(physics, self._links, self._pairs)
        self._fall = OVERSPEED * _closing_speeds(physics, self._links, np.array([(0, i) for i in range(1, len(chain))]))
        self._wait = 0
        self._news: list[str] = []

    def check(self) -> None:
        """Look, where it is time to."""
        if self._wait > 0 and not self._solid:
            self._wait -= 1
            return
        if self._wait > 0:
            self._wait -= 1
            touching: list[str] = []
        else:
            touching, clear_s = self._own_links()
            self._wait = min(int(clear_s / self._physics.parameters.step_s), LONGEST) - 1
        if self._solid:
            touching += self._around()
        if touching:
            self.ticks += 1
            for pair in sorted(set(touching)):
                if pair not in self.pairs:
                    self._news.append(pair)
                self.pairs[pair] = self.pairs.get(pair, 0) + 1

    def news(self) -> list[str]:
        """Pairs that touched for the first time since the last call."""
        news, self._news = self._news, []
        return news

    def _own_links(self) -> tuple[list[str], float]:
        """Names of pairs that touch, and for how long (s) at least no other does."""
        physics, p = self._physics, pybullet
        base = p.getBasePositionAndOrientation(physics.robot, physicsClientId=physics.client)
        states = p.getLinkStates(
            physics.robot, self._links[1:], computeForwardKinematics=1, physicsClientId=physics.client
        )
        self._frames[:] = [(*base[0], *base[1]), *((*state[4], *state[5]) for state in states)]
        clear_s = _look(
            self._frames,
            self._capsules,
            self._pairs,
            self._speed,
            self._fall,
            self._distance,
            self._height,
        )
        return ([], clear_s) if clear_s > 0.0 else self._look_closely()

    def _look_closely(self) -> tuple[list[str], float]:
        """The same where capsules are in each other: there the shapes count."""
        touching = []
        distance, height = self._distance, self._height
        for row in np.flatnonzero(distance <= 0.0).tolist():
            first, second = (self._links[i] for i in self._pairs[row])
            distance[row] = self._shape_distance(self._physics.robot, first, second)
            if distance[row] <= 0.0:
                touching.append(f"{self._names[first]} - {self._names[second]}")
        for row in np.flatnonzero(height <= 0.0).tolist():
            link = self._links[row + 1]
            height[row] = self._shape_distance(self._physics.floor, link, -1)
            if height[row] <= 0.0:
                touching.append(f"{self._names[link]} - floor")
        clear_s = min(float((distance / self._speed).min()), float((height / self._fall).min()))
        return touching, max(clear_s, 0.0)

    def _shape_distance(self, body: int, link: int, other: int) -> float:
        """Of the true shapes, `link` of the robot and `other` of `body`, m; NEAR where that is more."""
        points = pybullet.getClosestPoints(
            self._physics.robot,
            body,
            NEAR,
            linkIndexA=link,
            linkIndexB=other,
            physicsClientId=self._physics.client,
        )
        return min((point[8] for point in points), default=NEAR)

    def _around(self) -> list[str]:
        """Contacts of the physics with anything but the floor, and but those of the gripper with what it holds."""
        physics, around = self._physics, self._surroundings
        gripper = physics.link[physics.names.gripper]
        held = around.gripper.hold.point.body if around.gripper.hold is not None else None
        touching = []
        for contact in pybullet.getContactPoints(bodyA=physics.robot, physicsClientId=physics.client):
            body, link = contact[2], contact[3]
            if body == physics.floor or contact[8] > 0.0 or (link == gripper and body == held):
                continue
            touching.append(f"{self._names.get(link, 'wheel')} - {self._name_of_body.get(body, 'something')}")
        return touching


def _may_touch(first: int, second: int) -> bool:
    """Of platform (0), tower, lift, shoulder … wrist pan (8), force sensor, gripper. Neighbours and the next but one are built together,
    or are kept apart by the limits of the joint between them; what is screwed to the wrist's last link counts as that link."""
    return min(second, WRIST) - min(first, WRIST) > 2


WRIST = 8
LONGEST = 100
"""Steps without a look at most."""


def _closing_speeds(physics: Physics, links: list[int], pairs: Matrix) -> Vector:
    """At most how fast (m/s) the two links of each pair approach with all joints between them at their velocity limits."""
    states = pybullet.getLinkStates(
        physics.robot, links[1:], computeForwardKinematics=1, physicsClientId=physics.client
    )
    origins = np.array([state[4] for state in states])
    steps = np.linalg.norm(np.diff(origins, axis=0), axis=1)  # from each joint to the next
    joints = [pybullet.getJointInfo(physics.robot, link, physicsClientId=physics.client) for link in links[1:]]
    slides = [info[2] == pybullet.JOINT_PRISMATIC for info in joints]
    steps[0] = max(abs(joints[1][8]), abs(joints[1][9])) if slides[1] else steps[0]
    speeds = []
    for first, second in pairs.tolist():
        speed, reach = 0.0, REACH
        for joint in range(second - 1, first - 1, -1):  # the joint that moves link `joint` + 1
            if joint < len(physics.velocity_limit):
                speed += physics.velocity_limit[joint] * (1.0 if slides[joint] else reach)
            reach += steps[joint - 1] if joint else 0.0
        speeds.append(speed)
    bounded: Vector = np.maximum(speeds, 1e-3)
    return bounded


REACH = 0.36
"""m, further than any link's shape goes from its joint, the tower's apart"""


def _capsules(urdf: Path, names: Sequence[str]) -> Matrix:
    """Of each link a capsule around its collision shape: middle, axis in the link's frame, half length, radius; (n, 8).

    From the URDF itself: PyBullet has made a mesh of every cylinder. Raises ValueError for a link without exactly one box, cylinder or
    sphere.
    """
    found: dict[str | None, Vector | None] = {}
    for link in ElementTree.parse(urdf).getroot().findall("link"):
        shapes = link.findall("collision")
        if len(shapes) == 1:
            found[link.get("name")] = _around_shape(shapes[0])
    missing = [name for name in names if found.get(name) is None]
    if missing:
        raise ValueError(f"{urdf}: {', '.join(missing)} must have one box, cylinder or sphere each as collision shape")
    return np.array([found[name] for name in names])


def _around_shape(collision: ElementTree.Element) -> Vector | None:
    origin, geometry = collision.find("origin"), collision.find("geometry")
    if geometry is None or len(geometry) != 1:
        return None
    at, turn = np.zeros(3), np.eye(3)
    if origin is not None:
        at = _numbers(origin.get("xyz", "0 0 0"))
        x, y, z = _numbers(origin.get("rpy", "0 0 0"))
        turn = rotation_of((0.0, 0.0, z)) @ rotation_of((0.0, y, 0.0)) @ rotation_of((x, 0.0, 0.0))
    shape = geometry[0]
    if shape.tag == "box":
        size = _numbers(shape.get("size", ""))
        long = int(np.argmax(size))
        half, radius = 0.5 * float(size[long]), 0.5 * math.hypot(*np.delete(size, long))
        return np.array([*at, *turn[:, long], half, radius])
    if shape.tag == "cylinder":
        half, radius = 0.5 * float(shape.get("length", "")), float(shape.get("radius", ""))
        return np.array([*at, *turn[:, 2], half, radius])
    if shape.tag == "sphere":
        return np.array([*at, *turn[:, 2], 0.0, float(shape.get("radius", ""))])
    return None


def _numbers(text: str) -> Vector:
    return np.array([float(part) for part in text.split()])


@compiled
def _look(
    frames: Matrix, capsules: Matrix, pairs: Matrix, speed: Vector, fall: Vector, distance: Vector, height: Vector
) -> float:
    """Distances (m) of the capsules of all pairs, heights above the floor of all but the first; for how long (s) none gets to 0.

    `frames` (n, 7): position and quaternion of the links; `capsules` (n, 8): middle, axis, half length, radius in them.
    """
    n = frames.shape[0]
    middle, along = np.empty((n, 3)), np.empty((n, 3))
    clear_s = np.inf
    for i in range(n):
        x, y, z, w = frames[i, 3], frames[i, 4], frames[i, 5], frames[i, 6]
        turn = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        for j in range(3):
            middle[i, j] = frames[i, j]
            along[i, j] = 0.0
            for k in range(3):
                middle[i, j] += turn[j, k] * capsules[i, k]
                along[i, j] += turn[j, k] * capsules[i, 3 + k]
        if i > 0:
            height[i - 1] = middle[i, 2] - abs(along[i, 2]) * capsules[i, 6] - capsules[i, 7]
            clear_s = min(clear_s, height[i - 1] / fall[i - 1])
    for row in range(pairs.shape[0]):
        i, j = pairs[row, 0], pairs[row, 1]
        a = b = cosine = gap = 0.0
        for k in range(3):
            r = middle[i, k] - middle[j, k]
            a -= along[i, k] * r
            b += along[j, k] * r
            cosine += along[i, k] * along[j, k]
        # nearest points of two segments (Ericson, Real-Time Collision Detection, 5.1.9), axes of length 1
        sine = 1.0 - cosine * cosine
        s = 0.0
        if sine > 1e-9:
            s = min(max((a + cosine * b) / sine, -capsules[i, 6]), capsules[i, 6])
        t = min(max(b + cosine * s, -capsules[j, 6]), capsules[j, 6])
        s = min(max(a + cosine * t, -capsules[i, 6]), capsules[i, 6])
        for k in range(3):
            gap += (middle[i, k] + s * along[i, k] - middle[j, k] - t * along[j, k]) ** 2
        distance[row] = np.sqrt(gap) - capsules[i, 7] - capsules[j, 7]
        clear_s = min(clear_s, distance[row] / speed[row])
    return clear_s
