"""Full space parameterization (Pin et al.; 2.28-2.111): q̇ = S t, eᵀt = 1, from square subsystems of J q̇ = ẋ.

Remedies that keep it well conditioned: the command is normalised, `eᵀt = ‖ẋ‖` on solutions for the unit command, so that nothing
jumps as ẋ goes to zero and a fictitious command with `eᵀt = 0` takes over; the columns of S are scaled to unit length before G is
formed; subsystems with large solutions (near-singular ones) are used only where no others are left; a singular J is propped
first (2.139) and the command damped in the directions where it was.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stack.planner.problem import Matrix, Problem, Solution, Vector
from stack.planner.resolvers.answer import answer
from stack.planner.resolvers.decomposition import decompose, prop
from stack.planner.resolvers.row_correction import RowCorrection

_SINGULAR_SUBSYSTEM = 1e-10
_GOOD_PIVOT = 0.02
_USABLE_PIVOT = 1e-6
_REACH = (3.0, 30.0, 1e3, 1e6)
_ZERO = 1e-14


class Reduced(NamedTuple):
    """What is left of `J q̇ = ẋ` when the joints that it decides alone or not at all are taken out.

    matrix (m', n') with columns `joints` (n',) of J; `decided` (n, m) maps ẋ (m,) to the velocities of the joints that rows with a single
    non-zero element decide; `into_rows` (m', m) maps ẋ to what is left to do; `free`: joints with a zero column.
    """

    matrix: Matrix
    joints: NDArray[np.intp]
    decided: Matrix
    into_rows: Matrix
    free: NDArray[np.intp]


class Parameterization(NamedTuple):
    """q̇ = offset + S t with e·t = total: offset (n,), S (n, p), e (p,); all p directions are independent."""

    offset: Vector
    columns: Matrix
    condition: Vector
    total: float


@lru_cache(maxsize=32)
def _selections(n: int, m: int) -> NDArray[np.intp]:
    return np.array(list(combinations(range(n), m)), dtype=np.intp).reshape(-1, m)


def reduce_system(jacobian: Matrix) -> Reduced:
    """Take out zero columns (free joints) and, repeatedly, rows with a single non-zero element (decided joints)."""
    m, n = jacobian.shape
    size = _ZERO * max(float(np.abs(jacobian).max()), np.finfo(np.float64).tiny)
    present = np.abs(jacobian) > size
    free = np.flatnonzero(~present.any(axis=0))
    joints = [j for j in range(n) if j not in free]
    rows = list(range(m))
    decided = np.zeros((n, m))
    found = True
    while found:
        found = False
        for i in rows:
            nonzero = [j for j in joints if present[i, j]]
            if len(nonzero) == 1:
                j = nonzero[0]
                decided[j] = (np.eye(m)[i] - jacobian[i] @ decided) / jacobian[i, j]
                rows.remove(i)
                joints.remove(j)
                found = True
                break
    also_free = [j for j in joints if not present[np.ix_(rows, [j])].any()]
    joints = [j for j in joints if j not in also_free]
    kept = np.array(rows, dtype=np.intp)
    columns = np.array(joints, dtype=np.intp)
    into_rows = np.eye(m)[kept] - jacobian[kept] @ decided
    return Reduced(
        jacobian[np.ix_(kept, columns)], columns, decided, into_rows, np.array([*free, *also_free], dtype=np.intp)
    )


def particular_solutions(matrix: Matrix, command: Vector) -> tuple[Matrix, float]:
    """n' − m' + 1 solutions (n', p) of `matrix·q̇ = command` from square subsystems, as independent as they come, and how independent.

    Near-singular subsystems give long solutions: shorter ones are taken as long as they suffice. The second value is the smallest
    pivot of the chosen unit vectors; too few independent solutions give 0.
    """
    m, n = matrix.shape
    wanted = n - m + 1
    choices = _selections(n, m)
    squares = matrix[:, choices].transpose(1, 0, 2)
    lengths = np.linalg.norm(matrix, axis=0)
    regular = np.abs(np.linalg.det(squares)) > _SINGULAR_SUBSYSTEM * np.prod(lengths[choices], axis=1)
    choices, squares = choices[regular], squares[regular]
    solutions = np.zeros((len(choices), n))
    rhs = np.broadcast_to(command[:, None], (len(choices), m, 1))
    solutions[np.arange(len(choices))[:, None], choices] = np.linalg.solve(squares, rhs)[:, :, 0]
    norms = np.linalg.norm(solutions, axis=1)
    if len(choices) < wanted:
        return np.zeros((n, 0)), 0.0
    best: tuple[Matrix, float] = (np.zeros((n, 0)), 0.0)
    for reach in _REACH:
        near = norms <= reach * norms.min()
        if near.sum() < wanted:
            continue
        picked, pivot = _most_independent(solutions[near] / norms[near, None], wanted)
        if pivot > best[1]:
            best = (solutions[near][picked].T, pivot)
        if pivot > _GOOD_PIVOT:
            break
    return best


def _most_independent(units: Matrix, wanted: int) -> tuple[list[int], float]:
    """Greedy pivoted Gram-Schmidt on unit row vectors: indices, and the smallest distance of one from the span of those before."""
    rest = units.copy()
    picked: list[int] = []
    pivot = 1.0
    for _ in range(wanted):
        distances = np.einsum("ij,ij->i", rest, rest)
        i = int(distances.argmax())
        pivot = min(pivot, float(np.sqrt(distances[i])))
        if pivot < _USABLE_PIVOT:
            return picked, 0.0
        direction = rest[i] / np.sqrt(distances[i])
        rest = rest - np.outer(rest @ direction, direction)
        rest[picked + [i]] = 0.0
        picked.append(i)
    return picked, pivot


def _fictitious(matrix: Matrix) -> Vector:
    """A command that needs every joint: no square subsystem solves it with a zero velocity by accident."""
    command: Vector = matrix @ (1.0 + 0.5 * np.cos(2.4 * np.arange(matrix.shape[1]) ** 1.5 + 1.0))
    return command / np.linalg.norm(command)


def parameterize(jacobian: Matrix, reduced: Reduced, xdot: Vector) -> Parameterization:
    """The space of all solutions of `J q̇ = ẋ` for a J of full row rank."""
    n = jacobian.shape[1]
    matrix, joints, decided, into_rows, free = reduced
    offset = decided @ xdot
    free_columns = np.zeros((n, free.size))
    free_columns[free, np.arange(free.size)] = 1.0
    if matrix.shape[0] == 0:
        return Parameterization(offset, free_columns, np.zeros(free.size), 0.0)
    command = into_rows @ xdot
    size = float(np.linalg.norm(command))
    total = size
    solutions, pivot = particular_solutions(matrix, command / size) if size > 0.0 else (np.zeros((0, 0)), 0.0)
    if pivot <= _GOOD_PIVOT:
        spare, spare_pivot = particular_solutions(matrix, _fictitious(matrix))
        if size == 0.0 or spare_pivot > 10.0 * pivot:
            if size > 0.0:
                offset[joints] += _shortest(matrix, command)
            solutions, total = spare, 0.0
    columns = np.zeros((n, solutions.shape[1]))
    columns[joints] = solutions
    condition = np.concatenate([np.ones(solutions.shape[1]), np.zeros(free.size)])
    return Parameterization(offset, np.hstack([columns, free_columns]), condition, total)


def _shortest(matrix: Matrix, command: Vector) -> Vector:
    """One solution of `matrix·q̇ = command` when its square subsystems do not span the others (a command that leaves joints out)."""
    return np.asarray(np.linalg.lstsq(matrix, command, rcond=None)[0], dtype=np.float64)


def _metric(columns: Matrix, condition: Vector, weight: Matrix) -> tuple[Matrix, Matrix, Vector]:
    """Length-scaled S, K = G⁻¹ − G⁻¹e eᵀG⁻¹/eᵀG⁻¹e, and G⁻¹e/eᵀG⁻¹e (zero where there is no condition)."""
    lengths = np.sqrt(np.einsum("ij,ij->j", columns, weight @ columns))
    scaled = columns / lengths
    e = condition / lengths
    inverse = np.linalg.inv(scaled.T @ weight @ scaled)
    along = inverse @ e
    norm = float(e @ along)
    if norm == 0.0:
        return scaled, inverse, along
    return scaled, inverse - np.outer(along, along) / norm, along / norm


def resolve(problem: Problem) -> Solution:
    """The split-constraint form: t₀ from G, h and eᵀt, then a correction for the rows of A; bounds by slowing down on the path."""
    p = problem
    m = p.J.shape[0]
    u, sigma, vt = decompose(p.J)
    jacobian, into_strong = p.J, np.eye(m)
    if sigma[-1] < p.epsilon:
        propped = np.array([prop(value, p.epsilon) for value in sigma])
        jacobian, into_strong = (u * propped) @ vt[:m], (u * (sigma / propped)) @ u.T
    reduced = reduce_system(jacobian)
    lengths = np.sqrt(np.einsum("ij,ji->i", p.A, np.linalg.solve(p.B, p.A.T)))

    def respond(xdot: Vector, z: Vector, b: Vector) -> tuple[Vector, Vector, bool]:
        offset, columns, condition, total = parameterize(jacobian, reduced, into_strong @ xdot)
        if columns.shape[1] == 0:
            columns, condition = np.zeros((p.J.shape[1], 0)), np.zeros(0)
            unconstrained, metric = offset, np.zeros_like(p.B)
        else:
            scaled, kernel, along = _metric(columns, condition, p.B)
            t0 = kernel @ (scaled.T @ p.B @ (z - offset)) + total * along
            unconstrained = offset + scaled @ t0
            metric = scaled @ kernel @ scaled.T
        correction = RowCorrection(metric, p.A, lengths, p.epsilon_restriction)
        return correction.apply(unconstrained, b), unconstrained, correction.damped

    return answer(p, sigma, respond)
