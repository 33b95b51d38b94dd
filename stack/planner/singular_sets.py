"""Distances in joint space to sets that are given by angles and by zeros of trigonometric polynomials.

Every condition returns a margin in rad that is zero exactly where the condition holds, never more than the true
distance in joint space, and equal to it to first order nearby.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stack.messages import Matrix, Vector

Frequency = tuple[int, ...]


@dataclass(frozen=True)
class Fourier:
    """A real trigonometric polynomial of the joint angles, `Σ c_k exp(i k·q)`, with sums, products and derivatives."""

    terms: Mapping[Frequency, complex]

    def __add__(self, other: Fourier) -> Fourier:
        sums = dict(self.terms)
        for k, c in other.terms.items():
            sums[k] = sums.get(k, 0.0) + c
        return _tidy(sums)

    def __neg__(self) -> Fourier:
        return Fourier({k: -c for k, c in self.terms.items()})

    def __sub__(self, other: Fourier) -> Fourier:
        return self + -other

    def __mul__(self, other: Fourier) -> Fourier:
        products: dict[Frequency, complex] = {}
        for k, c in self.terms.items():
            for j, d in other.terms.items():
                both = tuple(a + b for a, b in zip(k, j, strict=True))
                products[both] = products.get(both, 0.0) + c * d
        return _tidy(products)

    def at(self, joint: int, angle: float) -> Fourier:
        """The polynomial of the other angles, this one held."""
        held: dict[Frequency, complex] = {}
        for k, c in self.terms.items():
            rest = (*k[:joint], 0, *k[joint + 1 :])
            held[rest] = held.get(rest, 0.0) + c * complex(math.cos(k[joint] * angle), math.sin(k[joint] * angle))
        return _tidy(held)

    def derivatives(self, q: Vector) -> tuple[float, Vector, Matrix]:
        """Value, gradient (n,), Hessian (n, n)."""
        k, c = self._arrays
        waves = c * np.exp(1j * (k @ q))
        hessian: Matrix = -(k.T * waves.real) @ k
        return float(waves.real.sum()), -(waves.imag @ k), hessian

    @cached_property
    def curvature(self) -> float:
        """Bound of the Hessian's norm everywhere."""
        k, c = self._arrays
        return float(np.abs(c) @ (k * k).sum(axis=1))

    @cached_property
    def _arrays(self) -> tuple[Matrix, NDArray[np.complex128]]:
        return np.array(list(self.terms), dtype=np.float64), np.array(list(self.terms.values()), dtype=np.complex128)


def _tidy(terms: Mapping[Frequency, complex]) -> Fourier:
    """Without the terms that rounding left behind; never empty."""
    size = max(abs(c) for c in terms.values())
    kept = {k: c for k, c in terms.items() if abs(c) > 1e-14 * size}
    return Fourier(kept or {next(iter(terms)): 0.0})


@dataclass(frozen=True)
class Angles:
    """Makes the polynomials of an arm with n joints."""

    n: int

    def constant(self, value: float) -> Fourier:
        return Fourier({(0,) * self.n: value})

    def cos(self, *joints: int) -> Fourier:
        """Cosine of the sum of these joints' angles; −1 − j stands for minus the angle of joint j."""
        k, minus = self._frequencies(joints)
        return Fourier({k: 0.5, minus: 0.5})

    def sin(self, *joints: int) -> Fourier:
        """Sine of the same sum."""
        k, minus = self._frequencies(joints)
        return Fourier({k: -0.5j, minus: 0.5j})

    def _frequencies(self, joints: Sequence[int]) -> tuple[Frequency, Frequency]:
        k = [0] * self.n
        for joint in joints:
            if joint < 0:
                k[-1 - joint] -= 1
            else:
                k[joint] += 1
        return tuple(k), tuple(-i for i in k)


class Condition(Protocol):
    """A margin in rad, of either sign, and its gradient (n,) with respect to the joint angles."""

    def __call__(self, q: Vector) -> tuple[float, Vector]: ...


@dataclass(frozen=True)
class AngleIs:
    """Joint `joint` stands at `at` or any number of `period`s away: the margin is the difference to the nearest."""

    joint: int
    at: float = 0.0
    period: float = math.pi

    def __call__(self, q: Vector) -> tuple[float, Vector]:
        gradient = np.zeros(len(q))
        gradient[self.joint] = 1.0
        return math.remainder(q[self.joint] - self.at, self.period), gradient


@dataclass(frozen=True)
class ZeroOf:
    """A polynomial r is zero: the margin is the root δ of `|r| = |∇r| δ + ½ L δ²`, L a bound of the second derivatives.

    By Taylor's theorem r has no zero closer than δ; where |r| is small, δ is the first-order distance |r|/|∇r|.
    """

    polynomial: Fourier

    def __call__(self, q: Vector) -> tuple[float, Vector]:
        value, gradient, hessian = self.polynomial.derivatives(q)
        curvature, slope = self.polynomial.curvature, math.sqrt(float(gradient @ gradient))
        root = math.sqrt(slope**2 + 2.0 * curvature * abs(value))
        if root < 1e-300:
            return 0.0, np.zeros(len(q))
        margin = 2.0 * abs(value) / (slope + root)
        change = math.copysign(1.0, value) * gradient
        if slope > 0.0:
            change = change - margin * (hessian @ gradient) / slope
        return margin, change / root


@dataclass(frozen=True)
class SingularSet:
    """All conditions of a branch hold at once; the set is the union of its branches.

    The conditions of one branch speak of different joints, so that their margins add up by Pythagoras.
    """

    branches: tuple[tuple[Condition, ...], ...]

    def margin(self, q: Vector) -> tuple[float, Vector]:
        """Margin (rad, ≥ 0) to the nearest branch and its gradient (n,), zero on the set itself where none exists."""
        nearest = min(([condition(q) for condition in branch] for branch in self.branches), key=_norm)
        margin = _norm(nearest)
        if margin < 1e-300:
            return 0.0, np.zeros(len(q))
        gradient = sum((distance * slope for distance, slope in nearest), np.zeros(len(q)))
        return margin, gradient / margin


def _norm(parts: Sequence[tuple[float, Vector]]) -> float:
    return math.hypot(*(distance for distance, _ in parts))
