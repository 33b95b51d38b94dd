"""The arithmetic of the slip observer, compiled. States, frames and references: see `stack.planner.observer`."""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.tracking import orthonormalise, rotation_vector

STATES = 8
SLIP_LIMIT = 0.5
"""Bound of an estimated slip ratio."""
_POSITION_WALK, _ROTATION_WALK = 2e-5, 2e-5
"""m/√s, rad/√s of the random walk of `T_RO`."""
_HARMLESS_M, _HARMLESS_RAD = 0.004, 0.008
"""A measurement that is less off than this is never an outlier: it cannot throw the robot, and models are not perfect."""
_GATE = 45.0
"""Squared Mahalanobis distance (6 degrees of freedom) above which a measurement is suspicious: 5e-8 of the good ones are."""


@compiled
def arc_between(x: float, y: float, heading: float, x1: float, y1: float, heading1: float) -> tuple[float, float]:
    """Length and angle of the arc from one platform pose to the next, backwards negative; what is off the arc is left out."""
    turn = heading1 - heading
    half = 0.5 * turn
    direction = heading + half
    chord = math.cos(direction) * (x1 - x) + math.sin(direction) * (y1 - y)
    return chord * (half / math.sin(half) if abs(half) > 1e-6 else 1.0 + half * half / 6.0), turn


@compiled
def along_arc(x: float, y: float, heading: float, way: float, turn: float) -> tuple[float, float, float]:
    half = 0.5 * turn
    chord = way * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0)
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half), heading + turn


@compiled
def lost_of(way: float, turn: float, track: float, left: float, right: float) -> tuple[float, float]:
    """What slip takes from an arc, in metres and radians."""
    arc_left, arc_right = way - 0.5 * track * turn, way + 0.5 * track * turn
    return 0.5 * (arc_left * left + arc_right * right), (arc_right * right - arc_left * left) / track


@compiled
def first_covariance(
    T_RO: Matrix, T_OE: Matrix, x: float, y: float, heading: float, position: float, rotation: float, sigma: float
) -> Matrix:
    """Of the platform's point, as seen from a TCP that is known to the variances `position` and `rotation`."""
    lever = _lever(T_RO, T_OE, x, y)
    W = _cross(lever)
    P = np.zeros((STATES, STATES))
    for i in range(3):
        P[i, i] += position
        P[3 + i, 3 + i] = rotation
        for j in range(3):
            P[i, 3 + j] = P[3 + j, i] = rotation * W[i, j]
        for j in range(i + 1):
            for k in range(3):
                P[i, j] += rotation * W[i, k] * W[j, k]
            P[j, i] = P[i, j]
    P[6, 6] = P[7, 7] = sigma * sigma
    return P


@compiled
def _lever(T_RO: Matrix, T_OE: Matrix, x: float, y: float) -> Vector:
    """From the platform's point to the TCP, in the axes of R (3,)."""
    lever = np.empty(3)
    for i in range(3):
        lever[i] = T_RO[i, 0] * (T_OE[0, 3] - x) + T_RO[i, 1] * (T_OE[1, 3] - y) + T_RO[i, 2] * T_OE[2, 3]
    return lever


@compiled
def _cross(v: Vector) -> Matrix:
    """[v]× (3, 3)."""
    W = np.zeros((3, 3))
    W[0, 1], W[0, 2], W[1, 2] = -v[2], v[1], -v[0]
    W[1, 0], W[2, 0], W[2, 1] = v[2], -v[1], v[0]
    return W


@compiled
def propagate(
    T_RO: Matrix,
    slip: Vector,
    P: Matrix,
    x: float,
    y: float,
    heading: float,
    x_after: float,
    y_after: float,
    heading_after: float,
    dt: float,
    track: float,
    variance: float,
    tau: float,
) -> tuple[Matrix, Vector, Matrix]:
    """One step of odometry: the frame moves by what slip took, slip dies away, the covariance grows."""
    decay = math.exp(-dt / tau)
    mean = 0.5 * (1.0 + decay)
    way, turn = arc_between(x, y, heading, x_after, y_after, heading_after)
    lost, unturned = lost_of(way, turn, track, mean * slip[0], mean * slip[1])
    x1, y1, heading1 = along_arc(x, y, heading, way - lost, turn - unturned)
    # Where odometry has the pose `_after`, R has what (x1, y1, heading1) was mapped to.
    alpha = heading1 - heading_after
    cosine, sine = math.cos(alpha), math.sin(alpha)
    sx = x1 - (cosine * x_after - sine * y_after)
    sy = y1 - (sine * x_after + cosine * y_after)
    moved = np.eye(4)
    for i in range(3):
        moved[i, 0] = T_RO[i, 0] * cosine + T_RO[i, 1] * sine
        moved[i, 1] = T_RO[i, 1] * cosine - T_RO[i, 0] * sine
        moved[i, 2] = T_RO[i, 2]
        moved[i, 3] = T_RO[i, 3] + T_RO[i, 0] * sx + T_RO[i, 1] * sy
    shift = np.empty(3)
    for i in range(3):
        shift[i] = T_RO[i, 0] * (x1 - x) + T_RO[i, 1] * (y1 - y)
    F = np.eye(STATES)
    W = _cross(shift)
    ahead_x, ahead_y = math.cos(heading + 0.5 * turn), math.sin(heading + 0.5 * turn)
    for j in range(2):
        side = 2.0 * j - 1.0
        arc = way + 0.5 * side * track * turn
        along, about = -0.5 * mean * arc, -side * mean * arc / track
        # The yaw that the step loses turns its second half.
        dx = along * ahead_x - 0.5 * way * about * ahead_y
        dy = along * ahead_y + 0.5 * way * about * ahead_x
        for i in range(3):
            F[i, 6 + j] = T_RO[i, 0] * dx + T_RO[i, 1] * dy
            F[3 + i, 6 + j] = T_RO[i, 2] * about
        F[6 + j, 6 + j] = decay
    for i in range(3):
        for j in range(3):
            F[i, 3 + j] = -W[i, j]
    grown = _sandwich(F, P)
    for i in range(3):
        grown[i, i] += _POSITION_WALK * _POSITION_WALK * dt
        grown[3 + i, 3 + i] += _ROTATION_WALK * _ROTATION_WALK * dt
        if i < 2:
            grown[6 + i, 6 + i] += variance * (1.0 - decay * decay)
    return moved, decay * slip, grown


