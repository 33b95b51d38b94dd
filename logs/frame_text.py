"""Frames in the words of the catalogue: which message, which fields, what they say. For people who look for a difference."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drivers.canopen.nmt import ERROR_CONTROL_BASE, NMT_CAN_ID, NmtCommand, NmtState
from drivers.frame_codec import Field, fields_of
from drivers.objects import DeviceDef, ObjectDef, PdoKind
from logs.tape import SYNC_ID

EMCY_BASE, SDO_RESPONSE, SDO_REQUEST = 0x080, 0x580, 0x600


@dataclass(frozen=True, slots=True)
class FieldText:
    """One value of a frame. `resolution`: what one count of the wire stands for; 0 for codes and flags, which agree or do not."""

    name: str
    value: float | str
    unit: str = ""
    resolution: float = 0.0

    def __str__(self) -> str:
        number = self.value if isinstance(self.value, str) else f"{self.value:.10g}"
        return f"{number} {self.unit}".strip()


@dataclass(frozen=True, slots=True)
class FrameText:
    """A frame that was read: name of the message with its sender or receiver, and its fields in the order of the wire."""

    message: str
    fields: tuple[FieldText, ...] = ()


class FrameReader:
    """Reads any frame of a bus of these `devices`; what the catalogue does not know is shown as bytes."""

    def __init__(self, devices: Iterable[DeviceDef]) -> None:
        self._devices = {device.node_id: device for device in devices}
        self._pdos: dict[int, tuple[str, tuple[Field, ...], DeviceDef]] = {}
        self._objects: dict[int, dict[tuple[int, int], ObjectDef]] = {}
        for device in self._devices.values():
            for pdo in device.pdos:
                if pdo.enabled:
                    way = "to" if pdo.kind is PdoKind.RPDO else "of"
                    title = f"{pdo.name or pdo.kind.name + str(pdo.number)} {way} {_title(device)}"
                    self._pdos[pdo.cob_id & 0x7FF] = (title, fields_of(device, pdo), device)

    def read(self, can_id: int, data: bytes) -> FrameText:
        """Never raises: a frame of another length than its definition is shown as bytes."""
        if can_id in self._pdos:
            title, fields, _ = self._pdos[can_id]
            if 8 * len(data) == sum(field.bits for field in fields):
                return FrameText(title, tuple(_values(fields, data)))
            return FrameText(title, (FieldText("bytes", data.hex(" ")),))
        return FrameText(*self._service(can_id, data))

    def _service(self, can_id: int, data: bytes) -> tuple[str, tuple[FieldText, ...]]:
        raw = (FieldText("bytes", data.hex(" ")),)
        if can_id == NMT_CAN_ID and len(data) == 2:
            return "NMT", (FieldText("command", _name(NmtCommand, data[0])), FieldText("node", self._node(data[1])))
        if can_id == SYNC_ID:
            return "SYNC", raw if data else ()
        node = can_id & 0x7F
        base = can_id - node
        if base == ERROR_CONTROL_BASE and len(data) == 1:
            return f"heartbeat of {self._node(node)}", (FieldText("state", _name(NmtState, data[0])),)
        if base == EMCY_BASE and len(data) == 8:
            code, register = int.from_bytes(data[:2], "little"), data[2]
            fields = (FieldText("code", f"{code:04X}h"), FieldText("register", f"{register:02X}h"))
            return f"EMCY of {self._node(node)}", (*fields, FieldText("detail", data[3:].hex(" ")))
        if base in (SDO_REQUEST, SDO_RESPONSE) and len(data) == 8:
            kind = "SDO request to" if base == SDO_REQUEST else "SDO response of"
            return f"{kind} {self._node(node)}", self._sdo(node, data)
        return f"{can_id:03X}h", raw

    def _sdo(self, node: int, data: bytes) -> tuple[FieldText, ...]:
        index, subindex = int.from_bytes(data[1:3], "little"), data[3]
        key = f"{index:04X}h sub {subindex}"
        entry = self._object(node, index, subindex)
        value = data[4:].hex(" ")
        return (
            FieldText("command", f"{data[0]:02X}h"),
            FieldText("object", f"{key} ({entry.name})" if entry is not None else key),
            FieldText("data", value),
        )

    def _object(self, node: int, index: int, subindex: int) -> ObjectDef | None:
        if node not in self._objects:
            device = self._devices.get(node)
            entries = () if device is None else device.objects
            self._objects[node] = {(entry.index, entry.subindex): entry for entry in entries}
        return self._objects[node].get((index, subindex))

    def _node(self, node: int) -> str:
        return "all nodes" if node == 0 else _title(self._devices[node]) if node in self._devices else f"node {node}"


def differing_fields(
    expected: FrameText, got: FrameText, tolerance: float = 0.0
) -> list[tuple[FieldText | None, FieldText | None]]:
    """Pairs of fields that differ, in the order of the wire; None where only one of the two has a field.

    With a `tolerance` (SI), physical values may differ by that much or by one count of the wire, whichever is more, and a checksum
    over such values is not looked at.
    """
    if [field.name for field in expected.fields] != [field.name for field in got.fields]:
        return [(field, None) for field in expected.fields] + [(None, field) for field in got.fields]
    pairs = zip(expected.fields, got.fields, strict=True)
    return [(a, b) for a, b in pairs if not _agree(a, b, tolerance)]


def _agree(a: FieldText, b: FieldText, tolerance: float) -> bool:
    if a.value == b.value:
        return True
    if tolerance <= 0.0:
        return False
    if a.name == "checksum":
        return True
    if a.resolution == 0.0 or isinstance(a.value, str) or isinstance(b.value, str):
        return False
    return abs(a.value - b.value) <= max(tolerance, 1.000001 * a.resolution)


def _values(fields: tuple[Field, ...], data: bytes) -> Iterable[FieldText]:
    word = int.from_bytes(data, "little")
    for field in fields:
        raw = word >> field.shift & (1 << field.bits) - 1
        if field.signed and raw >> field.bits - 1:
            raw -= 1 << field.bits
        if field.name in _HEX:
            yield FieldText(field.name, f"{raw:0{field.bits // 4}X}h")
        else:
            yield FieldText(field.name, raw * field.scale, _unit(field), field.scale if field.scale != 1.0 else 0.0)


_HEX = ("checksum", "Controlword", "Statusword", "Restrictions")


def _unit(field: Field) -> str:
    return "of rated torque" if field.unit == "rated torque" else field.unit


def _title(device: DeviceDef) -> str:
    return f"{device.name} (node {device.node_id})"


def _name(kind: type[NmtCommand] | type[NmtState], value: int) -> str:
    try:
        return kind(value).name.lower().replace("_", " ")
    except ValueError:
        return f"{value:02X}h"
