"""The known singular manifolds of each robot and how far a configuration is from every one of them.

Margins are in rad: the Euclidean distance in the space of the joints that define the manifold. It is exact for the
manifolds that fix angles only. Where a formula has to vanish (F1–F3, the Panda, the shoulder of the six-joint arms),
it is a lower bound of that distance, exact to first order near the manifold (`singular_sets.ZeroOf`). Joint limits
play no part.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from numpy.typing import ArrayLike

from stack.kinematics import ArmModel
from stack.kinematics.arrays import finite
from stack.kinematics.robot_file import JointRow
from stack.messages import Vector
from stack.planner.panda_singularities import panda
from stack.planner.singular_sets import AngleIs, Angles, SingularSet, ZeroOf

HALF = math.pi / 2
TURN = 2 * math.pi


@dataclass(frozen=True, slots=True)
class Margin:
    """Distance to a manifold (rad, ≥ 0) and its gradient (n,): the way out. The gradient is zero on the manifold."""

    distance: float
    gradient: Vector


def manifolds(arm: ArmModel, q: ArrayLike) -> dict[str, float]:
    """Margin of every singular manifold of the robot by name, 0 exactly on the manifold.

    moma8: L1–L4 (rank loss of the wrist centre), F1, F2, F3p (EL = 0), F3m (EL = π) (singular wrist that no other
    joint replaces); together they are all singular configurations. ValueError for a wrong shape, for numbers that are
    not finite, for a robot whose manifolds are not known.
    """
    angles = finite("q", q, (arm.n,))
    return {name: singular.margin(angles)[0] for name, singular in _sets_of(arm).items()}


def manifold_margins(arm: ArmModel, q: ArrayLike) -> dict[str, Margin]:
    """The same with gradients, for repulsion (2.161–2.164) and circumvention (2.178–2.180)."""
    angles = finite("q", q, (arm.n,))
    return {name: Margin(*singular.margin(angles)) for name, singular in _sets_of(arm).items()}


def singular_sets(arm: ArmModel) -> Mapping[str, SingularSet]:
    """The manifolds themselves, by name; ValueError for a robot whose manifolds are not known."""
    return _sets_of(arm)


def _sets_of(arm: ArmModel) -> Mapping[str, SingularSet]:
    return _sets(arm.name, arm.description.joints)


@lru_cache(maxsize=16)
def _sets(name: str, rows: tuple[JointRow, ...]) -> Mapping[str, SingularSet]:
    makers = {
        "moma8": _eight_joint_arm,
        "kr15": _six_joint_arm,
        "comau_racer7": _six_joint_arm,
        "iiwa14": _iiwa,
        "panda": panda,
        "planar3": _planar,
    }
    if name not in makers:
        raise ValueError(
            f"the singular manifolds of robot {name!r} are not known; known are those of {', '.join(makers)}"
        )
    return makers[name](rows)


def _eight_joint_arm(rows: tuple[JointRow, ...]) -> dict[str, SingularSet]:
    """The exact set that spec/0 gives in place of the thesis's incomplete A1–A6."""
    sh, ua, el, la, wt = 2, 3, 4, 5, 6
    d3, d4, d6 = rows[2].d, rows[3].d, rows[5].d
    angles, wrist = Angles(len(rows)), AngleIs(wt)
    sin, cos, constant = angles.sin, angles.cos, angles.constant
    bend = math.atan(d3 / d4)
    # First column of Rz(UA) Ry(EL) Rz(LA), y and z.
    n_y = cos(ua) * sin(la) + sin(ua) * cos(el) * cos(la)
    n_z = -(sin(el) * cos(la))
    # On SH = ±π/2 the sign of SH drops out of n·(d4 sin SH, d3, 0).
    f2 = constant(d4) * n_z + constant(d3) * n_y

    def f3(sign: int) -> ZeroOf:
        along = constant(d4 * (d4 + sign * d6)) * sin(sh) * cos(sh) * sin(la)
        turned = sin(ua, la if sign > 0 else -1 - la)
        return ZeroOf(along - constant(d3 * d6) * sin(ua) * turned)

    return {
        "L1": SingularSet(((AngleIs(sh), AngleIs(ua, HALF), AngleIs(el, HALF)),)),
        "L2": SingularSet(((AngleIs(sh), AngleIs(ua), AngleIs(el)),)),
        "L3": SingularSet(((AngleIs(sh, HALF), AngleIs(ua), AngleIs(el)),)),
        "L4": SingularSet(
            tuple((AngleIs(sh, HALF), AngleIs(ua, side * HALF, TURN), AngleIs(el, side * bend)) for side in (1.0, -1.0))
        ),
        "F1": SingularSet(((AngleIs(sh), ZeroOf(n_y), wrist),)),
        "F2": SingularSet(((AngleIs(sh, HALF), ZeroOf(f2), wrist),)),
        "F3p": SingularSet(((AngleIs(el, 0.0, TURN), f3(1), wrist),)),
        "F3m": SingularSet(((AngleIs(el, math.pi, TURN), f3(-1), wrist),)),
    }


def _six_joint_arm(rows: tuple[JointRow, ...]) -> dict[str, SingularSet]:
    """Factors of `m = |a2 s5 (a3 s3 − d4 c3)(a1 + a2 c2 + a3 c23 + d4 s23)|`: wrist, elbow, wrist over axis 1."""
    angles = Angles(len(rows))
    a1, a2, a3, d4 = (angles.constant(x) for x in (rows[0].a, rows[1].a, rows[2].a, rows[3].d))
    radius = a1 + a2 * angles.cos(1) + a3 * angles.cos(1, 2) + d4 * angles.sin(1, 2)
    return {
        "wrist": SingularSet(((AngleIs(4),),)),
        "elbow": SingularSet(((AngleIs(2, math.atan2(rows[3].d, rows[2].a)),),)),
        "shoulder": SingularSet(((ZeroOf(radius),),)),
    }


def _iiwa(rows: tuple[JointRow, ...]) -> dict[str, SingularSet]:
    """(35) of Beck et al."""
    return {
        "elbow": SingularSet(((AngleIs(3),),)),
        "shoulder": SingularSet(((AngleIs(1), AngleIs(2, HALF)),)),
        "shoulder_and_wrist": SingularSet(((AngleIs(1), AngleIs(5)),)),
        "wrist": SingularSet(((AngleIs(4, HALF), AngleIs(5)),)),
    }


def _planar(rows: tuple[JointRow, ...]) -> dict[str, SingularSet]:
    """All links on one line: the only way in which a planar arm loses a direction."""
    return {"aligned": SingularSet((tuple(AngleIs(joint) for joint in range(1, len(rows))),))}
