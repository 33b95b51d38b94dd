"""The EDS files, read by the `canopen` package: objects, types, defaults and PDO maps are those of the catalogue."""

from __future__ import annotations

import configparser
from pathlib import Path

import canopen
import pytest

from drivers.catalogue import devices, drive
from drivers.export import eds_files, write
from drivers.objects import Access, DataType, PdoKind
from drivers.tables.drive import WHEEL_LIMITS

CHECKED_IN = Path(__file__).parents[2] / "config" / "bus"
TABLE = devices()
FILES = {
    "joint_drive.eds": drive(27, "joint_drive"),
    "wheel_drive.eds": drive(12, "wheel_drive", 10_000, WHEEL_LIMITS, wheel=True),
    "planner.eds": TABLE[2],
    "strategic.eds": TABLE[1],
    "force_sensor.eds": TABLE[31],
    "tracker.eds": TABLE[32],
    "gripper.eds": TABLE[33],
}
CASES = pytest.mark.parametrize(("name", "device"), FILES.items(), ids=FILES)


def test_the_checked_in_files_are_the_generated_ones():
    generated = eds_files()
    assert set(generated) == set(FILES) == {path.name for path in CHECKED_IN.glob("*.eds")}
    for name, text in generated.items():
        assert (CHECKED_IN / name).read_bytes() == text.encode("ascii"), "run: canipulator bus export eds config/bus"


def test_write_gives_the_same_files(tmp_path):
    paths = write(tmp_path / "new", eds_files())
    assert [(path.name, path.read_text()) for path in paths] == list(eds_files().items())


@CASES
def test_canopen_reads_every_object(name, device):
    dictionary = canopen.import_od(str(CHECKED_IN / name), device.node_id)
    assert set(dictionary) == {entry.index for entry in device.objects}
    for entry in device.objects:
        found = dictionary[entry.index]
        variable = found if isinstance(found, canopen.objectdictionary.ODVariable) else found[entry.subindex]
        assert variable.data_type == entry.data_type, entry
        assert variable.access_type == entry.access.value, entry
        assert variable.default == entry.default, entry
        assert variable.pdo_mappable is entry.mappable, entry
        assert variable.factor == entry.scale, entry
        if entry.data_type.is_integer and entry.data_type is not DataType.INTEGER24:
            assert (variable.min, variable.max) == (entry.low, entry.high), entry


@CASES
def test_canopen_knows_the_pdos(name, device):
    node = canopen.Network().add_node(device.node_id, str(CHECKED_IN / name))
    for pdo in device.pdos:
        maps = node.rpdo if pdo.kind is PdoKind.RPDO else node.tpdo
        maps[pdo.number].read(from_od=True)
        assert maps[pdo.number].cob_id == pdo.cob_id
        assert maps[pdo.number].enabled is pdo.enabled
        assert maps[pdo.number].trans_type == pdo.transmission_type
        if pdo.enabled:
            assert [(variable.index, variable.subindex) for variable in maps[pdo.number].map] == list(pdo.mapping)
            lengths = [device.object(*key).data_type.bits for key in pdo.mapping]
            assert [variable.length for variable in maps[pdo.number].map] == lengths


@CASES
def test_one_file_serves_every_node_id(name, device):
    for node_id in (1, 21, 127):
        dictionary = canopen.import_od(str(CHECKED_IN / name), node_id)
        assert dictionary[0x1800][1].default == 0x40000180 + node_id
        assert dictionary[0x1014].default == 0x80 + node_id
        assert dictionary[0x1200][1].default == 0x600 + node_id
        assert dictionary[0x1018][4].default == node_id


@CASES
def test_the_lists_of_objects_are_complete(name, device):
    eds = configparser.RawConfigParser()
    eds.optionxform = str
    eds.read(CHECKED_IN / name, encoding="ascii")
    listed = []
    for section in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = int(eds[section]["SupportedObjects"])
        listed += [int(eds[section][str(number)], 16) for number in range(1, count + 1)]
        assert len(eds[section]) == count + 1
    assert sorted(listed) == sorted({entry.index for entry in device.objects})
    assert eds["FileInfo"]["FileName"] == name
    assert int(eds["DeviceInfo"]["NrOfRXPDO"]) == sum(pdo.kind is PdoKind.RPDO for pdo in device.pdos)
    for section in eds.sections():
        if eds.has_option(section, "SubNumber"):
            assert int(eds[section]["SubNumber"]) == sum(other.startswith(f"{section}sub") for other in eds.sections())


def test_constant_objects_cannot_be_written():
    for device in TABLE.values():
        assert device.object(0x1018, 1).access is Access.CONST
