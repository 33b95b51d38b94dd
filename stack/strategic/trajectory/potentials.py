"""Potentials over the singular manifolds: `L(q) = Σ exp(η₁ − η₂ ψᵢ(q))`, ψᵢ = 0 exactly on manifold i (24–27).

ψᵢ is the sum of the squares of the conditions that define the manifold, each scaled to rad: an angle by its sine, a formula by the root
mean square of its gradient. So ψᵢ is nearly the squared distance in joint space close to the manifold.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stack.compiled import compiled
from stack.messages import Matrix, Vector
from stack.planner.singular_sets import AngleIs, Angles, Condition, ZeroOf
from stack.planner.singularities import singular_sets
from stack.strategic.trajectory.problem import arm_model

HALF = math.pi / 2
NEGLIGIBLE = -25.0
"""Exponents below it are left out: less than 1.4e-11 of the potential's value of one."""


@dataclass(frozen=True, slots=True, eq=False)
class Potentials:
    """ψᵢ = Σ r², r = Σ a cos(f·q) + b sin(f·q): frequencies `f` (T, n), `a`, `b` (T,), where each r and ψᵢ begins (…+1,)."""

    names: tuple[str, ...]
    frequencies: Matrix
    cosines: Vector
    sines: Vector
    conditions: NDArray[np.int64]
    sets: NDArray[np.int64]

    def distances(self, q: Vector) -> Vector:
        """(number of sets,) of ψᵢ."""
        r = self.residuals(q)
        return np.array([float((r[a:b] ** 2).sum()) for a, b in zip(self.sets[:-1], self.sets[1:], strict=True)])

    def residuals(self, q: Vector) -> Vector:
        phase = self.frequencies @ q
        return np.add.reduceat(self.cosines * np.cos(phase) + self.sines * np.sin(phase), self.conditions[:-1])


@lru_cache(maxsize=16)
def potentials(robot: str, listed: bool = False) -> Potentials:
    """Of the exact manifolds of `robot`; `listed`: with the thesis's A1–A6 in place of F1–F3 (moma8 only).

    ValueError for a robot whose manifolds are not known.
    """
    arm = arm_model(robot)
    sets = {name: found.branches for name, found in singular_sets(arm).items()}
    if listed:
        if robot != "moma8":
            raise ValueError(f"the list A1–A6 is moma8's, not {robot}'s")
        sets = {name: branches for name, branches in sets.items() if name.startswith("L")} | thesis_list(robot)
    branches = [(name, branch) for name, of in sets.items() for branch in of]
    return _table(arm.n, branches)


def no_potentials(n: int) -> Potentials:
    empty = np.zeros(1, dtype=np.int64)
    return Potentials((), np.zeros((0, n)), np.zeros(0), np.zeros(0), empty, empty)


def thesis_list(robot: str) -> dict[str, tuple[tuple[Condition, ...], ...]]:
    """A1–A6, the sets that the thesis gives for a singular wrist; subsets of F1–F3."""
    rows = arm_model(robot).description.joints
    sh, ua, el, la, wt = 2, 3, 4, 5, 6
    d3, d4, d6 = rows[2].d, rows[3].d, rows[5].d
    angles, wrist = Angles(len(rows)), AngleIs(wt)
    sums = {sign: angles.sin(ua, la if sign > 0 else -1 - la) for sign in (1, -1)}
    across = {sign: angles.cos(ua, la if sign > 0 else -1 - la) for sign in (1, -1)}

    def a6(sign: int) -> ZeroOf:
        lean = angles.constant(d4 * (d4 + sign * d6)) * angles.sin(sh) * angles.cos(sh) * angles.sin(la)
        return ZeroOf(lean - angles.constant(d3 * d6) * angles.cos(la))

    straight = {1: AngleIs(el, 0.0, 2 * math.pi), -1: AngleIs(el, math.pi, 2 * math.pi)}
    quarter = AngleIs(sh, 0.0, HALF)
    return {
        "A1": ((AngleIs(ua), AngleIs(el), AngleIs(la), wrist),),
        "A2": ((AngleIs(sh), AngleIs(ua), AngleIs(la), wrist),),
        "A3": ((AngleIs(sh), AngleIs(el, HALF), AngleIs(la), wrist),),
        "A4": ((quarter, AngleIs(ua, HALF), AngleIs(la, HALF), wrist),),
        "A5": tuple((quarter, straight[s], ZeroOf(sums[s]), wrist) for s in (1, -1)),
        "A6": tuple((straight[s], ZeroOf(across[s]), a6(s), wrist) for s in (1, -1)),
    }


