"""Keeping the arm's links off each other: a smooth cost on pairs of spheres that cover the links, exact derivatives, compiled.

The spheres cover the URDF's collision shapes (those of `stack.kinematics.proximity`, the same pairs of links), so where no two of them
meet, no two links do. A pair nearer than the clearance c costs `w (1 − d/c)³`: twice differentiable, w where the spheres touch.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.kinematics.proximity import BodyDistances, BodyShape
from stack.messages import Matrix, Vector
from stack.strategic.trajectory.chain import chain_table
from stack.strategic.trajectory.problem import arm_model

CELL = 1.5
"""Greatest edge of the box that one sphere covers, in half widths of the shape: the spheres stand out by a quarter of a radius."""
SAMPLES = 200


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """`spheres` (S, 5): how many joints carry it, centre in that joint's DH frame, radius (m); `pairs` (M, 2): kept apart."""

    spheres: Matrix
    pairs: NDArray[np.int64]


def no_cover() -> Cover:
    return Cover(np.zeros((0, 5)), np.zeros((0, 2), dtype=np.int64))


@lru_cache(maxsize=16)
def cover(robot: str) -> Cover:
    """Of `robot`'s links; pairs that meet in every one of 200 random configurations meet by construction and are left out.

    ValueError for a shape that is neither box, cylinder nor sphere.
    """
    arm, table = arm_model(robot), chain_table(robot)
    distances = BodyDistances(arm)
    frames = np.empty((arm.n + 1, 4, 4))
    link_frames(table, np.zeros(arm.n), frames)
    rows, owners = [], []
    for body, shape in enumerate(distances.shapes_at_zero()):
        back = np.linalg.inv(frames[shape.joint])
        for centre, radius in _spheres(shape):
            rows.append([float(shape.joint), *(back @ shape.pose @ np.array([*centre, 1.0]))[:3], radius])
            owners.append(body)
    spheres = np.array(rows)
    wanted = distances.body_pairs
    pairs = [(i, j) for i, j in itertools.combinations(range(len(owners)), 2) if (owners[i], owners[j]) in wanted]
    found = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    generator = np.random.default_rng(0)
    widest = np.full(len(found), -np.inf)
    for _ in range(SAMPLES):
        gaps = sphere_gaps(table, generator.uniform(arm.q_min, arm.q_max), spheres, found)
        widest = np.maximum(widest, gaps)
    return Cover(spheres, np.ascontiguousarray(found[widest > 0.0]))


def _spheres(shape: BodyShape) -> list[tuple[Vector, float]]:
    """Centre in the shape's frame and radius of spheres that cover it."""
    if shape.kind == "sphere":
        return [(np.zeros(3), shape.size[0])]
    if shape.kind == "cylinder":
        radius, length = shape.size
        count = math.ceil(length / (CELL * radius))
        across = math.hypot(radius, 0.5 * length / count)
        return [(np.array([0.0, 0.0, z]), across) for z in _middles(length, count)]
    edges = np.array(shape.size)
    counts = [math.ceil(edge / (CELL * 0.5 * edges.min()) - 1e-9) for edge in edges]
    across = 0.5 * float(np.linalg.norm(edges / counts))
    grid = itertools.product(*(_middles(edge, count) for edge, count in zip(edges, counts, strict=True)))
    return [(np.array(centre), across) for centre in grid]


def _middles(length: float, count: int) -> Vector:
    return np.asarray((np.arange(count) + 0.5) * (length / count) - 0.5 * length, np.float64)


@compiled
def link_frames(table: Matrix, q: Vector, frames: NDArray[np.float64]) -> None:
    """Fills `frames` (n + 1, 4, 4): the base and the DH frame behind every joint, base frame."""
    frames[0] = np.eye(4)
    step = np.eye(4)
    for i in range(q.size):
        revolute = table[i, 0] > 0.5
        c, s = (math.cos(q[i]), math.sin(q[i])) if revolute else (1.0, 0.0)
        d = table[i, 1] if revolute else table[i, 1] + q[i]
        a, ca, sa = table[i, 2], table[i, 3], table[i, 4]
        step[0, 0], step[0, 1], step[0, 2], step[0, 3] = c, -s * ca, s * sa, a * c
        step[1, 0], step[1, 1], step[1, 2], step[1, 3] = s, c * ca, -c * sa, a * s
        step[2, 1], step[2, 2], step[2, 3] = sa, ca, d
        frames[i + 1] = frames[i] @ step


