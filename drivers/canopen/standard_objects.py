"""Objects that CiA 301 wants in every device and that a device table need not spell out.

Communication parameters of the PDOs follow from `DeviceDef.pdos`. An index that the table already has is left alone.
"""

from __future__ import annotations

from collections.abc import Iterator

from drivers.objects import Access, DataType, DeviceDef, ObjectDef, PdoDef, PdoKind

PDO_INVALID = 1 << 31
NO_REMOTE_REQUEST = 1 << 30
MAPPING_SLOTS = 8
HISTORY_LENGTH = 8
HEARTBEAT_CONSUMERS = 4

_U8, _U16, _U32 = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32


def missing_objects(device: DeviceDef) -> Iterator[ObjectDef]:
    """Definitions to add to `device.objects`, in order of their index."""
    present = {definition.index for definition in device.objects}
    for definition in _communication(device.node_id):
        if definition.index not in present:
            yield definition
    for pdo in device.pdos:
        for definition in _pdo_parameters(device, pdo):
            if definition.index not in present:
                yield definition


def _communication(node_id: int) -> Iterator[ObjectDef]:
    yield ObjectDef(0x1000, 0, "Device type", _U32, Access.RO)
    yield ObjectDef(0x1001, 0, "Error register", _U8, Access.RO, mappable=True)
    yield ObjectDef(0x1003, 0, "Number of errors", _U8)
    for slot in range(1, HISTORY_LENGTH + 1):
        yield ObjectDef(0x1003, slot, f"Standard error field {slot}", _U32, Access.RO)
    yield ObjectDef(0x1005, 0, "COB-ID SYNC", _U32, default=0x80)
    yield ObjectDef(0x1014, 0, "COB-ID EMCY", _U32, default=0x80 + node_id)
    yield ObjectDef(0x1015, 0, "Inhibit time EMCY", _U16)
    yield ObjectDef(0x1016, 0, "Number of heartbeat consumers", _U8, Access.CONST, HEARTBEAT_CONSUMERS)
    for slot in range(1, HEARTBEAT_CONSUMERS + 1):
        yield ObjectDef(0x1016, slot, f"Consumer heartbeat time {slot}", _U32)
    yield ObjectDef(0x1017, 0, "Producer heartbeat time", _U16)
    yield ObjectDef(0x1018, 0, "Number of identity entries", _U8, Access.CONST, 1)
    yield ObjectDef(0x1018, 1, "Vendor-ID", _U32, Access.RO)
    yield ObjectDef(0x1019, 0, "Synchronous counter overflow value", _U8, high=240)
    yield ObjectDef(0x1029, 0, "Number of error behaviours", _U8, Access.CONST, 1)
    yield ObjectDef(0x1029, 1, "Communication error behaviour", _U8, high=2)


def _pdo_parameters(device: DeviceDef, pdo: PdoDef) -> Iterator[ObjectDef]:
    receive = pdo.kind is PdoKind.RPDO
    kind = "RPDO" if receive else "TPDO"
    communication = (0x1400 if receive else 0x1800) + pdo.number - 1
    cob_id = pdo.cob_id | (0 if pdo.enabled else PDO_INVALID) | (0 if receive else NO_REMOTE_REQUEST)
    yield ObjectDef(communication, 0, f"{kind} {pdo.number} highest subindex", _U8, Access.CONST, 5 if receive else 6)
    yield ObjectDef(communication, 1, f"{kind} {pdo.number} COB-ID", _U32, default=cob_id)
    yield ObjectDef(communication, 2, f"{kind} {pdo.number} transmission type", _U8, default=pdo.transmission_type)
    yield ObjectDef(communication, 3, f"{kind} {pdo.number} inhibit time", _U16)
    yield ObjectDef(communication, 5, f"{kind} {pdo.number} event timer", _U16, default=pdo.event_timer_ms)
    if not receive:
        yield ObjectDef(communication, 6, f"{kind} {pdo.number} SYNC start value", _U8, high=240)
    mapping = communication + 0x200
    yield ObjectDef(mapping, 0, f"{kind} {pdo.number} mapped objects", _U8, default=len(pdo.mapping))
    for slot in range(1, MAPPING_SLOTS + 1):
        word = 0
        if slot <= len(pdo.mapping):
            index, subindex = pdo.mapping[slot - 1]
            word = index << 16 | subindex << 8 | device.object(index, subindex).data_type.bits
        yield ObjectDef(mapping, slot, f"{kind} {pdo.number} mapping {slot}", _U32, default=word)
