"""2016h … 2018h, written as an SDO client writes them (REAL32 and U8, little endian)."""

import math
import struct

import pytest

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.canopen.dictionary import ObjectDictionary
from drivers.catalogue import PLANNER_ID, devices
from drivers.platform_path_objects import PlatformPathObjects
from stack.planner.platform_path import CirclePath, LinePath, RelativePath, SplinePath


class Planner:
    """A dictionary and the paths that came out of it."""

    def __init__(self) -> None:
        self.dictionary = ObjectDictionary(devices()[PLANNER_ID])
        self.followed: list[RelativePath | None] = []
        PlatformPathObjects(self.dictionary, self.followed.append)

    def write_float(self, index: int, subindex: int, value: float) -> None:
        self.dictionary.download(index, subindex, struct.pack("<f", value))

    def write_byte(self, subindex: int, value: int) -> None:
        self.dictionary.download(0x2016, subindex, bytes((value,)))


@pytest.fixture
def planner() -> Planner:
    return Planner()


def test_nothing_is_followed_before_the_kind_is_written(planner: Planner) -> None:
    planner.write_float(0x2016, 2, 0.5)
    planner.write_float(0x2016, 7, 0.25)
    assert planner.followed == []
    planner.write_byte(1, 2)
    (path,) = planner.followed
    assert path is not None
    assert path.path == CirclePath(0.5)
    assert (path.x, path.y, path.heading) == (0.0, 0.0, 0.25)


def test_a_line_goes_ahead_and_behind(planner: Planner) -> None:
    planner.write_float(0x2016, 3, 1.5)
    planner.write_float(0x2016, 4, 0.5)
    planner.write_byte(1, 1)
    assert planner.followed[0].path == LinePath(-0.5, 1.5)  # type: ignore[union-attr]


def test_a_spline_takes_as_many_waypoints_as_it_is_told(planner: Planner) -> None:
    for i, (x, y) in enumerate([(0.5, 0.25), (1.0, 0.0), (9.0, 9.0)], start=1):
        planner.write_float(0x2017, i, x)
        planner.write_float(0x2018, i, y)
    planner.write_byte(8, 2)
    planner.write_byte(1, 3)
    spline = planner.followed[0].path  # type: ignore[union-attr]
    assert isinstance(spline, SplinePath)
    assert spline.at(math.inf)[:2] == pytest.approx((1.0, 0.0), abs=1e-9)


def test_kind_0_sets_the_platform_free(planner: Planner) -> None:
    planner.write_byte(1, 2)
    planner.write_byte(1, 0)
    assert planner.followed[1] is None


def test_a_path_that_cannot_be_is_refused_and_the_old_one_stays(planner: Planner) -> None:
    planner.write_byte(1, 2)
    planner.write_float(0x2016, 2, 0.01)
    for kind in (2, 3):  # too tight a circle; a spline without waypoints
        with pytest.raises(SdoAbort) as refused:
            planner.write_byte(1, kind)
        assert refused.value.code is AbortCode.PARAMETER_INCOMPATIBLE
    assert len(planner.followed) == 1
    assert planner.dictionary.get(0x2016, 1) == 2


@pytest.mark.parametrize(("subindex", "value"), [(3, -1.0), (4, 2e6), (2, math.nan)])
def test_values_out_of_range_are_refused(planner: Planner, subindex: int, value: float) -> None:
    with pytest.raises(SdoAbort):
        planner.write_float(0x2016, subindex, value)


def test_an_unknown_kind_and_too_many_waypoints_are_refused(planner: Planner) -> None:
    for subindex, value in ((1, 4), (8, 17)):
        with pytest.raises(SdoAbort) as refused:
            planner.write_byte(subindex, value)
        assert refused.value.code is AbortCode.VALUE_TOO_HIGH
