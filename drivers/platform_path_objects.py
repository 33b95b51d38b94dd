"""2016h … 2018h of the planner: a platform path, put together when its kind is written."""

from __future__ import annotations

from collections.abc import Callable

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.objects import Value
from drivers.tables import platform_path as table
from drivers.tables.platform_path import PathKind
from stack.planner.platform_path import CirclePath, LinePath, PlatformPath, RelativePath, SplinePath


class PlatformPathObjects:
    """Hands every new path to `follow`, None for kind 0. A kind that the other objects make no path for is refused."""

    def __init__(self, dictionary: ObjectDictionary, follow: Callable[[RelativePath | None], None]) -> None:
        self._dictionary = dictionary
        self._follow = follow
        dictionary.bind(table.PLATFORM_PATH, table.KIND, check=self._check, sink=self._change)

    def _check(self, kind: Value) -> None:
        try:
            self._path(PathKind(int(kind)))
        except ValueError as error:
            raise SdoAbort(AbortCode.PARAMETER_INCOMPATIBLE, f"platform path: {error}") from None

    def _change(self, kind: Value) -> None:
        path = self._path(PathKind(int(kind)))
        start = (self._number(subindex) for subindex in (table.START_X, table.START_Y, table.START_HEADING))
        self._follow(None if path is None else RelativePath(path, *start))

    def _path(self, kind: PathKind) -> PlatformPath | None:
        """As the objects describe it. Raises ValueError for one that cannot be."""
        ends = (-self._number(table.BEHIND), self._number(table.AHEAD))
        if kind is PathKind.LINE:
            return LinePath(*ends)
        if kind is PathKind.CIRCLE:
            return CirclePath(self._number(table.RADIUS), *ends)
        if kind is PathKind.SPLINE:
            return SplinePath(self._waypoints())
        return None

    def _waypoints(self) -> list[tuple[float, float]]:
        objects = self._dictionary
        count = objects.integer(table.PLATFORM_PATH, table.WAYPOINTS)
        return [
            (float(objects.get(table.WAYPOINTS_X, i)), float(objects.get(table.WAYPOINTS_Y, i)))
            for i in range(1, count + 1)
        ]

    def _number(self, subindex: int) -> float:
        return float(self._dictionary.get(table.PLATFORM_PATH, subindex))