@compiled
def _sandwich(F: Matrix, P: Matrix) -> Matrix:
    """F P Fᵀ, exactly symmetric."""
    n = P.shape[0]
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if F[i, k] != 0.0:
                for j in range(n):
                    half[i, j] += F[i, k] * P[k, j]
    result = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            for k in range(n):
                result[i, j] += half[i, k] * F[j, k]
            result[j, i] = result[i, j]
    return result


@compiled
def take_in(
    T_RO: Matrix,
    slip: Vector,
    P: Matrix,
    T_OE: Matrix,
    x: float,
    y: float,
    heading: float,
    position: Vector,
    rotation: Vector,
    position_variance: float,
    rotation_variance: float,
) -> tuple[Matrix, Vector, Matrix, bool]:
    """The measurement's six components in turn; a suspicious one counts less, as Huber's weight has it, an outlier not at all."""
    off = np.empty(6)
    for i in range(3):
        off[i] = position[i] - T_RO[i, 3]
        for k in range(3):
            off[i] -= T_RO[i, k] * T_OE[k, 3]
    off[3:] = _rotation_between(T_RO, T_OE, rotation)
    lever = _cross(_lever(T_RO, T_OE, x, y))
    error, updated, distance = _filtered(P, off, lever, position_variance, rotation_variance)
    distant = math.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2) > _HARMLESS_M
    turned = math.sqrt(off[3] ** 2 + off[4] ** 2 + off[5] ** 2) > _HARMLESS_RAD
    if not distance < np.inf or (distance > _GATE and (distant or turned)):
        return T_RO, slip, P, False
    if distance > _GATE:
        more = distance / _GATE
        error, updated, _ = _filtered(P, off, lever, more * position_variance, more * rotation_variance)
    corrected = np.eye(4)
    turn = rotation_matrix(error[3:6])
    for i in range(3):
        for j in range(3):
            corrected[i, j] = turn[i, 0] * T_RO[0, j] + turn[i, 1] * T_RO[1, j] + turn[i, 2] * T_RO[2, j]
        # δp is that of the platform's point.
        corrected[i, 3] = T_RO[i, 3] + error[i]
        corrected[i, 3] += (T_RO[i, 0] - corrected[i, 0]) * x + (T_RO[i, 1] - corrected[i, 1]) * y
    orthonormalise(corrected)
    found = np.empty(2)
    for j in range(2):
        found[j] = min(max(slip[j] + error[6 + j], -SLIP_LIMIT), SLIP_LIMIT)
    return corrected, found, updated, True


@compiled
def _rotation_between(T_RO: Matrix, T_OE: Matrix, rotation: Vector) -> Vector:
    """Rotation vector (3,) in R that takes the believed orientation of the TCP to the measured one."""
    measured = rotation_matrix(rotation)
    between = np.zeros((3, 3))
    for i in range(3):
        for k in range(3):
            believed = 0.0
            for m in range(3):
                believed += T_RO[i, m] * T_OE[m, k]
            for j in range(3):
                between[j, i] += measured[j, k] * believed
    return rotation_vector(between)


@compiled
def rotation_matrix(rotation: Vector) -> Matrix:
    """Rotation (3, 3) by the angle |rotation| about the vector (3,) (Rodrigues)."""
    angle = math.sqrt(rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2)
    a = math.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-4 else 0.5
    W = _cross(rotation)
    R = np.eye(3)
    for i in range(3):
        for j in range(3):
            R[i, j] += a * W[i, j]
            for k in range(3):
                R[i, j] += b * W[i, k] * W[k, j]
    return R


@compiled
def _filtered(
    P: Matrix, off: Vector, lever: Matrix, position_variance: float, rotation_variance: float
) -> tuple[Vector, Matrix, float]:
    """Error states (8,), their covariance, and the squared Mahalanobis distance of the innovation `off` (6,)."""
    error = np.zeros(STATES)
    updated = P.copy()
    distance = 0.0
    h, hP, gain = np.zeros(STATES), np.empty(STATES), np.empty(STATES)
    for c in range(6):
        variance = position_variance if c < 3 else rotation_variance
        h[:] = 0.0
        h[c] = 1.0
        if c < 3:
            for k in range(3):
                h[3 + k] = -lever[c, k]
        total, innovation = variance, off[c]
        for j in range(STATES):
            hP[j] = 0.0
            for k in range(STATES):
                hP[j] += h[k] * updated[k, j]
        for j in range(STATES):
            total += hP[j] * h[j]
            innovation -= h[j] * error[j]
        distance += innovation * innovation / total
        for j in range(STATES):
            gain[j] = hP[j] / total
            error[j] += gain[j] * innovation
        left_over = np.eye(STATES)
        for i in range(STATES):
            for j in range(STATES):
                left_over[i, j] -= gain[i] * h[j]
        updated = _sandwich(left_over, updated)
        for i in range(STATES):
            for j in range(STATES):
                updated[i, j] += variance * (gain[i] * gain[j])
    return error, updated, distance
