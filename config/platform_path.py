"""`[platform_path]` of a scenario: the path that the platform is bound to while arm and platform are coordinated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from config.table import Finite, NotNegative, Table
from drivers.tables import platform_path as table
from drivers.tables.platform_path import PathKind
from stack.planner.platform_path import ENDLESS, CirclePath, LinePath, PlatformPath, RelativePath, SplinePath
from stack.strategic.motion import ParameterWrite

Waypoint = tuple[Finite, Finite]


class PlatformPathTable(Table):
    """A line, a circle of `radius_m` (centre to the left for a positive one), or a spline through `waypoints_m` ([x, y], up to 16).

    It begins where the platform stands when it is first coordinated, tangent to its heading, unless `x_m`, `y_m`, `heading_rad` say
    otherwise as seen from there. `ahead_m`, `behind_m`: how far a line or a circle goes; without an end if not given.
    `follow = false`: the platform moves freely, and the path only serves to measure how far it is off.
    """

    kind: Literal["line", "circle", "spline"]
    radius_m: Finite | None = None
    ahead_m: NotNegative | None = None
    behind_m: NotNegative | None = None
    waypoints_m: Annotated[tuple[Waypoint, ...], Field(max_length=table.MOST_WAYPOINTS)] | None = None
    x_m: Finite = 0.0
    y_m: Finite = 0.0
    heading_rad: Finite = 0.0
    follow: bool = True

    @model_validator(mode="after")
    def _complete(self) -> PlatformPathTable:
        belongs = {"line": set(), "circle": {"radius_m"}, "spline": {"waypoints_m"}}
        for key in ("radius_m", "waypoints_m"):
            needed = key in belongs[self.kind]
            if needed and getattr(self, key) is None:
                raise ValueError(f"a path of kind {self.kind!r} needs {key}")
            if not needed and getattr(self, key) is not None:
                raise ValueError(f"a path of kind {self.kind!r} has no {key}")
        if self.kind == "spline" and (self.ahead_m is not None or self.behind_m is not None):
            raise ValueError("a path of kind 'spline' ends at its last waypoint: it has no ahead_m or behind_m")
        self.build()
        return self

    def build(self) -> RelativePath:
        """The path itself. Raises ValueError for one that cannot be, e.g. a radius that is too small."""
        return RelativePath(self._curve(), self.x_m, self.y_m, self.heading_rad)

    def _curve(self) -> PlatformPath:
        start, end = -_length(self.behind_m), _length(self.ahead_m)
        if self.kind == "line":
            return LinePath(start, end)
        if self.kind == "circle":
            assert self.radius_m is not None
            return CirclePath(self.radius_m, start, end)
        assert self.waypoints_m is not None
        return SplinePath(self.waypoints_m)


def path_writes(path: PlatformPathTable | None) -> Iterator[ParameterWrite]:
    """What to write into the planner's dictionary, the kind last: it puts the rest into force."""
    if path is None or not path.follow:
        return
    values: dict[int, float] = {
        table.AHEAD: _length(path.ahead_m),
        table.BEHIND: _length(path.behind_m),
        table.START_X: path.x_m,
        table.START_Y: path.y_m,
        table.START_HEADING: path.heading_rad,
    }
    if path.radius_m is not None:
        values[table.RADIUS] = path.radius_m
    waypoints = path.waypoints_m or ()
    values[table.WAYPOINTS] = len(waypoints)
    for i, (x, y) in enumerate(waypoints, start=1):
        yield ParameterWrite(table.WAYPOINTS_X, i, x)
        yield ParameterWrite(table.WAYPOINTS_Y, i, y)
    for subindex, value in values.items():
        yield ParameterWrite(table.PLATFORM_PATH, subindex, value)
    yield ParameterWrite(table.PLATFORM_PATH, table.KIND, PathKind[path.kind.upper()])


def _length(given: float | None) -> float:
    return ENDLESS if given is None else given
