"""Rigid-motion arithmetic of one arm cycle, compiled: where the TCP shall be seen from the arm, and the twist that takes it there.

Same results as `stack.kinematics.se3` (the tests compare), at a hundredth of its cost. Poses (4, 4), twists (6,) `[v; ω]`.
"""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector


@compiled
def desired_in_arm(T_RO: Matrix, x: float, y: float, heading: float, base: Vector, X_RE: Matrix) -> Matrix:
    """T_AE (4, 4): the commanded TCP pose `X_RE` seen from the arm's base, which stands at `base` (3,) on a platform at
    (x, y, heading) of the odometry frame O; `T_RO` carries O into the reference frame R."""
    result = np.eye(4)
    cosine, sine = math.cos(heading), math.sin(heading)
    in_o = np.empty((3, 4))
    for i in range(3):
        for j in range(4):
            value = 0.0
            for k in range(3):
                entry = X_RE[k, j] - T_RO[k, 3] if j == 3 else X_RE[k, j]
                value += T_RO[k, i] * entry
            in_o[i, j] = value
    in_o[0, 3] -= x
    in_o[1, 3] -= y
    for j in range(4):
        result[0, j] = cosine * in_o[0, j] + sine * in_o[1, j]
        result[1, j] = cosine * in_o[1, j] - sine * in_o[0, j]
        result[2, j] = in_o[2, j]
    for i in range(3):
        result[i, 3] -= base[i]
    return result


@compiled
def arm_in_odometry(x: float, y: float, heading: float, base: Vector, T_AE: Matrix) -> Matrix:
    """T_OE (4, 4) of a TCP pose seen from the arm's base; the inverse of `desired_in_arm` for T_RO = identity."""
    result = np.eye(4)
    cosine, sine = math.cos(heading), math.sin(heading)
    for j in range(4):
        along = T_AE[0, j] + (base[0] if j == 3 else 0.0)
        across = T_AE[1, j] + (base[1] if j == 3 else 0.0)
        result[0, j] = cosine * along - sine * across
        result[1, j] = sine * along + cosine * across
        result[2, j] = T_AE[2, j]
    result[0, 3] += x
    result[1, 3] += y
    result[2, 3] += base[2]
    return result


@compiled
def _logarithm(R: Matrix) -> tuple[Vector, float]:
    """Rotation vector (3,) and angle of a rotation (3, 3)."""
    w = np.empty(3)
    w[0] = 0.5 * (R[2, 1] - R[1, 2])
    w[1] = 0.5 * (R[0, 2] - R[2, 0])
    w[2] = 0.5 * (R[1, 0] - R[0, 1])
    sine = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-6:
        for i in range(3):
            w[i] *= angle / sine
    elif cosine < 0.0:
        largest = 0
        for i in range(1, 3):
            if R[i, i] > R[largest, largest]:
                largest = i
        norm = 0.0
        for i in range(3):
            w[i] = 0.5 * (R[i, largest] + R[largest, i]) + (1.0 if i == largest else 0.0)
            norm += w[i] * w[i]
        for i in range(3):
            w[i] *= angle / math.sqrt(norm)
    return w, angle


@compiled
def rotation_vector(T: Matrix) -> Vector:
    """(3,) of the rotation of a pose (4, 4)."""
    return _logarithm(T[:3, :3])[0]


@compiled
def body_twist(T_from: Matrix, T_to: Matrix) -> Vector:
    """log(T_from⁻¹ T_to) (6,): the constant twist, in the axes of `T_from`, that takes it to `T_to` in unit time.

    Accurate for turns up to a little below π; at π the axis comes from the largest diagonal element.
    """
    R = np.empty((3, 3))
    p = np.zeros(3)
    for i in range(3):
        for j in range(3):
            value = 0.0
            for k in range(3):
                value += T_from[k, i] * T_to[k, j]
            R[i, j] = value
        for k in range(3):
            p[i] += T_from[k, i] * (T_to[k, 3] - T_from[k, 3])
    w, angle = _logarithm(R)
    half = 0.5 * angle
    factor = 1.0 / 12.0 + angle * angle / 720.0 if angle < 1e-3 else (1.0 - half / math.tan(half)) / (angle * angle)
    result = np.empty(6)
    cx = w[1] * p[2] - w[2] * p[1]
    cy = w[2] * p[0] - w[0] * p[2]
    cz = w[0] * p[1] - w[1] * p[0]
    result[0] = p[0] - 0.5 * cx + factor * (w[1] * cz - w[2] * cy)
    result[1] = p[1] - 0.5 * cy + factor * (w[2] * cx - w[0] * cz)
    result[2] = p[2] - 0.5 * cz + factor * (w[0] * cy - w[1] * cx)
    result[3:] = w
    return result