@compiled
def _centres(table: Matrix, q: Vector, spheres: Matrix, frames: NDArray[np.float64]) -> Matrix:
    link_frames(table, q, frames)
    centres = np.empty((spheres.shape[0], 3))
    for i in range(spheres.shape[0]):
        frame = frames[int(spheres[i, 0])]
        for r in range(3):
            centres[i, r] = (
                frame[r, 0] * spheres[i, 1] + frame[r, 1] * spheres[i, 2] + frame[r, 2] * spheres[i, 3] + frame[r, 3]
            )
    return centres


@compiled
def sphere_gaps(table: Matrix, q: Vector, spheres: Matrix, pairs: NDArray[np.int64]) -> Vector:
    """(M,) distances (m) of the pairs' surfaces, negative inside each other."""
    centres = _centres(table, q, spheres, np.empty((q.size + 1, 4, 4)))
    gaps = np.empty(pairs.shape[0])
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        gaps[m] = math.sqrt(np.sum((centres[j] - centres[i]) ** 2)) - spheres[i, 4] - spheres[j, 4]
    return gaps


@compiled
def nearness(table: Matrix, q: Vector, spheres: Matrix, pairs: NDArray[np.int64], clearance: float) -> float:
    """Σ (1 − d/c)³ over the pairs nearer than c."""
    centres = _centres(table, q, spheres, np.empty((q.size + 1, 4, 4)))
    total = 0.0
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        reach = spheres[i, 4] + spheres[j, 4]
        x, y, z = centres[j, 0] - centres[i, 0], centres[j, 1] - centres[i, 1], centres[j, 2] - centres[i, 2]
        square = x * x + y * y + z * z
        if square < (reach + clearance) ** 2:
            total += (1.0 - (math.sqrt(square) - reach) / clearance) ** 3
    return total


@compiled
def add_nearness_derivatives(
    table: Matrix, q: Vector, spheres: Matrix, pairs: NDArray[np.int64], clearance: float, weight: float, gradient: Vector, hessian: Matrix
) -> None:  # fmt: skip
    """Adds those of `weight · nearness` to `gradient` (n,) and `hessian` (n, n)."""
    n = q.size
    frames = np.empty((n + 1, 4, 4))
    centres = _centres(table, q, spheres, frames)
    slopes = np.empty((2, n, 3))
    rate, d_rate = np.empty((n, 3)), np.empty(n)
    for m in range(pairs.shape[0]):
        i, j = pairs[m, 0], pairs[m, 1]
        reach = spheres[i, 4] + spheres[j, 4]
        apart = centres[j] - centres[i]
        length = max(math.sqrt(np.sum(apart * apart)), 1e-9)
        near = 1.0 - (length - reach) / clearance
        if near <= 0.0:
            continue
        first = -3.0 * weight / clearance * near * near
        second = 6.0 * weight / clearance**2 * near
        for end in range(2):
            which = i if end == 0 else j
            for k in range(n):
                slopes[end, k] = 0.0
                if k < spheres[which, 0]:
                    axis = frames[k, :3, 2]
                    slopes[end, k] = _cross(axis, centres[which] - frames[k, :3, 3]) if table[k, 0] > 0.5 else axis
        rate[:, :] = slopes[1] - slopes[0]
        for k in range(n):
            d_rate[k] = np.sum(rate[k] * apart) / length
            gradient[k] += first * d_rate[k]
        for k in range(n):
            axis = frames[k, :3, 2]
            for p in range(k, n):
                # ∂²p/∂q_k∂q_p = z_k × ∂p/∂q_p for k before p
                bend = np.sum(_cross(axis, rate[p]) * apart) if table[k, 0] > 0.5 else 0.0
                curvature = (np.sum(rate[k] * rate[p]) - d_rate[k] * d_rate[p] + bend) / length
                change = second * d_rate[k] * d_rate[p] + first * curvature
                hessian[k, p] += change
                if p != k:
                    hessian[p, k] += change


@compiled
def _cross(a: Vector, b: Vector) -> Vector:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