def _table(n: int, branches: Iterable[tuple[str, tuple[Condition, ...]]]) -> Potentials:
    names, frequencies, waves = [], [], []
    conditions, sets = [0], [0]
    for name, branch in branches:
        names.append(name)
        for condition in branch:
            for k, c in _terms(n, condition):
                frequencies.append(k)
                waves.append(c)
            conditions.append(len(waves))
        sets.append(len(conditions) - 1)
    values = np.array(waves, dtype=np.complex128)
    return Potentials(
        tuple(names),
        np.array(frequencies, dtype=np.float64),
        np.ascontiguousarray(values.real),
        np.ascontiguousarray(-values.imag),
        np.array(conditions, dtype=np.int64),
        np.array(sets, dtype=np.int64),
    )


def _terms(n: int, condition: Condition) -> list[tuple[tuple[float, ...], complex]]:
    """Σ Re(c exp(i k·q)) of a condition whose gradient is about 1."""
    if isinstance(condition, AngleIs):
        rate = math.pi / condition.period
        k = tuple(rate if joint == condition.joint else 0.0 for joint in range(n))
        return [(k, complex(math.cos(rate * condition.at + HALF), -math.sin(rate * condition.at + HALF)) / rate)]
    assert isinstance(condition, ZeroOf)
    terms = condition.polynomial.terms
    scale = math.sqrt(sum(abs(c) ** 2 * sum(i * i for i in k) for k, c in terms.items()))
    halves: dict[tuple[int, ...], complex] = {}
    for k, c in terms.items():
        minus = tuple(-i for i in k)
        # The polynomial is real: a wave and its mirror image have the same real part.
        if minus in halves:
            halves[minus] += c.conjugate()
        else:
            halves[k] = c
    return [(tuple(float(i) for i in k), c / scale) for k, c in halves.items()]


@compiled
def _phase(q: Vector, f: Matrix, t: int) -> float:
    phase = 0.0
    for m in range(q.size):
        phase += f[t, m] * q[m]
    return phase


@compiled
def _distance(q: Vector, f: Matrix, a: Vector, b: Vector, conditions: NDArray[np.int64], first: int, end: int) -> float:
    """ψ(q): sum of the squares of the conditions `first` … `end` − 1."""
    psi = 0.0
    for j in range(first, end):
        r = 0.0
        for t in range(conditions[j], conditions[j + 1]):
            phase = _phase(q, f, t)
            r += a[t] * math.cos(phase) + b[t] * math.sin(phase)
        psi += r * r
    return psi


@compiled
def potential_value(
    q: Vector,
    f: Matrix,
    a: Vector,
    b: Vector,
    conditions: NDArray[np.int64],
    sets: NDArray[np.int64],
    height: float,
    steepness: float,
) -> float:
    """L(q) without w_m."""
    total = 0.0
    for i in range(sets.size - 1):
        psi = _distance(q, f, a, b, conditions, sets[i], sets[i + 1])
        exponent = math.log(height) - steepness * psi
        if exponent > NEGLIGIBLE:
            total += math.exp(exponent)
    return total


@compiled
def potential_derivatives(
    q: Vector,
    f: Matrix,
    a: Vector,
    b: Vector,
    conditions: NDArray[np.int64],
    sets: NDArray[np.int64],
    height: float,
    steepness: float,
    gradient: Vector,
    positive: Matrix,
    rest: Matrix,
) -> float:
    """L(q) without w_m; gradient (n,), Hessian = `positive` + `rest`, (n, n) each, `positive` semidefinite. Overwrites the three."""
    n = q.size
    gradient[:] = 0.0
    positive[:, :] = 0.0
    rest[:, :] = 0.0
    total = 0.0
    slope = np.empty(n)
    r_slope = np.empty(n)
    for i in range(sets.size - 1):
        psi = _distance(q, f, a, b, conditions, sets[i], sets[i + 1])
        exponent = math.log(height) - steepness * psi
        if exponent <= NEGLIGIBLE:
            continue
        value = math.exp(exponent)
        total += value
        slope[:] = 0.0
        for j in range(sets[i], sets[i + 1]):
            r = 0.0
            r_slope[:] = 0.0
            for t in range(conditions[j], conditions[j + 1]):
                phase = _phase(q, f, t)
                c, s = math.cos(phase), math.sin(phase)
                r += a[t] * c + b[t] * s
                for m in range(n):
                    r_slope[m] += f[t, m] * (b[t] * c - a[t] * s)
            for m in range(n):
                slope[m] += 2.0 * r * r_slope[m]
                for l in range(n):  # noqa: E741
                    rest[m, l] -= steepness * value * 2.0 * r_slope[m] * r_slope[l]
            for t in range(conditions[j], conditions[j + 1]):
                phase = _phase(q, f, t)
                bend = 2.0 * steepness * value * r * (a[t] * math.cos(phase) + b[t] * math.sin(phase))
                for m in range(n):
                    if f[t, m] != 0.0:
                        for l in range(n):  # noqa: E741
                            rest[m, l] += bend * f[t, m] * f[t, l]
        for m in range(n):
            gradient[m] -= steepness * value * slope[m]
            for l in range(n):  # noqa: E741
                positive[m, l] += steepness * steepness * value * slope[m] * slope[l]
    return total
