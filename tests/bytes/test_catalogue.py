"""The catalogue against the conventions of CANopen and against itself."""

from __future__ import annotations

import pytest

from drivers.catalogue import DEFAULT_DRIVES, DRIVE_IDS, JOINT_IDS, WHEEL_IDS, DriveParameters, devices, drive
from drivers.objects import Access, DataType, PdoKind
from drivers.tables.drive import DriveLimits

TABLE = devices()
NEEDED = (
    "1000 1001 1003 1005 1006 1008 1009 100A 1014 1016 1017 1018 1019 1029 1200 1400 1600 1800 1A00 6007 603F 6040 6041"
    " 605A 605B 605C 605D 605E 6060 6061 6064 6065 6066 606C 6071 6072 6076 6077 607A 607D 6085 6098 6099 60B0 60B1"
    " 60B2 60C2 60F4 60FF 6502"
)


def test_who_is_on_the_bus():
    assert set(TABLE) == {1, 2, 11, 12, *range(21, 29), 31, 32, 33}
    assert len({device.name for device in TABLE.values()}) == len(TABLE)


@pytest.mark.parametrize("node_id", DRIVE_IDS)
def test_a_drive_has_the_objects_of_a_good_drive(node_id):
    present = {entry.index for entry in TABLE[node_id].objects}
    assert {int(index, 16) for index in NEEDED.split()} <= present


@pytest.mark.parametrize("device", TABLE.values(), ids=lambda device: device.name)
def test_no_object_is_there_twice_and_defaults_fit_their_types(device):
    keys = [entry.key for entry in device.objects]
    assert keys == sorted(set(keys))
    for entry in device.objects:
        if entry.data_type.is_integer:
            low = -(1 << entry.data_type.bits - 1) if entry.data_type.signed else 0
            assert isinstance(entry.default, int)
            assert low <= entry.default < low + (1 << entry.data_type.bits), entry
            assert entry.low is None or entry.low <= entry.default, entry
            assert entry.high is None or entry.default <= entry.high, entry
        elif entry.data_type is DataType.VISIBLE_STRING:
            assert isinstance(entry.default, str)
            assert entry.default.isascii()
        else:
            assert isinstance(entry.default, float)


@pytest.mark.parametrize("device", TABLE.values(), ids=lambda device: device.name)
def test_sub_index_0_counts_the_entries(device):
    for entry in device.objects:
        siblings = [other.subindex for other in device.objects if other.index == entry.index]
        if entry.subindex == 0 and len(siblings) > 1 and entry.index != 0x1003:
            assert entry.default <= max(siblings)
            if not (
                0x1600 <= entry.index < 0x1800 or 0x1A00 <= entry.index < 0x1C00
            ):  # the slots of a mapping that are not used come after its count
                assert entry.default == max(siblings)


@pytest.mark.parametrize("device", TABLE.values(), ids=lambda device: device.name)
def test_pdos_map_existing_mappable_objects_in_at_most_eight_bytes(device):
    for pdo in device.pdos:
        entries = [device.object(*key) for key in pdo.mapping]
        assert sum(entry.data_type.bits for entry in entries) <= 64
        for entry in entries:
            assert entry.mappable, entry
            readable = pdo.kind is PdoKind.TPDO or entry.access in (Access.RW, Access.WO)
            assert readable, f"{entry.name} cannot be received: it is {entry.access.value}"


def test_no_identifier_has_two_senders():
    sent = [pdo.cob_id for device in TABLE.values() for pdo in device.pdos if pdo.enabled]
    for node_id in TABLE:
        sent += [0x080 + node_id, 0x580 + node_id, 0x600 + node_id, 0x700 + node_id]
    sent += [0x000, 0x080]
    assert len(sent) == len(set(sent))


