"""PDOs on the wire: bytes worked out by hand, wrong lengths, unmapped objects, remapping by SDO, transmission types."""

from __future__ import annotations

import struct

import pytest

from drivers.canopen.node import CommunicationLoss
from tests.unit.canopen.bench import MS, NODE, Bench

RPDO1, RPDO2, TPDO1, TPDO2, TPDO3 = 0x200 + NODE, 0x300 + NODE, 0x180 + NODE, 0x280 + NODE, 0x380 + NODE
OFF = 1 << 31


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.operational()
    bench.application.events.clear()
    return bench


def u32(value: int) -> bytes:
    return struct.pack("<I", value)


def remap(bench: Bench, communication: int, cob_id: int, *words: int) -> None:
    """The procedure of CiA 301: off, count 0, entries, count, on."""
    assert bench.write(communication, 1, u32(cob_id | OFF)) == 0
    assert bench.write(communication + 0x200, 0, b"\x00") == 0
    for slot, word in enumerate(words, 1):
        assert bench.write(communication + 0x200, slot, u32(word)) == 0
    assert bench.write(communication + 0x200, 0, bytes((len(words),))) == 0
    assert bench.write(communication, 1, u32(cob_id)) == 0


def test_synchronous_rpdo_waits_for_the_sync(bench: Bench) -> None:
    bench.tell(RPDO1, "FEFF0A")
    assert bench.node.dictionary.get(0x2000) == 0
    assert bench.tell(0x080, "") == ["185#FEFF07000000"]
    assert bench.node.dictionary.get(0x2005) == 10
    assert bench.application.events == [("rpdo", 1), ("sync", None)]


def test_of_two_frames_before_a_sync_the_later_counts(bench: Bench) -> None:
    bench.tell(RPDO1, "010001")
    bench.tell(RPDO1, "020002")
    bench.tell(0x080, "")
    assert bench.node.dictionary.get(0x2000) == 2
    assert bench.application.events.count(("rpdo", 1)) == 1


def test_all_rpdos_of_a_sync_are_stored_before_any_is_told(bench: Bench) -> None:
    remap(bench, 0x1401, RPDO2, 0x2001_0020)
    bench.write(0x1401, 2, b"\x01")
    seen: list[object] = []
    bench.node.dictionary.bind(0x2000, sink=lambda _: seen.append(bench.node.dictionary.get(0x2001)))
    bench.tell(RPDO1, "010001")
    bench.tell(RPDO2, struct.pack("<f", 2.5))
    bench.tell(0x080, "")
    assert seen == [2.5]


def test_event_driven_rpdo_acts_at_once(bench: Bench) -> None:
    bench.tell(RPDO2, "00002040")
    assert bench.node.dictionary.get(0x2001) == 2.5
    assert bench.application.events == [("rpdo", 2)]


@pytest.mark.parametrize("data", ["", "0100", "01000A00", "01000A0000000000"])
def test_rpdo_of_another_length_is_ignored_and_8210(bench: Bench, data: str) -> None:
    length = len(data) // 2
    # EMCY: 8210h, communication error, then PDO number, length received, length expected
    assert bench.tell(RPDO1, data) == [f"085#108211{1:02X}{length:02X}{3:02X}0000"]
    assert bench.tell(RPDO1, data) == []  # told once
    bench.tell(0x080, "")
    assert bench.node.dictionary.get(0x2000) == 0
    assert bench.tell(RPDO1, "05000A") == ["085#0000000000000000"]


def test_rpdo_with_a_value_out_of_range_is_ignored_as_a_whole(bench: Bench) -> None:
    bench.tell(RPDO1, "070065")  # 101 %
    assert "085#0082113100090601" in bench.tell(0x080, "")
    assert bench.node.dictionary.get(0x2000) == 0
    assert bench.node.dictionary.get(0x2005) == 50
    assert ("rpdo", 1) not in bench.application.events


@pytest.mark.parametrize("bits", ["0000C07F", "0000807F", "000080FF", "FFFFFFFF"])
def test_no_rpdo_brings_in_what_is_not_a_number(bench: Bench, bits: str) -> None:
    bench.tell(RPDO2, bits)
    assert bench.node.dictionary.get(0x2001) == 1.5


@pytest.mark.parametrize("command", ["0205", "8005"])
def test_pdos_are_dead_outside_operational(bench: Bench, command: str) -> None:
    bench.tell(RPDO1, "01000A")  # waits for its SYNC, in vain
    bench.tell(0x000, command)
    bench.tell(RPDO1, "02000A")
    bench.tell(RPDO2, "00002040")
    bench.node.tpdo[2].trigger()
    assert bench.tell(0x080, "") == []
    bench.tell(0x000, "0105")
    assert bench.tell(0x080, "") == ["185#000007000000"]
    assert bench.node.dictionary.get(0x2001) == 1.5


