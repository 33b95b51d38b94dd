"""Checks at the door of the kinematics: right shape, finite, float64."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """`value` as a float64 array of `shape` (the same object if it is one already).

    ValueError prints both shapes, or names the entries that are not finite.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    flat = array.ravel()
    # The sum of squares is finite if every entry is and none is astronomic: one cheap test for the usual case.
    if not math.isfinite(flat.dot(flat)) and not np.isfinite(flat).all():
        wrong = [i for i, entry in enumerate(flat) if not math.isfinite(entry)]
        raise ValueError(f"{name} is not finite at index {', '.join(map(str, wrong))}: {array.tolist()}")
    return array


def frozen(value: ArrayLike) -> Array:
    """A private copy that cannot be written to."""
    array = np.array(value, dtype=np.float64)
    array.setflags(write=False)
    return array
