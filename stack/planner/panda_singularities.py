"""The singular manifolds of the Panda, from the one wrench that no joint can feel.

J loses rank where a wrench has no moment about any of the seven axes. Axes 1–3 meet in the shoulder S; axes 3 and 5
with S and with W (axis 5 ∩ axis 6) lie in the plane Π across axis 4.

If q2 ≠ 0, π, axes 1–3 are independent and the wrench is a force through S that meets axes 4–7. It meets 5 and 6 because
- it runs through W ("elbow": for axis 4 the three points S, axis 4, W are in line, which fixes q4; axis 7 is left),
- axis 6 lies in Π ("wrist": q5 = ±π/2; the force runs from S through axis 4; axis 7 is left), or
- S lies on axis 5 ("in_line": fixes q4; the force has to meet axes 4, 6 and 7; outside the maker's joint limits).
If q2 = 0 or π, a moment across axes 1 and 2 is free as well, and both have to miss axes 4–7 ("shoulder").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from stack.kinematics.robot_file import JointRow
from stack.planner.singular_sets import AngleIs, Angles, Fourier, SingularSet, ZeroOf

Vector3 = tuple[Fourier, Fourier, Fourier]
HALF = math.pi / 2
TURN = 2 * math.pi
Q2, Q3, Q4, Q5 = 1, 2, 3, 4


@dataclass(frozen=True)
class _Axis:
    """A joint's axis in the frame before joint 3, whose origin is S."""

    direction: Vector3
    point: Vector3


def panda(rows: tuple[JointRow, ...]) -> dict[str, SingularSet]:
    """Manifolds "shoulder", "elbow", "wrist", "in_line"; together they are all singular configurations."""
    four, five, six, seven = _axes(rows)
    upper, fore = math.atan2(rows[2].d, rows[2].a), math.atan2(rows[4].d, rows[3].a)
    # Seen along axis 4, S is at the angle `upper`, W at `fore` + q4 (and turned by π) from the offset's direction.
    stretched = upper - fore
    # S is on axis 5 where a3 cos q4 + d3 sin q4 = −a4: two angles about `upper`.
    apart = math.acos(-rows[3].a / math.hypot(rows[2].a, rows[2].d))

    def through(point: Vector3) -> Fourier:
        """Vanishes where the line from S to the point meets axis 7; turning all of it by q3 changes nothing."""
        return _dot(point, _cross(seven.direction, seven.point)).at(Q3, 0.0)

    def in_line(angle: float) -> tuple[AngleIs, ZeroOf]:
        moments = [_cross(axis.direction, axis.point) for axis in (four, six, seven)]
        return AngleIs(Q4, angle, TURN), ZeroOf(_determinant(moments).at(Q3, 0.0).at(Q4, angle))

    # What axes 4–7 feel of a force at S (three columns) and of a moment about x, across axes 1 and 2 where q2 = 0.
    felt = [(*_cross(axis.point, axis.direction), axis.direction[0]) for axis in (four, five, six, seven)]
    return {
        "shoulder": SingularSet(((AngleIs(Q2), ZeroOf(_determinant(felt))),)),
        "elbow": SingularSet(((AngleIs(Q4, stretched), ZeroOf(through(six.point).at(Q4, stretched))),)),
        "wrist": SingularSet(
            tuple((AngleIs(Q5, side, TURN), ZeroOf(through(four.point).at(Q5, side))) for side in (HALF, -HALF))
        ),
        "in_line": SingularSet((in_line(upper + apart), in_line(upper - apart))),
    }


def _axes(rows: Sequence[JointRow]) -> list[_Axis]:
    """Axes of joints 4 to 7 as polynomials of q3 to q6, by the DH rows from joint 3 on."""
    angles = Angles(len(rows))
    zero, one = angles.constant(0.0), angles.constant(1.0)
    x, y, z = (one, zero, zero), (zero, one, zero), (zero, zero, one)
    point = (zero, zero, zero)
    axes = []
    for joint, row in enumerate(rows[2:6], start=2):
        c, s = angles.cos(joint), angles.sin(joint)
        x, y = _sum(_scaled(c, x), _scaled(s, y)), _sum(_scaled(-s, x), _scaled(c, y))
        a, d = angles.constant(row.a), angles.constant(row.d)
        point = _sum(point, _sum(_scaled(d, z), _scaled(a, x)))
        tilt, lean = angles.constant(math.cos(row.alpha)), angles.constant(math.sin(row.alpha))
        y, z = _sum(_scaled(tilt, y), _scaled(lean, z)), _sum(_scaled(-lean, y), _scaled(tilt, z))
        axes.append(_Axis(z, point))
    return axes


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(factor: Fourier, a: Vector3) -> Vector3:
    return factor * a[0], factor * a[1], factor * a[2]


def _dot(a: Vector3, b: Vector3) -> Fourier:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector3, b: Vector3) -> Vector3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _determinant(matrix: Sequence[Sequence[Fourier]]) -> Fourier:
    """By the first row: the matrices are 3×3 and 4×4."""
    if len(matrix) == 1:
        return matrix[0][0]
    minors = [_determinant([[*row[:k], *row[k + 1 :]] for row in matrix[1:]]) for k in range(len(matrix))]
    total = matrix[0][0] * minors[0]
    for k in range(1, len(matrix)):
        term = matrix[0][k] * minors[k]
        total = total + (term if k % 2 == 0 else -term)
    return total