def test_every_nth_sync(bench: Bench) -> None:
    assert bench.write(0x1800, 2, b"\x03") == 0
    assert [len(bench.tell(0x080, "")) for _ in range(7)] == [0, 0, 1, 0, 0, 1, 0]


def test_sync_start_value_begins_the_count(bench: Bench) -> None:
    bench.tell(0x000, "8005")
    bench.write(0x1019, 0, b"\x0a")
    assert bench.write(0x1800, 1, u32(0x185 | OFF)) == 0
    assert bench.write(0x1800, 6, b"\x04") == 0
    assert bench.write(0x1800, 2, b"\x02") == 0
    assert bench.write(0x1800, 1, u32(0x185)) == 0
    bench.tell(0x000, "0105")
    assert [len(bench.tell(0x080, bytes((count,)))) for count in range(1, 9)] == [0, 0, 0, 1, 0, 1, 0, 1]


def test_acyclic_synchronous_tpdo_needs_an_event_and_a_sync(bench: Bench) -> None:
    assert not any(line.startswith("385") for line in bench.tell(0x080, ""))
    bench.node.tpdo[3].trigger()
    bench.run(MS)
    assert bench.sent(TPDO3) == []
    assert "385#0000" in bench.tell(0x080, "")
    assert not any(line.startswith("385") for line in bench.tell(0x080, ""))


def test_bits_of_odd_lengths_follow_each_other(bench: Bench) -> None:
    bench.node.dictionary.set(0x2003, 0, -2)
    bench.node.dictionary.set(0x2004, 0, 1)
    bench.node.dictionary.set(0x2005, 0, 100)
    bench.heard.clear()
    bench.node.tpdo[2].trigger()
    bench.run(MS)
    # 24 bits FFFFFEh, 1 bit, 8 bits 64h: 0x64 << 25 | 1 << 24 | FFFFFEh
    assert bench.sent(TPDO2) == [bytes.fromhex("FEFFFFC900")]


def test_inhibit_time_and_event_timer(bench: Bench) -> None:
    assert bench.write(0x1801, 3, struct.pack("<H", 100)) == 0x0609_0030  # valid: not while in use
    assert bench.write(0x1801, 1, u32(TPDO2 | OFF)) == 0
    assert bench.write(0x1801, 3, struct.pack("<H", 100)) == 0  # 10 ms
    assert bench.write(0x1801, 5, struct.pack("<H", 30)) == 0
    assert bench.write(0x1801, 1, u32(TPDO2)) == 0
    begin = bench.clock.now_ns()
    bench.heard.clear()
    bench.node.tpdo[2].trigger()
    bench.run(2 * MS)
    bench.node.tpdo[2].trigger()
    bench.node.tpdo[2].trigger()
    bench.run(100 * MS)
    times = [round((frame.t_ns - begin) / MS) for frame in bench.heard if frame.can_id == TPDO2]
    assert times == [0, 10, 40, 70, 100]


def test_remapping_by_sdo_changes_what_is_sent_and_taken(bench: Bench) -> None:
    remap(bench, 0x1800, TPDO1, 0x200B_0008, 0x200A_0220, 0x2003_0018)
    remap(bench, 0x1400, RPDO1, 0x200B_0008, 0x0005_0008, 0x2000_0010)  # with a gap of eight bits
    bench.tell(RPDO1, "80FF3412")
    assert bench.tell(0x080, "") == ["185#80FEFFFFFF000000"]
    assert bench.node.dictionary.get(0x2000) == 0x1234


def test_other_identifier_takes_effect(bench: Bench) -> None:
    assert bench.write(0x1400, 1, u32(0x234)) == 0x0609_0030
    assert bench.write(0x1400, 1, u32(0x234 | OFF)) == 0
    assert bench.write(0x1400, 1, u32(0x234)) == 0
    bench.tell(RPDO1, "010001")
    bench.tell(0x234, "020002")
    bench.tell(0x080, "")
    assert bench.node.dictionary.get(0x2000) == 2


def test_switched_off_pdo_neither_sends_nor_hears(bench: Bench) -> None:
    bench.write(0x1800, 1, u32(TPDO1 | OFF))
    bench.write(0x1400, 1, u32(RPDO1 | OFF))
    bench.tell(RPDO1, "01000A")
    assert bench.tell(0x080, "") == []
    assert bench.node.dictionary.get(0x2000) == 0
    assert bench.tell(0x400 + NODE, "0102030405060708") == []


