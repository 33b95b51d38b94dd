"""Measures H(q) that a self-motion may optimise, each with its task: everything that the singularity monitor needs at one configuration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stack.kinematics.arm import ArmModel
from stack.messages import Matrix, Vector
from stack.planner.jacobian_derivative import Rows, Tensor, jacobian_derivative, manipulability_derivatives

_FIRST, _SECOND = np.finfo(np.float64).eps ** 0.2, np.finfo(np.float64).eps ** (1.0 / 6.0)


@dataclass(frozen=True, slots=True, eq=False)
class Local:
    """Task and measure around one q: J (m, n), ∂J/∂q_j (n, m, n), H, ∇H (n,), ∇²H (n, n). C-contiguous."""

    jacobian: Matrix
    derivative: Tensor
    value: float
    gradient: Vector
    hessian: Matrix


class Measure(Protocol):
    """A task and the measure that the redundancy left by it optimises."""

    def at(self, q: Vector) -> Local:
        """Both around q (n,)."""


@dataclass(frozen=True, slots=True)
class Manipulability:
    """Yoshikawa's √det(J Jᵀ) of the task that is made of `rows` of the arm's TCP twist (base axes). Everything analytic."""

    arm: ArmModel
    rows: Rows

    def at(self, q: Vector) -> Local:
        jacobian = np.ascontiguousarray(self.arm.jacobian(q))
        task, change, _, _, value, gradient, hessian = manipulability_derivatives(jacobian, self.rows)
        return Local(task, change, value, gradient, hessian)


@dataclass(frozen=True, slots=True)
class AnyMeasure:
    """Any smooth H(q) of the user's, its derivatives by central differences of fourth order.

    The steps, 7e-4 and 2.5e-3 times `scale` (rad, m: the motion over which H changes by much of itself), balance truncation and rounding:
    about eleven digits of the gradient and eight of the Hessian for a smooth H of size 1. 8 n + 16 n(n − 1)/2 evaluations:
    for searches and for measures that are cheap.
    """

    arm: ArmModel
    rows: Rows
    function: Callable[[Vector], float]
    scale: float = 1.0

    def at(self, q: Vector) -> Local:
        whole = np.ascontiguousarray(self.arm.jacobian(q))
        change = np.ascontiguousarray(jacobian_derivative(whole)[:, self.rows])
        gradient = finite_gradient(self.function, q, self.scale)
        hessian = finite_hessian(self.function, q, self.scale)
        return Local(np.ascontiguousarray(whole[self.rows]), change, float(self.function(q)), gradient, hessian)


_WEIGHTS = ((-2, 1.0 / 12.0), (-1, -8.0 / 12.0), (1, 8.0 / 12.0), (2, -1.0 / 12.0))
_BEND = ((-2, -1.0 / 12.0), (-1, 16.0 / 12.0), (0, -30.0 / 12.0), (1, 16.0 / 12.0), (2, -1.0 / 12.0))


def finite_gradient(function: Callable[[Vector], float], q: Vector, scale: float = 1.0) -> Vector:
    """∇H (n,) by central differences of fourth order with a step of 7e-4·`scale`."""
    step = _FIRST * scale
    axes = np.eye(q.size)
    return np.array([sum(w * function(q + k * step * axis) for k, w in _WEIGHTS) / step for axis in axes])


def finite_hessian(function: Callable[[Vector], float], q: Vector, scale: float = 1.0) -> Matrix:
    """∇²H (n, n), symmetric, by central differences of fourth order with a step of 2.5e-3·`scale`."""
    step = _SECOND * scale
    n = q.size
    axes = step * np.eye(n)
    hessian = np.empty((n, n))
    for i in range(n):
        hessian[i, i] = sum(w * function(q + k * axes[i]) for k, w in _BEND) / step**2
        for j in range(i):
            mixed = sum(
                a * b * function(q + k * axes[i] + p * axes[j]) for k, a in _WEIGHTS for p, b in _WEIGHTS
            )  # fmt: skip
            hessian[i, j] = hessian[j, i] = mixed / step**2
    return hessian


__all__ = ["AnyMeasure", "Local", "Manipulability", "Measure", "finite_gradient", "finite_hessian"]
