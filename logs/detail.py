"""How much of a run is recorded."""

from __future__ import annotations

from enum import Enum


class Detail(Enum):
    """MINIMAL: robot, paths, error, platform, joints, bus load, states and events. FULL: everything, each frame in words included."""

    MINIMAL = "minimal"
    FULL = "full"
