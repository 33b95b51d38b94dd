"""Objects of a drive set to a value, where drives differ: what is missing, what cannot be written, what is rounded.

CiA 402 leaves most of what sets a drive up to its maker. What protects the axis has to be there all the same, unless somebody has said
that it may be missing; the rest is noted, and set-up goes on.
"""

from __future__ import annotations

from drivers.canopen.abort import AbortCode
from drivers.canopen.sdo_abort import SdoAborted, StepError
from drivers.canopen.sequence import Download, Sequence, Upload
from drivers.cia402.axis import AxisClient
from drivers.cia402.bench import BenchDrive
from drivers.cia402.drive_units import NO_LIMIT
from drivers.cia402.identification import ABSENT, Note
from drivers.objects import DataType, Value

PROTECTING = {
    0x6007: "abort connection option code",
    0x6065: "following error window",
    0x6072: "max torque",
    0x607D: "software position limit",
    0x607F: "max profile velocity",
    0x6085: "quick stop deceleration",
}
"""Optional in CiA 402, but without them nobody except the master keeps the axis within its bounds."""
FREE = {
    0x1006: "communication cycle period",
    0x605A: "quick stop option code",
    0x605B: "shutdown option code",
    0x605C: "disable operation option code",
    0x605D: "halt option code",
    0x605E: "fault reaction option code",
    0x6060: "modes of operation",
    0x6066: "following error time out",
    0x60C2: "interpolation time period",
    0x60C5: "max acceleration",
}
"""Optional, and the drive is as safe without: it does what is usual, or the master keeps to the limit."""
FREE_TO_DIFFER = frozenset({0x1006, 0x605B, 0x605C, 0x605D, 0x605E, 0x6060})
"""A drive that cannot write them may have another value."""
LESS_IS_TIGHTER = frozenset({(0x6065, 0), (0x6066, 0), (0x6072, 0), (0x607D, 2), (0x607F, 0), (0x60C5, 0)})
MORE_IS_TIGHTER = frozenset({(0x607D, 1), (0x6085, 0)})
_NOT_WRITABLE = (AbortCode.READ_ONLY, AbortCode.UNSUPPORTED_ACCESS)
_MANUFACTURER = range(0x2000, 0x6000)


def ensure(index: int, subindex: int, value: Value, data_type: DataType | None = None) -> Sequence[None]:
    """Writes an object if it has another value, and reads it back."""
    if (yield Upload(index, subindex, data_type)) == value:
        return
    yield Download(index, subindex, value, data_type)
    came = yield Upload(index, subindex, data_type)
    if came != value:
        raise StepError(f"{value} in {index:04X}h sub {subindex} after it was written", str(came))


def settle(
    axis: AxisClient,
    bench: BenchDrive,
    note: Note,
    key: tuple[int, int],
    value: Value,
    data_type: DataType | None = None,
) -> Sequence[None]:
    """`ensure`, but for an object that may be missing, read-only, or rounded by the drive to a tighter value: noted then."""
    index, subindex = key
    try:
        present = yield Upload(index, subindex, data_type)
    except SdoAborted as error:
        if error.code not in ABSENT:
            raise
        _missing(axis, bench, note, key, value, error)
        return
    if present == value:
        return
    refused: SdoAborted | None = None
    try:
        yield Download(index, subindex, value, data_type)
    except SdoAborted as error:
        if error.code not in _NOT_WRITABLE:
            raise
        refused = error
    came = present if refused else (yield Upload(index, subindex, data_type))
    if came == value:
        return
    allowed = refused is not None and (index in FREE_TO_DIFFER or index in bench.accept_missing)
    if not allowed and not is_tighter(key, int(came), int(value)):
        raise _wrong(axis, key, value, came, refused)
    axis.kept[key] = int(came)
    why = "as the drive rounds it" if refused is None else refused.came
    note(f"{_name(key)} stays {came}, not {value} ({why})")


def is_tighter(key: tuple[int, int], came: int, wanted: int) -> bool:
    """Whether a limit that a drive has keeps to the one that it shall have. 0 never does: in some drives it is no limit."""
    if key in NO_LIMIT and wanted == NO_LIMIT[key]:
        return True
    if not came:
        return False
    return (key in LESS_IS_TIGHTER and came < wanted) or (key in MORE_IS_TIGHTER and came > wanted)


def _missing(
    axis: AxisClient, bench: BenchDrive, note: Note, key: tuple[int, int], value: Value, error: SdoAborted
) -> None:
    index = key[0]
    needless = key in NO_LIMIT and value == NO_LIMIT[key]
    free = index in FREE or index in _MANUFACTURER
    if not (needless or free or (index in PROTECTING and index in bench.accept_missing)):
        raise StepError(f"{_name(key)} in the drive{_or_accepted(axis, index)}", error.came, error.code) from error
    note(f"{_name(key)} is not set to {value} ({error.came})")


def _wrong(axis: AxisClient, key: tuple[int, int], value: Value, came: Value, refused: SdoAborted | None) -> StepError:
    tighter = " or tighter" if key in LESS_IS_TIGHTER | MORE_IS_TIGHTER else ""
    if refused is None:
        return StepError(f"{value}{tighter} in {_name(key)} after it was written", str(came))
    expected = f"{value}{tighter} in {_name(key)}{_or_accepted(axis, key[0])}"
    return StepError(expected, f"{came}, and {refused.came}", refused.code)


def _or_accepted(axis: AxisClient, index: int) -> str:
    return f", or accept_missing = [0x{index:04X}] in [drives.{axis.node_id}]" if index in PROTECTING else ""


def _name(key: tuple[int, int]) -> str:
    text = PROTECTING.get(key[0]) or FREE.get(key[0])
    return f"{key[0]:04X}h sub {key[1]}" + (f" ({text})" if text else "")
