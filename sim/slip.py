"""Slip of the wheels: between what a wheel turns and how far it gets.

One Ornstein-Uhlenbeck process per wheel, `ds = -(s - b)/tau dt + sigma sqrt(2/tau) dW`: stationary with mean b and
standard deviation sigma, correlated over tau. Discretised exactly, so that its statistics do not depend on the tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stack.compiled import compiled
from stack.messages import Matrix, Vector

_BLOCK = 1024
_STREAM = 0x511


@dataclass(frozen=True)
class SlipParameters:
    """Standard noise: 1 % for about half a second at a time; `sigma = 0` is exactly no slip."""

    sigma: float = 0.01
    """standard deviation of the slip ratio (-)"""
    tau_s: float = 0.5
    """correlation time"""
    limit: float = 0.3
    """the slip ratio is clipped to +-limit (-)"""

    def __post_init__(self) -> None:
        if not self.sigma >= 0.0:
            raise ValueError(f"slip.sigma = {self.sigma}: must be 0 or positive")
        if not self.tau_s > 0.0:
            raise ValueError(f"slip.tau_s = {self.tau_s}: must be positive")
        if not 0.0 < self.limit < 1.0:
            raise ValueError(f"slip.limit = {self.limit}: must be between 0 and 1")


@compiled
def _advance(
    noise: Matrix, row: int, decay: float, spread: float, limit: float, bias: Vector, deviation: Vector, ratio: Vector
) -> None:
    for i in range(ratio.shape[0]):
        deviation[i] = decay * deviation[i] + spread * noise[row, i]
        ratio[i] = min(max(bias[i] + deviation[i], -limit), limit)


class Slip:
    """Seeded slip ratios of `count` wheels; starts in the stationary state."""

    def __init__(self, parameters: SlipParameters, seed: int, dt_s: float, count: int = 2) -> None:
        self.parameters = parameters
        self.bias: Vector = np.zeros(count)
        """Mean slip per wheel (-): what a slippery patch of floor adds; may change between steps."""
        self.ratio: Vector = np.zeros(count)
        """Slip ratio per wheel for the coming step (-)."""
        self._random = np.random.default_rng([seed, _STREAM])
        self._decay = math.exp(-dt_s / parameters.tau_s)
        self._spread = parameters.sigma * math.sqrt(-math.expm1(-2.0 * dt_s / parameters.tau_s))
        self._deviation = parameters.sigma * self._random.standard_normal(count)
        self._noise = np.zeros((0, count))
        self._used = 0
        still = np.zeros((1, count))
        _advance(still, 0, 1.0, 0.0, parameters.limit, self.bias, self._deviation, self.ratio)

    def advance(self) -> None:
        """One tick further; `ratio` is filled in place."""
        if self._used == len(self._noise):
            self._noise = self._random.standard_normal((_BLOCK, len(self.ratio)))
            self._used = 0
        limit, decay, spread = self.parameters.limit, self._decay, self._spread
        _advance(self._noise, self._used, decay, spread, limit, self.bias, self._deviation, self.ratio)
        self._used += 1