@compiled
def follow_path(
    T_RO: Matrix,
    T_AE: Matrix,
    X_RE: Matrix,
    x: float,
    y: float,
    heading: float,
    x_ahead: float,
    y_ahead: float,
    heading_ahead: float,
    base: Vector,
    twist: Vector,
    gain: float,
    patience_m: float,
    patience_rad: float,
    dt: float,
) -> tuple[Vector, Vector, float]:
    """What the arm has to do in the next `dt` s so that the TCP goes on from `X_RE` at `twist` although the platform moves from
    pose (x, y, heading) to the one `_ahead`: its twist (6,) in the axes of `T_AE`, where its TCP is now seen from its base; what of that
    works off the present deviation (6,), at the rate `gain`; and the patience.

    Patience is the share of `twist`, 1 to 0, while the set points are off the path by more than `patience_m` or `patience_rad`, 0 from
    twice as much on: an arm that cannot follow makes the path wait, wherever it is, instead of cutting the corner later. It is 1 for a
    twist that brings the path back to the set points: who turns round where the arm could not go is not held there.
    """
    desired = desired_in_arm(T_RO, x, y, heading, base, X_RE)
    off = body_twist(T_AE, desired)
    distance = math.sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2])
    angle = math.sqrt(off[3] * off[3] + off[4] * off[4] + off[5] * off[5])
    patience = min(1.0, max(0.0, 2.0 - max(distance / patience_m, angle / patience_rad)))
    if patience < 1.0:
        apart = 0.0
        for i in range(3):
            apart += off[i] * twist[i] / (patience_m * patience_m) + off[i + 3] * twist[i + 3] / (
                patience_rad * patience_rad
            )
        if apart < 0.0:
            patience = 1.0
    ahead = desired_in_arm(T_RO, x_ahead, y_ahead, heading_ahead, base, moved(X_RE, patience * twist, dt))
    relative = body_twist(desired, ahead)
    deviation = gain * off
    for i in range(6):
        relative[i] = relative[i] / dt + deviation[i]
    return relative, deviation, patience


@compiled
def moved(T: Matrix, twist: Vector, dt: float) -> Matrix:
    """T exp(twist·dt) (4, 4): after `dt` s at the body twist; re-orthonormalised, so that it may be repeated for hours."""
    w = twist[3:] * dt
    v = twist[:3] * dt
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if angle < 1e-4:
        a, b, c = 1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0, 1.0 / 6.0 - angle * angle / 120.0
    else:
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / (angle * angle)
        c = (1.0 - a) / (angle * angle)
    W = np.zeros((3, 3))
    W[0, 1], W[0, 2], W[1, 0] = -w[2], w[1], w[2]
    W[1, 2], W[2, 0], W[2, 1] = -w[0], -w[1], w[0]
    WW = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                WW[i, j] += W[i, k] * W[k, j]
    result = np.eye(4)
    for i in range(3):
        along = 0.0
        for j in range(3):
            turn = a * W[i, j] + b * WW[i, j] + (1.0 if i == j else 0.0)
            shift = b * W[i, j] + c * WW[i, j] + (1.0 if i == j else 0.0)
            along += shift * v[j]
            for k in range(3):
                result[k, j] += T[k, i] * turn - (1.0 if i == j and k == j else 0.0)
        for k in range(3):
            result[k, 3] += T[k, i] * along
    for k in range(3):
        result[k, 3] += T[k, 3]
    orthonormalise(result)
    return result


@compiled
def orthonormalise(T: Matrix) -> None:
    """Gram-Schmidt on the columns of the rotation, in place."""
    for j in range(3):
        for i in range(j):
            dot = T[0, i] * T[0, j] + T[1, i] * T[1, j] + T[2, i] * T[2, j]
            for k in range(3):
                T[k, j] -= dot * T[k, i]
        norm = math.sqrt(T[0, j] ** 2 + T[1, j] ** 2 + T[2, j] ** 2)
        for k in range(3):
            T[k, j] /= norm
