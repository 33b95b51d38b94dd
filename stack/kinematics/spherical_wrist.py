"""Position solution in closed form for the last three joints of an arm whose wrist axes meet in a point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from stack.kinematics.arm import ArmModel
from stack.kinematics.arrays import Array, finite

_POLE = 1e-9
_TURN = 2.0 * math.pi


class SphericalWrist:
    """Six joints, the last three as `Rz(q4) Ry(q5) Rz(q6)` about one point (DH twists −90°, 90°, 0 and no lengths in the wrist).

    ValueError for another kind of arm.
    """

    def __init__(self, arm: ArmModel) -> None:
        rows = arm.description.joints
        twists = [row.alpha for row in rows[3:]]
        if (
            len(rows) != 6
            or not np.allclose(twists, [-math.pi / 2, math.pi / 2, 0.0])
            or any(row.a for row in rows[3:])
        ):
            raise ValueError(f"robot {arm.name} is no six-joint arm with a spherical wrist of the kind z-y-z")
        self._arm = arm
        self._reach = rows[5].d

    def solve(self, pose: ArrayLike, near: ArrayLike) -> Array:
        """(6,) with the TCP at `pose` (4, 4): of the two wrist solutions, whole turns counted, the one nearest to `near` (6,).

        At the pole (q5 = 0), where q4 and q6 are not determined, q4 stays. Axes 1 to 3 by Newton's method from `near`.
        ValueError where the wrist centre is out of reach. Limits are not looked at.
        """
        goal, start = finite("pose", pose, (4, 4)), finite("near", near, (6,))
        q = self._carry(goal[:3, 3] - self._reach * goal[:3, 2], start)
        forearm = self._arm.pose(np.append(q[:3], np.zeros(3)))[:3, :3]
        q[3:] = _nearest(forearm.T @ goal[:3, :3], start[3:])
        return q

    def _carry(self, centre: Array, start: Array) -> Array:
        """Axes 1 to 3 such that the wrist's axes meet at `centre`."""
        q = start.copy()
        for _ in range(30):
            pose = self._arm.pose(q)
            missing = centre - (pose[:3, 3] - self._reach * pose[:3, 2])
            if float(missing @ missing) < 1e-28:
                return q
            q[:3] += np.linalg.lstsq(self._arm.wrist_jacobian(q), missing, rcond=None)[0]
        if float(missing @ missing) < 1e-20:
            return q
        raise ValueError(f"wrist centre {centre.round(4).tolist()} is out of reach of {self._arm.name}")


def _nearest(rotation: Array, near: Array) -> Array:
    """q4, q5, q6 of `Rz(q4) Ry(q5) Rz(q6) = rotation`, nearest to `near` in the sum of squares."""
    lean = math.hypot(rotation[0, 2], rotation[1, 2])
    if lean < _POLE:
        total = math.atan2(rotation[1, 0], rotation[0, 0])
        pole = np.array([near[0], 0.0, total - near[0]])
        pole[2] += _TURN * round(float(near[2] - pole[2]) / _TURN)
        return pole
    tilt = math.atan2(lean, rotation[2, 2])
    fourth, sixth = math.atan2(rotation[1, 2], rotation[0, 2]), math.atan2(rotation[2, 1], -rotation[2, 0])
    found = [np.array([fourth, tilt, sixth]), np.array([fourth + math.pi, -tilt, sixth + math.pi])]
    wound = [q + _TURN * np.round((near - q) / _TURN) * [1.0, 0.0, 1.0] for q in found]
    return min(wound, key=lambda q: float(np.sum((q - near) ** 2)))
