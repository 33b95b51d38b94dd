"""A device type as an EDS file (electronic data sheet, after CiA 306), for CANopen masters and configuration tools.

Values that follow from the node id are written as `$NODEID+…`: found by making the device twice with different ids.
Plain ASCII. `Factor` and `Unit` are additions that the `canopen` package reads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby

from drivers.objects import DataType, DeviceDef, ObjectDef, PdoKind, Value

_VAR, _ARRAY, _RECORD = 0x7, 0x8, 0x9
_MANDATORY = (0x1000, 0x1001, 0x1018)
_DATE = "01-01-2026"
_TIME = "12:00AM"
_BAUD_RATES = (10, 20, 50, 125, 250, 500, 800, 1000)
_ASCII = {"·": " ", "²": "^2"}


def eds_text(file_name: str, make: Callable[[int], DeviceDef], description: str) -> str:
    """The EDS of the device that `make(node_id)` gives."""
    device, neighbour = make(1), make(2)
    defaults = {entry.key: entry.default for entry in neighbour.objects}
    groups = [(index, list(entries)) for index, entries in groupby(device.objects, key=lambda entry: entry.index)]
    indices = [index for index, _ in groups]
    lines = [*_file_info(file_name, description), *_device_info(device), *_dummy_usage()]
    lines += ["[Comments]", "Lines=1", f"Line1={description}", ""]
    lines += _list("MandatoryObjects", [index for index in indices if index in _MANDATORY])
    lines += _list("OptionalObjects", [i for i in indices if i not in _MANDATORY and not 0x2000 <= i < 0x6000])
    lines += _list("ManufacturerObjects", [index for index in indices if 0x2000 <= index < 0x6000])
    for index, entries in groups:
        lines += _object(index, entries, defaults)
    return "\n".join(lines) + "\n"


def _file_info(file_name: str, description: str) -> Iterator[str]:
    yield "[FileInfo]"
    yield f"FileName={file_name}"
    yield "FileVersion=1"
    yield "FileRevision=0"
    yield "EDSVersion=4.0"
    yield f"Description={description}"
    for event in ("Creation", "Modification"):
        yield f"{event}Time={_TIME}"
        yield f"{event}Date={_DATE}"
    yield "CreatedBy=Canipulator"
    yield "ModifiedBy=Canipulator"
    yield ""


def _device_info(device: DeviceDef) -> Iterator[str]:
    yield "[DeviceInfo]"
    yield "VendorName=Canipulator"
    yield f"VendorNumber=0x{device.object(0x1018, 1).default:X}"
    yield f"ProductName={device.product}"
    yield f"ProductNumber=0x{device.object(0x1018, 2).default:X}"
    yield f"RevisionNumber=0x{device.object(0x1018, 3).default:X}"
    yield "OrderCode="
    for rate in _BAUD_RATES:
        yield f"BaudRate_{rate}=1"
    yield f"SimpleBootUpMaster={int(bool(int(device.object(0x1005).default) >> 30 & 1))}"
    yield "SimpleBootUpSlave=1"
    yield "Granularity=8"
    yield "DynamicChannelsSupported=0"
    yield "GroupMessaging=0"
    yield f"NrOfRXPDO={sum(pdo.kind is PdoKind.RPDO for pdo in device.pdos)}"
    yield f"NrOfTXPDO={sum(pdo.kind is PdoKind.TPDO for pdo in device.pdos)}"
    yield "LSS_Supported=0"
    yield ""


def _dummy_usage() -> Iterator[str]:
    yield "[DummyUsage]"
    for code in range(1, 8):
        yield f"Dummy{code:04d}=0"
    yield ""


def _list(section: str, indices: list[int]) -> list[str]:
    numbered = [f"{number}=0x{index:04X}" for number, index in enumerate(indices, start=1)]
    return [f"[{section}]", f"SupportedObjects={len(indices)}", *numbered, ""]


def _object(index: int, entries: list[ObjectDef], neighbour: dict[tuple[int, int], Value]) -> Iterator[str]:
    if len(entries) == 1 and entries[0].subindex == 0:
        yield f"[{index:04X}]"
        yield from _variable(entries[0], neighbour)
        return
    types = {entry.data_type for entry in entries if entry.subindex}
    record = len(types) > 1 or index in (0x1018, 0x1200) or 0x1400 <= index < 0x2000
    yield f"[{index:04X}]"
    yield f"ParameterName={entries[0].name.split(':')[0]}"
    yield f"ObjectType=0x{_RECORD if record else _ARRAY:X}"
    yield f"SubNumber={len(entries)}"
    yield ""
    for entry in entries:
        yield f"[{index:04X}sub{entry.subindex:X}]"
        yield from _variable(entry, neighbour)


def _variable(entry: ObjectDef, neighbour: dict[tuple[int, int], Value]) -> Iterator[str]:
    yield f"ParameterName={entry.name}"
    yield f"ObjectType=0x{_VAR:X}"
    yield f"DataType=0x{entry.data_type:04X}"
    yield f"AccessType={entry.access.value}"
    yield f"DefaultValue={_default(entry, neighbour[entry.key])}"
    yield f"PDOMapping={int(entry.mappable)}"
    if entry.low is not None:
        yield f"LowLimit={_text(entry, entry.low)}"
    if entry.high is not None:
        yield f"HighLimit={_text(entry, entry.high)}"
    if entry.scale != 1.0:
        yield f"Factor={entry.scale!r}"
    if entry.unit:
        yield f"Unit={''.join(_ASCII.get(letter, letter) for letter in entry.unit)}"
    yield ""


def _default(entry: ObjectDef, neighbour: Value) -> str:
    if isinstance(entry.default, int) and isinstance(neighbour, int) and neighbour == entry.default + 1:
        return f"$NODEID+0x{entry.default - 1:X}"
    return _text(entry, entry.default)


def _text(entry: ObjectDef, value: Value) -> str:
    """Hexadecimal for unsigned, decimal for signed: readers do not agree on two's complement of 24 bits."""
    if entry.data_type in (DataType.REAL32, DataType.REAL64):
        return repr(float(value))
    if isinstance(value, str) or entry.data_type.signed:
        return str(int(value)) if isinstance(value, int) else str(value)
    return f"0x{int(value):X}"
