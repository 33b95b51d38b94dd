"""The unicycle platform: its two columns in the extended Jacobian, its motion on exact arcs, its wheels (3.10–3.15)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from stack.kinematics.arm import ArmModel, ArmState, turned_rows
from stack.kinematics.arrays import Array, finite
from stack.kinematics.robot_file import PlatformParameters


def platform_of(arm: ArmModel) -> PlatformParameters:
    """The platform that carries the arm; ValueError if it stands on the floor."""
    platform = arm.description.platform
    if platform is None:
        raise ValueError(f"robot {arm.name} has no platform")
    return platform


def platform_columns(point: ArrayLike) -> Array:
    """(6, 2): twist of a point (3,), given in the platform's frame, by v and by ω, in the platform's axes (3.14).

    `j_v = (1, 0, 0, 0, 0, 0)`, `j_ω = (−p_y, p_x, 0, 0, 0, 1)`.
    """
    x, y, _ = finite("point", point, (3,))
    columns = np.zeros((6, 2))
    columns[0, 0] = 1.0
    columns[0, 1], columns[1, 1], columns[5, 1] = -y, x, 1.0
    return columns


def extended_jacobian(arm: ArmModel, q: ArrayLike) -> Array:
    """(6, n + 2) in the end-point frame: columns of the arm, of v, of ω. ValueError for a robot without platform.

    The platform's posture in the world drops out, so no self-localisation is needed.
    """
    return extended(arm, arm.state(q))


def extended(arm: ArmModel, state: ArmState) -> Array:
    """`extended_jacobian` from a forward pass that was made already."""
    return turned_rows(state.rotation.T, extended_in_platform(arm, state))


def extended_in_platform(arm: ArmModel, state: ArmState) -> Array:
    """(6, n + 2) in the platform's axes (the arm's base has the same)."""
    point = state.position + platform_of(arm).arm_base
    return np.hstack((state.jacobian, platform_columns(point)))


def extended_wrist_jacobian(arm: ArmModel, q: ArrayLike) -> Array:
    """(3, k + 2): velocity of the wrist centre by the joints before the wrist, v and ω, in the platform's axes."""
    centre = arm.points(q)["D"] + platform_of(arm).arm_base
    return np.hstack((arm.wrist_jacobian(q), platform_columns(centre)[:3]))


def path_column(columns: ArrayLike, speed: float, curvature: float) -> Array:
    """(6,): column of ṡ for a platform bound to a path (4.1.2), `|r'(s)| (j_v + κ j_ω)`.

    `columns` (6, 2) = `[j_v j_ω]` in any frame; `speed` = |r'(s)|, 1 for a path by arc length; `curvature` κ in 1/m,
    positive to the left. A negative ṡ drives backwards.
    """
    j = finite("columns", columns, (6, 2))
    return speed * (j[:, 0] + curvature * j[:, 1])


def integrate_unicycle(posture: ArrayLike, v: float, omega: float, dt: float) -> Array:
    """Posture (x, y, θ) after `dt` seconds at constant v and ω: the exact arc on SE(2), θ not wrapped."""
    x, y, theta = finite("posture", posture, (3,))
    half = 0.5 * omega * dt
    # The chord of the arc is v·dt·sin(half)/half long and points along the mean heading.
    chord = v * dt * float(np.sinc(half / math.pi))
    return np.array([x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + 2.0 * half])


def wheel_speeds(platform: PlatformParameters, v: float, omega: float) -> tuple[float, float]:
    """Angular velocities (left, right) in rad/s for the platform's v (m/s) and ω (rad/s, positive to the left)."""
    turn = 0.5 * platform.track * omega
    return (v - turn) / platform.wheel_radius, (v + turn) / platform.wheel_radius


def platform_twist(platform: PlatformParameters, left: float, right: float) -> tuple[float, float]:
    """(v, ω) for the wheels' angular velocities in rad/s; the inverse of `wheel_speeds`."""
    v = 0.5 * platform.wheel_radius * (left + right)
    return v, platform.wheel_radius * (right - left) / platform.track
