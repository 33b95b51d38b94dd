"""Where a motion is steady: the commanded TCP velocity has been the same for a while, so that transients of ramps have died away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from logs.signals import Signal

SETTLE_S = 1.0
"""For so long the velocity must have been the same."""
SLOWEST_M_S = 0.01
"""Below this nothing moves steadily, it stands."""
SAME_M_S, SAME_SHARE = 0.002, 0.02
"""Velocities are the same if no component differs by more than the larger of this and this share of the speed."""
_BASE_S = 0.1
"""The velocity is the mean of so long: what the wire rounds off does not show."""


def steady_rows(commanded: Signal) -> NDArray[np.bool_]:
    """(n,) of `tcp/commanded` (n, 7): whether the motion is steady there. A gap in the rows begins anew."""
    steady = np.zeros(len(commanded), bool)
    if len(commanded) < 3:
        return steady
    step_s = float(np.median(np.diff(commanded.t_ns))) * 1e-9
    breaks = np.flatnonzero(np.diff(commanded.t_ns) > 1.5e9 * step_s) + 1
    for rows in np.split(np.arange(len(commanded)), breaks):
        steady[rows] = _steady(commanded.values[rows, :3], step_s)
    return steady


def _steady(position: NDArray[np.float64], step_s: float) -> NDArray[np.bool_]:
    """(n,) of positions (n, 3), `step_s` apart."""
    base, window = max(1, round(_BASE_S / step_s)), max(1, round(SETTLE_S / step_s))
    steady = np.zeros(len(position), bool)
    if len(position) <= base + window:
        return steady
    velocity = (position[base:] - position[:-base]) / (base * step_s)
    speed = np.linalg.norm(velocity, axis=1)
    back = {"size": window, "axis": 0, "origin": (window - 1) // 2}
    spread = np.max(maximum_filter1d(velocity, **back) - minimum_filter1d(velocity, **back), axis=1)
    same = (spread <= np.maximum(SAME_M_S, SAME_SHARE * speed)) & (speed >= SLOWEST_M_S)
    same[: window - 1] = False
    steady[base:] = same
    return steady
