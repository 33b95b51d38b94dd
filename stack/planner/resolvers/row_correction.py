"""The constraint correction of a closed-form solution in plain NumPy, for resolvers that do not run compiled."""

from __future__ import annotations

import numpy as np

from stack.planner.problem import Matrix, Vector

_ROUNDS = 14


class RowCorrection:
    """Makes `A q̇ = b` hold by moving q̇ inside the null space, by overwriting where the null space has no room for it.

    metric (n, n): N G⁻¹ Nᵀ, which is symmetric, positive semidefinite and independent of the base that it was computed in;
    lengths (k,): √(a B⁻¹ aᵀ) of the rows, so that the eigenvalues of the normalised A·metric·Aᵀ lie between 0 and k; it is inverted by
    iterated damping with `epsilon`, which is exact to rounding for eigenvalues well above and vanishes for those well below.
    """

    def __init__(self, metric: Matrix, rows: Matrix, lengths: Vector, epsilon: float) -> None:
        self._rows = rows
        self._lengths = np.where(lengths > 0.0, lengths, 1.0)
        self.damped = False
        if rows.shape[0]:
            scaled = rows / self._lengths[:, None]
            values, vectors = np.linalg.eigh(scaled @ metric @ scaled.T)
            values = np.maximum(values, 1e-300)
            left = (epsilon / (values + epsilon)) ** (_ROUNDS - 1)
            self.damped = bool(left.max() > 1e-12)
            self._into = metric @ scaled.T @ (vectors * ((1.0 - left) / values)) @ vectors.T
            self._overwrite = np.linalg.pinv(rows, rcond=1e-9)

    def apply(self, unconstrained: Vector, values: Vector) -> Vector:
        """q̇ (n,) with the rows equal to `values` (k,); linear in both arguments."""
        if values.size == 0:
            return unconstrained
        dq: Vector = unconstrained + self._into @ ((values - self._rows @ unconstrained) / self._lengths)
        missing = values - self._rows @ dq
        return dq + (self._overwrite @ missing if self.damped else self._into @ (missing / self._lengths))
