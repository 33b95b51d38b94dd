"""What the robot would like to do with its redundancy: the preferred joint velocity z and how it starts (2.160)."""

from __future__ import annotations

import math

import numpy as np

from stack.compiled import compiled
from stack.messages import Vector


@compiled
def preferred_velocity(q: Vector, preferred: Vector, heights: Vector, widths: Vector) -> Vector:
    """z_i = a_i tanh((q_pref,i − q_i)/c_i), all (n,): towards `preferred` at no more than `heights` (rad/s, m/s), proportionally within
    about `widths` (rad, m). A height of 0 asks the joint to keep still as far as the task lets it (its weight in B then damps
    its transients). Where q is the preferred configuration z is 0, so an adjusting motion (ẋ = 0, z ≠ 0) ends by itself."""
    z = np.empty(q.shape[0])
    for i in range(q.shape[0]):
        z[i] = heights[i] * math.tanh((preferred[i] - q[i]) / widths[i])
    return z


def window(elapsed_s: float, duration_s: float) -> float:
    """Factor for z, from 0 at the beginning of a motion to 1 after `duration_s`, with zero slope at both ends: null-space motion starts
    without a jump in velocity or acceleration. A duration of 0 or less means no window: always 1."""
    if duration_s <= 0.0 or elapsed_s >= duration_s:
        return 1.0
    if elapsed_s <= 0.0:
        return 0.0
    x = elapsed_s / duration_s
    return x * x * (3.0 - 2.0 * x)
