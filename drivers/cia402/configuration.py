"""How a drive master finds a drive, makes sure of what it is, and sets it up: sequences of SDO accesses.

Everything is read first and written only where it differs; what was written is read back. PDOs are changed by the
procedure of CiA 301, 7.5.2.36: invalid, mapping off, mapping, mapping on, valid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from drivers.canopen.nmt import NmtCommand, NmtState
from drivers.canopen.sdo_abort import SdoAborted, StepError
from drivers.canopen.sequence import Delay, Download, Sequence, Until, Upload
from drivers.cia402.axis import MODE_CSP, AxisClient
from drivers.cia402.bench import BenchDrive
from drivers.cia402.drive_units import in_drive_units
from drivers.cia402.identification import Note, definition_default, identify, read_units, upload_if_there
from drivers.cia402.settling import ensure, settle
from drivers.cia402.units import UnitError, interpolation_period
from drivers.clock import Clock
from drivers.objects import DataType, DeviceDef, PdoDef, PdoKind, Value

PDO_OFF = 1 << 31
_VALID_AND_ID = PDO_OFF | 0x1FFF_FFFF
PDOS_PER_KIND = 4
SETTINGS = (0x6007, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x6065, 0x6066, 0x6072, 0x607D, 0x607F, 0x6085, 0x60C5)
"""Objects that get the value of the device's definition, unless `DriveSettings.parameters` says otherwise."""
_MODE_TRIES = 20
START_TRIES = 4
"""NMT commands are not confirmed: one that got lost is given again."""


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What every drive of a master is set to. `parameters`: node id -> object -> value, over the device's definition and in its units.

    `bench`: drives that are not those of the table, by node id.
    """

    sync_period_ns: int = 10_000_000
    master_node_id: int = 2
    heartbeat_ms: int = 100
    heartbeat_timeout_ms: int = 350
    check_identity: bool = True
    parameters: Mapping[int, Mapping[tuple[int, int], Value]] = field(default_factory=dict)
    bench: Mapping[int, BenchDrive] = field(default_factory=dict)
    answer_timeout_ns: int = 1_000_000_000
    """For a change of the NMT state, and for the first feedback after the start."""
    sdo_gap_ns: int = 0
    """Least time between two SDO requests of this master; ten drives set up at once fill a bus without it."""

    def of(self, device: DeviceDef) -> dict[tuple[int, int], Value]:
        """Wanted value of each setting of a drive. Raises KeyError for a parameter that the device does not have."""
        wanted: dict[tuple[int, int], Value] = {
            entry.key: entry.default
            for entry in device.objects
            if entry.index in SETTINGS and not (entry.index == 0x607D and entry.subindex == 0)
        }
        for key, value in self.parameters.get(device.node_id, {}).items():
            wanted[device.object(*key).key] = value
        return wanted


def set_up(
    axis: AxisClient, settings: DriveSettings, clock: Clock, command: Callable[[NmtCommand], None], note: Note
) -> Sequence[None]:
    """From a drive that answers to one that is operational, set up, and has told its statusword. `command`: NMT.

    `note` hears of what the drive does not have or does not let be written, where that is no reason to end.
    """
    axis.started = False
    if axis.nmt_state != NmtState.PRE_OPERATIONAL:
        command(NmtCommand.ENTER_PRE_OPERATIONAL)
        axis.nmt_state = None
        yield Delay(2_000_000)  # a drive whose heartbeat is off does not tell; SDO shows whether it is there
    axis.kept.clear()
    bench = settings.bench.get(axis.node_id, BenchDrive())
    of_table = False
    if settings.check_identity:
        of_table = yield from identify(axis, bench, note)
    yield from read_units(axis, bench, of_table=of_table and axis.node_id not in settings.bench)
    yield from set_pdos(axis.device)
    yield from set_timing(axis, settings, bench, note)
    for key, value in settings.of(axis.device).items():
        yield from settle(axis, bench, note, key, _in_drive_units(axis, key, value))
    yield from set_mode(axis, settings, bench, note)
    axis.statusword = None
    axis.started = True
    axis.started_ns = clock.now_ns()
    for attempt in range(1, START_TRIES + 1):
        command(NmtCommand.START)
        try:
            yield Until(
                lambda: axis.statusword is not None,
                settings.answer_timeout_ns // START_TRIES,
                "TPDO1 after the NMT start (is SYNC running?)",
                lambda: f"NMT state {axis.nmt_state}, no TPDO1",
            )
            return
        except StepError:
            if attempt == START_TRIES:
                raise


def _in_drive_units(axis: AxisClient, key: tuple[int, int], value: Value) -> Value:
    try:
        return value if isinstance(value, str) else in_drive_units(axis.device, axis.units, key, int(value))
    except UnitError as error:
        raise StepError(error.expected, error.came) from error


def set_pdos(device: DeviceDef) -> Sequence[None]:
    """All PDOs as the table has them; those not in use are off (a default-valid one may take another axis' frames)."""
    for kind in PdoKind:
        wanted = {pdo.number: pdo for pdo in device.pdos if pdo.kind is kind and pdo.enabled}
        for number in range(1, PDOS_PER_KIND + 1):
            pdo = wanted.get(number)
            if pdo is None:
                yield from _switch_off(kind, number)
            else:
                differences = yield from pdo_differences(device, pdo)
                if differences:
                    yield from _write_pdo(device, pdo)
                    yield from verify_pdo(device, pdo)


def verify_pdo(device: DeviceDef, pdo: PdoDef) -> Sequence[None]:
    """Fails, naming the object, where a PDO in the drive is not what the table says."""
    differences = yield from pdo_differences(device, pdo)
    if differences:
        raise StepError(f"{pdo.kind.name}{pdo.number} as configured", "; ".join(differences))


def verify_process_data(device: DeviceDef) -> Sequence[None]:
    """`verify_pdo` for every PDO in use: has somebody else changed the mapping?"""
    for pdo in device.pdos:
        if pdo.enabled:
            yield from verify_pdo(device, pdo)


def pdo_differences(device: DeviceDef, pdo: PdoDef) -> Sequence[list[str]]:
    """What of a PDO in the drive is not as in the table, in words; the reading ends at the first one."""
    communication, _ = _records(pdo.kind, pdo.number)
    cob_id = yield Upload(communication, 1, DataType.UNSIGNED32)
    if cob_id & _VALID_AND_ID != pdo.cob_id:
        return [_difference(communication, 1, pdo.cob_id, cob_id)]
    for (index, subindex), wanted in _parameters(device, pdo):
        came = yield Upload(index, subindex)
        if came != wanted:
            return [_difference(index, subindex, wanted, came)]
    return []


def set_timing(axis: AxisClient, settings: DriveSettings, bench: BenchDrive, note: Note) -> Sequence[None]:
    """SYNC period (1006h, 60C2h) and heartbeats both ways (1016h, 1017h)."""
    if definition_default(axis.device, 0x1006, 0) is not None:
        period_us = round(settings.sync_period_ns / 1000)
        yield from settle(axis, bench, note, (0x1006, 0), period_us, DataType.UNSIGNED32)
    value, index = interpolation_period(settings.sync_period_ns)
    yield from settle(axis, bench, note, (0x60C2, 2), index, DataType.INTEGER8)
    yield from settle(axis, bench, note, (0x60C2, 1), value, DataType.UNSIGNED8)
    consumed = settings.master_node_id << 16 | settings.heartbeat_timeout_ms
    yield from ensure(0x1016, 1, consumed, DataType.UNSIGNED32)
    yield from ensure(0x1017, 0, settings.heartbeat_ms, DataType.UNSIGNED16)


def set_mode(axis: AxisClient, settings: DriveSettings, bench: BenchDrive, note: Note) -> Sequence[None]:
    """Mode of operation, confirmed by 6061h."""
    yield from settle(axis, bench, note, (0x6060, 0), axis.mode, DataType.INTEGER8)
    shown = 0
    for _ in range(_MODE_TRIES):
        shown = yield Upload(0x6061, 0, DataType.INTEGER8)
        if shown == axis.mode:
            return
        yield Delay(settings.sync_period_ns)
    name = "CSP" if axis.mode == MODE_CSP else "CSV"
    raise StepError(f"mode {axis.mode} ({name}) in 6061h", str(shown))


def _write_pdo(device: DeviceDef, pdo: PdoDef) -> Sequence[None]:
    communication, mapping = _records(pdo.kind, pdo.number)
    present = yield Upload(communication, 1, DataType.UNSIGNED32)
    if not present & PDO_OFF:
        # as long as it is valid, only bit 31 of the COB-ID may change
        yield Download(communication, 1, present | PDO_OFF, DataType.UNSIGNED32)
    yield Download(mapping, 0, 0, DataType.UNSIGNED8)
    for (index, subindex), value in _parameters(device, pdo):
        if subindex or index != mapping:
            try:
                yield Download(index, subindex, value, _parameter_type(index, subindex))
            except SdoAborted as error:
                if index != mapping:
                    raise
                mapped = f"{value >> 16:04X}h sub {value >> 8 & 0xFF}"
                where = f"{pdo.kind.name}{pdo.number} ({index:04X}h sub {subindex})"
                raise StepError(f"{mapped} to be mapped in {where}", error.came, error.code) from error
    yield Download(mapping, 0, len(pdo.mapping), DataType.UNSIGNED8)
    yield Download(communication, 1, present & ~_VALID_AND_ID | pdo.cob_id, DataType.UNSIGNED32)


def _switch_off(kind: PdoKind, number: int) -> Sequence[None]:
    communication, _ = _records(kind, number)
    cob_id = yield from upload_if_there(communication, 1)
    if cob_id is not None and not cob_id & PDO_OFF:
        yield Download(communication, 1, cob_id | PDO_OFF, DataType.UNSIGNED32)
        came = yield Upload(communication, 1, DataType.UNSIGNED32)
        if not came & PDO_OFF:
            raise StepError(f"{kind.name}{number} to be off (bit 31 of {communication:04X}h sub 1)", f"{came:08X}h")


def _parameters(device: DeviceDef, pdo: PdoDef) -> Iterator[tuple[tuple[int, int], int]]:
    """Objects of a PDO but its COB-ID, with the value that each shall have; the number of mapped objects last."""
    communication, mapping = _records(pdo.kind, pdo.number)
    yield (communication, 2), pdo.transmission_type
    if pdo.kind is PdoKind.TPDO and pdo.transmission_type >= 254:
        yield (communication, 5), pdo.event_timer_ms
    for slot, (index, subindex) in enumerate(pdo.mapping, start=1):
        yield (mapping, slot), index << 16 | subindex << 8 | device.object(index, subindex).data_type.bits
    yield (mapping, 0), len(pdo.mapping)


def _parameter_type(index: int, subindex: int) -> DataType:
    if index & 0x200:  # 16xxh, 1Axxh
        return DataType.UNSIGNED32 if subindex else DataType.UNSIGNED8
    return DataType.UNSIGNED8 if subindex == 2 else DataType.UNSIGNED16


def _records(kind: PdoKind, number: int) -> tuple[int, int]:
    communication = (0x1400 if kind is PdoKind.RPDO else 0x1800) + number - 1
    return communication, communication + 0x200


def _difference(index: int, subindex: int, wanted: int, came: int) -> str:
    return f"{index:04X}h sub {subindex} is {came:#x}, not {wanted:#x}"