@pytest.mark.parametrize("device", TABLE.values(), ids=lambda device: device.name)
def test_identifiers_follow_the_predefined_connection_set(device):
    bases = {PdoKind.TPDO: 0x180, PdoKind.RPDO: 0x200}
    for pdo in device.pdos:
        if pdo.number <= 4:
            assert pdo.cob_id == bases[pdo.kind] + 0x100 * (pdo.number - 1) + device.node_id
        else:  # the set has four; the identifier of a node that does not exist
            assert pdo.cob_id & 0x7F not in TABLE
            assert 0x180 <= pdo.cob_id < 0x580
        index = {PdoKind.TPDO: 0x1800, PdoKind.RPDO: 0x1400}[pdo.kind] + pdo.number - 1
        word = device.object(index, 1).default
        assert word & 0x7FF == pdo.cob_id
        assert bool(word & 1 << 31) is not pdo.enabled
    assert device.object(0x1014).default == 0x80 + device.node_id
    assert device.object(0x1200, 1).default == 0x600 + device.node_id
    assert device.object(0x1200, 2).default == 0x580 + device.node_id


@pytest.mark.parametrize("node_id", DRIVE_IDS)
def test_process_data_of_the_drives(node_id):
    device = TABLE[node_id]
    target = 0x60FF if node_id in WHEEL_IDS else 0x607A
    enabled = {(pdo.kind, pdo.number): pdo for pdo in device.pdos if pdo.enabled}
    assert set(enabled) == {(PdoKind.RPDO, 1), (PdoKind.TPDO, 1), (PdoKind.TPDO, 2)}
    # index 16 bit, sub-index 8 bit, length 8 bit: what a master reads back from 1600h and 1A00h
    words = {index: [device.object(index, sub).default for sub in (1, 2, 3)] for index in (0x1600, 0x1A00)}
    assert words[0x1600] == [0x60400010, target << 16 | 0x20, 0x60B20010]
    assert words[0x1A00] == [0x60410010, 0x60640020, 0x60770010]
    assert [device.object(0x1A01, sub).default for sub in (0, 1, 2)] == [2, 0x606C0020, 0x60610008]
    assert device.object(0x1400, 2).default == device.object(0x1800, 2).default == 1
    assert device.object(0x1801, 2).default == 10


def test_units_and_limits_of_the_robot_reach_the_dictionary():
    limits = DriveLimits(-1.0, 2.0, 0.5, 3.0, 4.0, 0.01, 0.02, 1.5)
    lift = drive(22, "lift", 400_000, limits, linear=True)
    wire = {0x6065: 10_000, 0x6066: 20, 0x6072: 1500, 0x6076: 400_000, 0x607F: 500_000, 0x6085: 4_000_000}
    assert {index: lift.object(index).default for index in wire} == wire
    assert (lift.object(0x607D, 1).default, lift.object(0x607D, 2).default) == (-1_000_000, 2_000_000)
    assert lift.object(0x60A8).default == 0xFA010000
    assert lift.object(0x60A9).default == 0xFA010300
    assert TABLE[21].object(0x60A8).default == 0xFA100000
    assert TABLE[21].object(0x60A9).default == 0xFA100300


def test_everybody_beats_and_the_drives_listen_to_the_planner():
    for device in TABLE.values():
        assert device.object(0x1017).default == 100
    for node_id in DRIVE_IDS:
        assert TABLE[node_id].object(0x1016, 1).default == 2 << 16 | 350
    count = TABLE[2].object(0x1016).default
    watched = {TABLE[2].object(0x1016, sub).default >> 16 for sub in range(1, count + 1)}
    assert watched == set(TABLE) - {2}


def test_only_the_planner_produces_sync():
    assert [node_id for node_id in TABLE if TABLE[node_id].object(0x1005).default & 1 << 30] == [2]


def test_devices_wants_all_ten_drives():
    some = {node_id: DEFAULT_DRIVES[node_id] for node_id in JOINT_IDS}
    with pytest.raises(ValueError, match="must be the node ids"):
        devices(some)
    named = devices({**DEFAULT_DRIVES, 21: DriveParameters("first", 77_000)})
    assert (named[21].name, named[21].object(0x6076).default) == ("first", 77_000)


def test_a_missing_object_is_named():
    with pytest.raises(KeyError, match="9999h sub 1"):
        TABLE[21].object(0x9999, 1)
