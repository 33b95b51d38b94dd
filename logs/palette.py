"""The one palette of plots, paths and states: the same thing has the same colour everywhere, on the viewer's dark ground."""

from __future__ import annotations

from itertools import pairwise

Color = tuple[int, int, int]

COMMANDED: Color = (245, 178, 62)
MEASURED: Color = (84, 174, 255)
TRUE: Color = (112, 219, 134)
LIMIT: Color = (224, 72, 72)
PADDING: Color = (150, 106, 44)
NEUTRAL: Color = (170, 176, 186)
VIOLET: Color = (190, 138, 255)

JOINTS: tuple[Color, ...] = (
    (84, 174, 255),
    (245, 178, 62),
    (112, 219, 134),
    (255, 122, 144),
    (190, 138, 255),
    (78, 214, 214),
    (240, 228, 96),
    (222, 150, 104),
)
AXES: tuple[Color, ...] = ((255, 110, 110), (112, 219, 134), (84, 174, 255))

GOOD: Color = (58, 150, 88)
IDLE: Color = (90, 98, 112)
BUSY: Color = (52, 116, 190)
WARNING: Color = (206, 140, 30)
BAD: Color = (200, 52, 52)

STATES: dict[str, Color] = {
    # CiA 402
    "operation enabled": GOOD,
    "switched on": BUSY,
    "ready to switch on": IDLE,
    "switch on disabled": IDLE,
    "not ready": IDLE,
    "quick stop active": WARNING,
    "fault reaction active": BAD,
    "fault": BAD,
    # the planner's phases
    "boot": IDLE,
    "configure": IDLE,
    "ready": IDLE,
    "enabling": BUSY,
    "idle": BUSY,
    "executing": GOOD,
    "stopping": WARNING,
    # modes
    "off": IDLE,
    "hold": BUSY,
    "arm only": VIOLET,
    "platform only": (60, 150, 160),
    "coordinated": GOOD,
    # NMT
    "boot-up": BUSY,
    "pre-operational": WARNING,
    "operational": GOOD,
    "stopped": WARNING,
    "lost": BAD,
    # kinds of singularity
    "kinematic": BAD,
    "algorithmic": WARNING,
    "semi": BUSY,
    "semi algorithmic": VIOLET,
    # restrictions
    "none": IDLE,
}


def state_color(state: str) -> Color:
    """Colour of a state; of what restricts the planner by how grave it is."""
    if state in STATES:
        return STATES[state]
    if "infeasible" in state or "degraded" in state:
        return BAD
    if "stale" in state or "singularity" in state:
        return WARNING
    return BUSY


_ERROR_SCALE = ((0.0, (112, 219, 134)), (0.5, (245, 200, 62)), (1.0, (224, 60, 60)))


def error_color(error: float, full_scale: float) -> Color:
    """Green at 0, amber at half, red from `full_scale` on."""
    share = min(max(error / full_scale, 0.0), 1.0)
    for (low, low_color), (high, high_color) in pairwise(_ERROR_SCALE):
        if share <= high:
            part = (share - low) / (high - low)
            r, g, b = (round(a + part * (c - a)) for a, c in zip(low_color, high_color, strict=True))
            return (r, g, b)
    return _ERROR_SCALE[-1][1]
