"""Communication objects that every device has (CiA 301, 1000h to 1200h), and those that describe its PDOs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from drivers.objects import Access, DataType, ObjectDef, PdoDef, PdoKind

COB_SYNC = 0x080
COB_EMCY = 0x080
COB_SDO_REPLY = 0x580
COB_SDO_REQUEST = 0x600
COB_HEARTBEAT = 0x700
COB_RPDO = (0x200, 0x300, 0x400, 0x500)
COB_TPDO = (0x180, 0x280, 0x380, 0x480)
COB_DISABLED = 1 << 31
COB_NO_REMOTE_REQUEST = 1 << 30
COB_SYNC_PRODUCER = 1 << 30

HEARTBEAT_MS = 100
HEARTBEAT_TIMEOUT_MS = 350
SYNC_PERIOD_US = 10_000
ERROR_HISTORY_LENGTH = 8
MAPPING_SLOTS = 8
CONSUMER_SLOTS = 4
DEVICE_TYPE_SERVO_DRIVE = 0x0002_0192
"""CiA 402 (192h), servo drive (bit 17)."""
DEVICE_TYPE_MANUFACTURER = 0
"""No standard profile."""

U8, U16, U32, TEXT = DataType.UNSIGNED8, DataType.UNSIGNED16, DataType.UNSIGNED32, DataType.VISIBLE_STRING


@dataclass(frozen=True, slots=True)
class Identity:
    """What a device says of itself in 1000h, 1008h and 1018h."""

    product: str
    product_code: int
    device_type: int = DEVICE_TYPE_MANUFACTURER
    sync_producer: bool = False


def array(
    index: int,
    name: str,
    entries: Sequence[str],
    data_type: DataType,
    *,
    access: Access = Access.RW,
    defaults: Sequence[int | float] = (),
    unit: str = "",
    scale: float = 1.0,
    mappable: bool = False,
    low: float | None = None,
    count_access: Access = Access.CONST,
) -> list[ObjectDef]:
    """Sub 0 = number of entries, then one object of the same type per entry; no `defaults`: all 0."""
    values = defaults or [0.0 if data_type is DataType.REAL32 else 0] * len(entries)
    count = ObjectDef(index, 0, f"{name}: number of entries", U8, count_access, len(entries))
    return [count] + [
        ObjectDef(index, sub, entry, data_type, access, value, mappable=mappable, low=low, unit=unit, scale=scale)
        for sub, (entry, value) in enumerate(zip(entries, values, strict=True), start=1)
    ]


def communication_objects(node_id: int, identity: Identity, consumed_heartbeats: Iterable[int]) -> list[ObjectDef]:
    """1000h … 1200h. `consumed_heartbeats`: node ids that are watched from power-up; further slots are free."""
    sync = COB_SYNC | (COB_SYNC_PRODUCER if identity.sync_producer else 0)
    watched = [producer << 16 | HEARTBEAT_TIMEOUT_MS for producer in consumed_heartbeats]
    watched += [0] * (CONSUMER_SLOTS - len(watched))
    return [
        ObjectDef(0x1000, 0, "Device type", U32, Access.CONST, identity.device_type),
        ObjectDef(0x1001, 0, "Error register", U8, Access.RO, 0, mappable=True),
        ObjectDef(0x1003, 0, "Pre-defined error field: number of errors", U8, Access.RW, 0),
        *(
            ObjectDef(0x1003, sub, f"Standard error field {sub}", U32, Access.RO, 0)
            for sub in range(1, ERROR_HISTORY_LENGTH + 1)
        ),
        ObjectDef(0x1005, 0, "COB-ID SYNC", U32, Access.RW, sync),
        ObjectDef(0x1006, 0, "Communication cycle period", U32, Access.RW, SYNC_PERIOD_US, unit="s", scale=1e-6),
        ObjectDef(0x1008, 0, "Manufacturer device name", TEXT, Access.CONST, identity.product),
        ObjectDef(0x1009, 0, "Manufacturer hardware version", TEXT, Access.CONST, "simulated"),
        ObjectDef(0x100A, 0, "Manufacturer software version", TEXT, Access.CONST, "1.0"),
        ObjectDef(0x1014, 0, "COB-ID EMCY", U32, Access.RW, COB_EMCY + node_id),
        ObjectDef(0x1015, 0, "Inhibit time EMCY", U16, Access.RW, 0, unit="s", scale=1e-4),
        *array(
            0x1016, "Consumer heartbeat time", [f"Consumer {i + 1}" for i in range(len(watched))], U32, defaults=watched
        ),
        ObjectDef(0x1017, 0, "Producer heartbeat time", U16, Access.RW, HEARTBEAT_MS, unit="s", scale=1e-3),
        *array(
            0x1018,
            "Identity",
            ["Vendor-ID", "Product code", "Revision number", "Serial number"],
            U32,
            access=Access.CONST,
            defaults=[0, identity.product_code, 0x0001_0000, node_id],
        ),
        ObjectDef(0x1019, 0, "Synchronous counter overflow value", U8, Access.RW, 0, high=240),
        # 0: pre-operational when already operational, 1: no change, 2: stopped
        ObjectDef(0x1029, 0, "Error behaviour: number of entries", U8, Access.CONST, 1),
        ObjectDef(0x1029, 1, "Communication error", U8, Access.RW, 0, low=0, high=2),
        *array(
            0x1200,
            "SDO server parameter",
            ["COB-ID client to server", "COB-ID server to client"],
            U32,
            access=Access.RO,
            defaults=[COB_SDO_REQUEST + node_id, COB_SDO_REPLY + node_id],
        ),
    ]


def pdo_objects(pdos: Iterable[PdoDef], types: dict[tuple[int, int], DataType], *, remappable: bool) -> list[ObjectDef]:
    """14xxh/16xxh and 18xxh/1Axxh of every PDO; `types` gives the length of what is mapped.

    Raises ValueError for a PDO that maps more than 8 bytes.
    """
    objects: list[ObjectDef] = []
    for pdo in pdos:
        bits = sum(types[key].bits for key in pdo.mapping)
        if bits > 64:
            raise ValueError(f"{pdo.name}: maps {bits} bits; must be at most 64")
        objects += _communication_record(pdo)
        objects += _mapping_record(pdo, types, Access.RW if remappable else Access.CONST)
    return objects


def _communication_record(pdo: PdoDef) -> list[ObjectDef]:
    transmit = pdo.kind is PdoKind.TPDO
    index = (0x1800 if transmit else 0x1400) + pdo.number - 1
    cob_id = pdo.cob_id | (0 if pdo.enabled else COB_DISABLED) | (COB_NO_REMOTE_REQUEST if transmit else 0)
    kind = "TPDO" if transmit else "RPDO"
    record = [
        ObjectDef(
            index, 0, f"{kind} {pdo.number} communication: highest sub-index", U8, Access.CONST, 6 if transmit else 5
        ),
        ObjectDef(index, 1, f"COB-ID used by {kind} {pdo.number}", U32, Access.RW, cob_id),
        ObjectDef(index, 2, "Transmission type", U8, Access.RW, pdo.transmission_type),
        ObjectDef(index, 3, "Inhibit time", U16, Access.RW, 0, unit="s", scale=1e-4),
        ObjectDef(index, 5, "Event timer", U16, Access.RW, pdo.event_timer_ms, unit="s", scale=1e-3),
    ]
    if transmit:
        record.append(ObjectDef(index, 6, "SYNC start value", U8, Access.RW, 0, high=240))
    return record


def _mapping_record(pdo: PdoDef, types: dict[tuple[int, int], DataType], access: Access) -> list[ObjectDef]:
    transmit = pdo.kind is PdoKind.TPDO
    index = (0x1A00 if transmit else 0x1600) + pdo.number - 1
    kind = "TPDO" if transmit else "RPDO"
    entries = [mapped << 16 | sub << 8 | types[mapped, sub].bits for mapped, sub in pdo.mapping]
    slots = MAPPING_SLOTS if access is Access.RW else len(entries)
    entries += [0] * (slots - len(entries))
    return [
        ObjectDef(
            index,
            0,
            f"{kind} {pdo.number} mapping: number of mapped objects",
            U8,
            access,
            len(pdo.mapping),
            low=0,
            high=slots,
        ),
        *(ObjectDef(index, sub, f"Mapped object {sub}", U32, access, entry) for sub, entry in enumerate(entries, 1)),
    ]
