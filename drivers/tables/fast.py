"""Fast frames: PDOs of 8 bytes whose last two are a counter and a checksum, with the objects that they map."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.objects import Access, DataType, DeviceDef, ObjectDef, PdoDef, PdoKind
from drivers.tables.communication import COB_TPDO, U8, Identity, communication_objects, pdo_objects

EVENT_DRIVEN = 254
EVERY_SYNC = 1


@dataclass(frozen=True, slots=True)
class Signal:
    """One value in a fast frame. `key`: the object that holds it, where that is not in the frame's own record."""

    name: str
    data_type: DataType
    unit: str = ""
    scale: float = 1.0
    key: tuple[int, int] | None = None
    high: int | None = None


@dataclass(frozen=True, slots=True)
class FastFrame:
    """TPDO `number` with its signals; `index` is the record that holds those, the counter and the checksum."""

    number: int
    name: str
    index: int
    signals: tuple[Signal, ...]
    transmission_type: int = EVENT_DRIVEN
    cob_id: int | None = None
    """Identifier where it is not that of the predefined connection set, which has none for a fifth TPDO."""


def vector(names: str, data_type: DataType, unit: str, scale: float) -> tuple[Signal, ...]:
    """One signal per name, all alike."""
    return tuple(Signal(name, data_type, unit, scale) for name in names.split())


def fast_device(
    name: str,
    node_id: int,
    identity: Identity,
    frames: tuple[FastFrame, ...],
    parameters: list[ObjectDef],
    consumed_heartbeats: list[int],
) -> DeviceDef:
    """A device whose process data are fast frames. Raises ValueError for a frame that is not 8 bytes long."""
    objects = list(parameters)
    pdos = []
    for frame in frames:
        record, mapping = _record(frame)
        objects += record
        cob_id = COB_TPDO[frame.number - 1] + node_id if frame.cob_id is None else frame.cob_id
        pdos.append(
            PdoDef(
                PdoKind.TPDO,
                frame.number,
                cob_id,
                mapping,
                frame.transmission_type,
                name=frame.name,
            )
        )
    types = {entry.key: entry.data_type for entry in objects}
    for pdo in pdos:
        bits = sum(types[key].bits for key in pdo.mapping)
        if bits != 64:
            raise ValueError(f"{name} {pdo.name}: {bits} bits; a fast frame has 64")
    objects += communication_objects(node_id, identity, consumed_heartbeats)
    objects += pdo_objects(pdos, types, remappable=False)
    return DeviceDef(name, node_id, tuple(sorted(objects, key=lambda entry: entry.key)), tuple(pdos), identity.product)


def _record(frame: FastFrame) -> tuple[list[ObjectDef], tuple[tuple[int, int], ...]]:
    own: list[ObjectDef] = []
    mapping: list[tuple[int, int]] = []
    for signal in (*frame.signals, Signal("counter", U8), Signal("checksum", U8)):
        key = signal.key or (frame.index, len(own) + 1)
        mapping.append(key)
        if signal.key is None:
            own.append(
                ObjectDef(
                    *key,
                    signal.name,
                    signal.data_type,
                    Access.RO,
                    mappable=True,
                    high=signal.high,
                    unit=signal.unit,
                    scale=signal.scale,
                )
            )
    count = ObjectDef(frame.index, 0, f"{frame.name}: number of entries", U8, Access.CONST, len(own))
    return [count, *own], tuple(mapping)
