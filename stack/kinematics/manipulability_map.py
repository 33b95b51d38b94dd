"""Where the eight-joint arm is dexterous: the best manipulability that redundancy can reach, over the workspace.

A shift along the tower and a turn about it change nothing, so the wrist centre's map has one parameter, the radius of D from the tower;
that of the whole hand has four: radius of the TCP, two angles of the tool's axis, and the turn about that axis. The last one is the wrist
pan's own: it changes no singular value, so three are kept.

Maps are made by sampling configurations inside the joint limits and keeping the best of each cell: every entry is a posture that exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.kinematics.arm import ArmModel
from stack.kinematics.arrays import Array
from stack.kinematics.position import elbow_angle

_POSTURE = (2, 3, 4, 5, 6)
"""Joints that matter: SH, UA, EL, LA, WT."""
_BLOCK = 100_000
Advance = Callable[[int], None]


@dataclass(frozen=True, slots=True, eq=False)
class RadiusMap:
    """The wrist centre's map: for each `radius` (k,) of D (m) the largest manipulability (k,) of the 3×5 Jacobian, NaN where out of reach,
    and the posture that has it: `height` (k,) of D above A (m), not negative (mirrored downwards it is as good), and elbow angle
    `phi` (k,) (rad)."""

    radius: Array
    manipulability: Array
    height: Array
    phi: Array

    def best_near(self, radius: float) -> tuple[float, float] | None:
        """(height, φ) of the nearest radius that is in reach; None for an empty map."""
        return _nearest_row(self.radius, self.manipulability, radius, self.height, self.phi)


@dataclass(frozen=True, slots=True, eq=False)
class PoseMap:
    """The hand's map over radius of the TCP (m), elevation of the tool's axis (rad, π/2: straight up) and its azimuth against the radial
    direction (rad): the largest manipulability of the 6×8 Jacobian (k, l, m), NaN where no sample came, and the posture (k, l, m, 5): SH,
    UA, EL, LA, WT. The edges of the cells are `radius`, `elevation`, `azimuth`, one more than cells."""

    radius: Array
    elevation: Array
    azimuth: Array
    manipulability: Array
    posture: Array

    def posture_for(self, T: Array) -> Array | None:
        """(5,): SH, UA, EL, LA, WT of the cell of a TCP pose `T` (4, 4), None where it is empty."""
        cell = cell_of(T, self.radius, self.elevation, self.azimuth)
        if cell is None or not np.isfinite(self.manipulability[cell]):
            return None
        posture: Array = self.posture[cell]
        return posture


def cell_of(T: Array, radius: Array, elevation: Array, azimuth: Array) -> tuple[int, int, int] | None:
    """The cell of a TCP pose, None outside the map."""
    p, z = T[:3, 3], T[:3, 2]
    bearing = math.atan2(p[1], p[0])
    values = (
        math.hypot(p[0], p[1]),
        math.asin(min(max(float(z[2]), -1.0), 1.0)),
        math.remainder(math.atan2(z[1], z[0]) - bearing, 2.0 * math.pi),
    )
    cell = [
        int(np.searchsorted(edges, value, side="right")) - 1
        for edges, value in zip((radius, elevation, azimuth), values, strict=True)
    ]
    sizes = (radius.size - 1, elevation.size - 1, azimuth.size - 1)
    if not all(0 <= i < n for i, n in zip(cell, sizes, strict=True)):
        return None
    return cell[0], cell[1], cell[2]


def radius_map(arm: ArmModel, samples: int = 2_000_000, cells: int = 70, advance: Advance | None = None) -> RadiusMap:
    """One-parameter map from `samples` postures; `advance` hears how many more are done. The same arguments give the same map."""
    lengths = _lengths(arm)
    reach = math.hypot(lengths[0], lengths[1]) + abs(lengths[2])
    edges = np.linspace(0.0, reach, cells + 1)
    best, posture = np.full(cells, -1.0), np.zeros((cells, 5))
    for block in _samples(arm, samples):
        w, place = _wrist_dexterity(block, lengths)
        _keep(w, np.searchsorted(edges, place[:, 0], side="right") - 1, block, best, posture)
        if advance is not None:
            advance(len(block))
    reached = best >= 0.0
    height, phi = np.full(cells, np.nan), np.full(cells, np.nan)
    for i in np.flatnonzero(reached):
        q = np.concatenate(([0.0, 0.0], posture[i], [0.0]))
        height[i], phi[i] = float(arm.points(q)["D"][2]), elbow_angle(arm, q)
    return RadiusMap(0.5 * (edges[1:] + edges[:-1]), np.where(reached, best, np.nan), height, phi)


def pose_map(
    arm: ArmModel, samples: int = 5_000_000, cells: tuple[int, int, int] = (24, 12, 24), advance: Advance | None = None
) -> PoseMap:
    """Full map from `samples` postures; see `radius_map`."""
    lengths = _lengths(arm)
    reach = math.hypot(lengths[0], lengths[1]) + abs(lengths[2]) + abs(lengths[3])
    edges = (
        np.linspace(0.0, reach, cells[0] + 1),
        np.linspace(-0.5 * math.pi, 0.5 * math.pi, cells[1] + 1),
        np.linspace(-math.pi, math.pi, cells[2] + 1),
    )
    count = cells[0] * cells[1] * cells[2]
    best, posture = np.full(count, -1.0), np.zeros((count, 5))
    for block in _samples(arm, samples):
        w, place = _hand_dexterity(block, lengths)
        index = np.zeros(len(block), dtype=np.int64)
        for k in range(3):
            cell = np.clip(np.searchsorted(edges[k], place[:, k], side="right") - 1, 0, cells[k] - 1)
            index = index * cells[k] + cell
        _keep(w, index, block, best, posture)
        if advance is not None:
            advance(len(block))
    return PoseMap(*edges, np.where(best >= 0.0, best, np.nan).reshape(cells), posture.reshape(*cells, 5))


def _samples(arm: ArmModel, count: int) -> Iterator[Array]:
    """Postures (≤ block, 5) inside the limits, always the same ones."""
    random = np.random.default_rng(5)
    low, high = arm.q_min[list(_POSTURE)], arm.q_max[list(_POSTURE)]
    for start in range(0, count, _BLOCK):
        yield random.uniform(low, high, (min(_BLOCK, count - start), 5))


@compiled
def _keep(w: Array, index: NDArray[np.int64], block: Array, best: Array, posture: Array) -> None:
    for i in range(w.shape[0]):
        k = index[i]
        if 0 <= k < best.shape[0] and w[i] > best[k]:
            best[k] = w[i]
            posture[k, :] = block[i, :]


def _nearest_row(radius: Array, value: Array, at: float, height: Array, phi: Array) -> tuple[float, float] | None:
    reached = np.flatnonzero(np.isfinite(value))
    if reached.size == 0:
        return None
    i = reached[np.argmin(np.abs(radius[reached] - at))]
    return float(height[i]), float(phi[i])


def _lengths(arm: ArmModel) -> Array:
    rows = arm.description.joints
    if len(rows) != 8 or rows[1].revolute:
        raise ValueError(f"robot {arm.name} has no tower lift: the map is for the eight-joint arm")
    return np.array([rows[2].d, rows[3].d, rows[5].d, rows[7].d])


@compiled
def _wrist_dexterity(postures: Array, lengths: Array) -> tuple[Array, Array]:
    """(k,) manipulability of the wrist centre, (k, 1) its radius."""
    k = postures.shape[0]
    w, place = np.empty(k), np.empty((k, 1))
    for i in range(k):
        J, p, _ = hand_jacobian(postures[i, 0], postures[i, 1], postures[i, 2], 0.0, 0.0, lengths, False)
        block = np.ascontiguousarray(J[:3, :5])
        # Turned upside down about the shoulder a posture is as good: keep those with D above it.
        w[i] = math.sqrt(max(np.linalg.det(block @ block.T), 0.0)) if p[2] >= 0.0 else -1.0
        place[i, 0] = math.hypot(p[0], p[1])
    return w, place


@compiled
def _hand_dexterity(postures: Array, lengths: Array) -> tuple[Array, Array]:
    """(k,) manipulability of the hand, (k, 3) radius, elevation and azimuth."""
    k = postures.shape[0]
    w, place = np.empty(k), np.empty((k, 3))
    for i in range(k):
        row = postures[i]
        J, p, z = hand_jacobian(row[0], row[1], row[2], row[3], row[4], lengths, True)
        w[i] = math.sqrt(max(np.linalg.det(J @ J.T), 0.0))
        place[i, 0] = math.hypot(p[0], p[1])
        place[i, 1] = math.asin(min(max(z[2], -1.0), 1.0))
        angle = math.atan2(z[1], z[0]) - math.atan2(p[1], p[0])
        place[i, 2] = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return w, place


@compiled
def hand_jacobian(
    sh: float, ua: float, el: float, la: float, wt: float, lengths: Array, hand: bool
) -> tuple[Array, Array, Array]:
    """J (6, 8) in the tower's frame (TR = TL = WP = 0), the point it is of (3,), relative to A, and the tool's axis (3,).

    The point is the TCP, or the wrist centre for `hand` False. `lengths`: d3, d4, d6, d8.
    """
    axes, points = np.zeros((8, 3)), np.zeros((8, 3))
    axes[0, 2] = axes[1, 2] = 1.0
    axes[2, 1] = 1.0
    R = np.eye(3)
    p = np.zeros(3)
    angles = (sh, ua, el, la, wt)
    for i in range(5):
        about_y = i % 2 == 0
        axes[2 + i] = R[:, 1] if about_y else R[:, 2]
        points[2 + i] = p
        c, s = math.cos(angles[i]), math.sin(angles[i])
        turn = np.eye(3)
        if about_y:
            turn[0, 0], turn[0, 2], turn[2, 0], turn[2, 2] = c, s, -s, c
        else:
            turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1] = c, -s, s, c
        R = R @ turn
        if i == 0:
            p = p + lengths[0] * R[:, 1]
        elif i == 1:
            p = p + lengths[1] * R[:, 2]
        elif i == 3:
            p = p + lengths[2] * R[:, 2]
    axes[7] = R[:, 2]
    points[7] = p
    if hand:
        p = p + lengths[3] * R[:, 2]
    J = np.zeros((6, 8))
    for i in range(8):
        if i == 1:
            J[2, 1] = 1.0
            continue
        x, y, z = axes[i]
        rx, ry, rz = p - points[i]
        J[0, i], J[1, i], J[2, i] = y * rz - z * ry, z * rx - x * rz, x * ry - y * rx
        J[3:, i] = axes[i]
    return J, p, R[:, 2].copy()