@pytest.mark.parametrize("can_id", [0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x605, 0x6E0, 0x705, 0x7FF, 0x2000_0205])
def test_identifiers_that_are_not_for_pdos_are_refused(bench: Bench, can_id: int) -> None:
    assert bench.write(0x1402, 1, u32(can_id)) == 0x0609_0030


@pytest.mark.parametrize(
    ("kind", "code"), [(240, 0), (241, 0x0609_0030), (252, 0x0609_0030), (253, 0x0609_0030), (254, 0)]
)
def test_transmission_types(bench: Bench, kind: int, code: int) -> None:
    assert bench.write(0x1800, 2, bytes((kind,))) == code


def test_mapping_is_locked_while_the_pdo_is_valid_or_counted(bench: Bench) -> None:
    assert bench.write(0x1A00, 0, b"\x00") == 0x0601_0000
    assert bench.write(0x1A00, 1, u32(0x2000_0010)) == 0x0601_0000
    bench.write(0x1800, 1, u32(TPDO1 | OFF))
    assert bench.write(0x1A00, 1, u32(0x2000_0010)) == 0x0601_0000
    assert bench.write(0x1A00, 0, b"\x00") == 0
    assert bench.write(0x1A00, 1, u32(0x2000_0010)) == 0


@pytest.mark.parametrize(
    ("communication", "word", "code"),
    [
        (0x1800, 0x3000_0010, 0x0602_0000),  # no such object
        (0x1800, 0x200A_0920, 0x0609_0011),  # no such subindex
        (0x1800, 0x2009_0008, 0x0604_0041),  # not mappable
        (0x1800, 0x2000_0008, 0x0604_0041),  # another length
        (0x1800, 0x2000_0000, 0x0604_0041),
        (0x1800, 0x0005_0008, 0x0602_0000),  # gaps are for RPDOs
        (0x1400, 0x2006_0020, 0x0604_0041),  # read-only in an RPDO
        (0x1400, 0x0005_0010, 0x0604_0041),  # a gap of another length
    ],
)
def test_objects_that_cannot_be_mapped(bench: Bench, communication: int, word: int, code: int) -> None:
    bench.write(communication, 1, u32((0x185 if communication >= 0x1800 else 0x205) | OFF))
    bench.write(communication + 0x200, 0, b"\x00")
    assert bench.write(communication + 0x200, 1, u32(word)) == code


def test_more_than_eight_bytes_cannot_be_mapped(bench: Bench) -> None:
    bench.write(0x1800, 1, u32(TPDO1 | OFF))
    bench.write(0x1A00, 0, b"\x00")
    for slot, word in enumerate((0x200A_0120, 0x200A_0220, 0x200B_0008), 1):
        assert bench.write(0x1A00, slot, u32(word)) == 0
    assert bench.write(0x1A00, 0, b"\x03") == 0x0604_0042
    assert bench.write(0x1A00, 0, b"\x09") == 0x0604_0042
    assert bench.write(0x1A00, 0, b"\x02") == 0


def test_event_timer_of_an_rpdo_is_a_deadline(bench: Bench) -> None:
    assert bench.write(0x1401, 5, struct.pack("<H", 20)) == 0
    bench.run(100 * MS)
    assert bench.application.events == []  # watched from the first frame on
    for _ in range(3):
        bench.tell(RPDO2, "00002040")
        bench.run(14 * MS)
    bench.heard.clear()
    bench.run(10 * MS)
    assert bench.sent(0x085) == [bytes.fromhex("5082110200000000")]
    assert bench.application.events[-1] is CommunicationLoss.RPDO
    assert bench.tell(RPDO2, "00002040") == ["085#0000000000000000"]


def test_seal_has_the_last_word_on_the_bytes(bench: Bench) -> None:
    bench.node.tpdo[1].seal = lambda data: data[:5] + b"\xaa"
    assert bench.tell(0x080, "") == ["185#0000070000AA"]


def test_live_values_come_from_their_source(bench: Bench) -> None:
    bench.node.dictionary.bind(0x2006, source=lambda: 0x01020304)
    assert bench.tell(0x080, "") == ["185#000004030201"]
    assert bench.read(0x2006) == 0x01020304


def test_own_identifier_on_a_foreign_device_can_be_listened_to(bench: Bench) -> None:
    heard: list[bytes] = []
    bench.node.subscribe(0x19F, lambda frame: heard.append(frame.data))
    bench.tell(0x19F, "0102")
    assert heard == [b"\x01\x02"]
