"""The planner's platform path as objects: what it is, the waypoints of a spline, and where on it the platform is.

Writing the kind puts all of it into force."""

from __future__ import annotations

from enum import IntEnum

from drivers.objects import Access, DataType, ObjectDef
from drivers.tables.communication import U8, array
from stack.planner.platform_path import ENDLESS

REAL32 = DataType.REAL32
PLATFORM_PATH, WAYPOINTS_X, WAYPOINTS_Y, PATH_STATE = range(0x2016, 0x201A)
KIND, RADIUS, AHEAD, BEHIND, START_X, START_Y, START_HEADING, WAYPOINTS = range(1, 9)
"""Sub-indices of 2016h."""
MOST_WAYPOINTS = 16


class PathKind(IntEnum):
    """Kinds of platform path, as object 2016h:1 numbers them."""

    NONE = 0
    LINE = 1
    CIRCLE = 2
    SPLINE = 3


def platform_path_objects() -> list[ObjectDef]:
    """2016h … 2019h. A path ahead or behind of `ENDLESS` metres has no end."""
    record = (
        ObjectDef(PLATFORM_PATH, KIND, "kind", U8, Access.RW, PathKind.NONE, low=0, high=max(PathKind)),
        ObjectDef(PLATFORM_PATH, RADIUS, "radius", REAL32, Access.RW, 1.0, unit="m"),
        ObjectDef(PLATFORM_PATH, AHEAD, "ahead", REAL32, Access.RW, ENDLESS, low=0.0, high=ENDLESS, unit="m"),
        ObjectDef(PLATFORM_PATH, BEHIND, "behind", REAL32, Access.RW, ENDLESS, low=0.0, high=ENDLESS, unit="m"),
        ObjectDef(PLATFORM_PATH, START_X, "start x", REAL32, Access.RW, 0.0, unit="m"),
        ObjectDef(PLATFORM_PATH, START_Y, "start y", REAL32, Access.RW, 0.0, unit="m"),
        ObjectDef(PLATFORM_PATH, START_HEADING, "start heading", REAL32, Access.RW, 0.0, unit="rad"),
        ObjectDef(PLATFORM_PATH, WAYPOINTS, "number of waypoints", U8, Access.RW, 0, low=0, high=MOST_WAYPOINTS),
    )
    names = tuple(f"waypoint {i}" for i in range(1, MOST_WAYPOINTS + 1))
    return [
        ObjectDef(PLATFORM_PATH, 0, "Platform path: highest sub-index", U8, Access.CONST, len(record)),
        *record,
        *array(WAYPOINTS_X, "Platform path: waypoints x", names, REAL32, unit="m"),
        *array(WAYPOINTS_Y, "Platform path: waypoints y", names, REAL32, unit="m"),
        *array(PATH_STATE, "Platform path: state", ("s", "aside", "turn"), REAL32, access=Access.RO),
    ]
