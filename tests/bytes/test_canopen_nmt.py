"""Boot-up, NMT commands, heartbeat, EMCY and SYNC as they are on the wire (CiA 301 formats, written out by hand)."""

from __future__ import annotations

import itertools
import struct
from dataclasses import replace

import pytest

from drivers.canopen.emcy import EmcyCode
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CommunicationLoss
from drivers.objects import Access, DataType, ObjectDef
from tests.unit.canopen.bench import DEVICE, MS, Bench

S = NmtState


def test_nothing_before_power_then_boot_up_then_pre_operational() -> None:
    bench = Bench(power=False)
    bench.run(100 * MS)
    assert bench.tell(0x605, "4005200000000000") == []
    bench.node.power_on()
    bench.run(MS)
    assert [(frame.can_id, frame.data) for frame in bench.heard] == [(0x705, b"\x00")]
    assert bench.node.nmt.state is S.PRE_OPERATIONAL


@pytest.mark.parametrize(
    ("frames", "state"),
    [
        (["0105"], S.OPERATIONAL),
        (["0100"], S.OPERATIONAL),  # node 0: everybody
        (["0205"], S.STOPPED),
        (["0105", "8005"], S.PRE_OPERATIONAL),
        (["0205", "0105"], S.OPERATIONAL),
        (["0106"], S.PRE_OPERATIONAL),  # somebody else
        (["01"], S.PRE_OPERATIONAL),  # malformed
        (["010500"], S.PRE_OPERATIONAL),
        (["0305"], S.PRE_OPERATIONAL),  # no such command
    ],
)
def test_nmt_commands(frames: list[str], state: NmtState) -> None:
    bench = Bench()
    for frame in frames:
        assert bench.tell(0x000, frame) == []
    assert bench.node.nmt.state is state


@pytest.mark.parametrize(("command", "level", "identifier"), [("8105", 0, 0x80), ("8205", 7, 0x80)])
def test_resets_boot_again_and_restore_what_they_should(command: str, level: int, identifier: int) -> None:
    bench = Bench()
    bench.write(0x2000, 0, b"\x07\x00")
    bench.write(0x1017, 0, b"\x0a\x00")
    bench.operational()
    bench.application.events.clear()
    assert bench.tell(0x000, command)[-1:] == ["705#00"]
    assert bench.node.dictionary.get(0x2000) == level
    assert bench.node.dictionary.get(0x1017) == 0
    assert bench.application.events == [S.INITIALISING, ("reset", command == "8105"), S.PRE_OPERATIONAL]
    bench.heard.clear()
    bench.run(50 * MS)
    assert not bench.heard  # the heartbeat was switched on by SDO only


def test_boot_up_waits_for_a_bus_that_takes_it() -> None:
    bench = Bench(power=False)
    bench.bus.disconnect("bench")
    bench.node.power_on()
    bench.run(35 * MS)
    assert bench.node.nmt.state is S.INITIALISING
    bench.bus.reconnect("bench")
    bench.run(15 * MS)
    assert bench.sent(0x705) == [b"\x00"]
    assert bench.node.nmt.state is S.PRE_OPERATIONAL


def test_heartbeat_tells_the_state_in_its_period() -> None:
    bench = Bench()
    assert bench.write(0x1017, 0, struct.pack("<H", 20)) == 0
    bench.heard.clear()
    bench.run(60 * MS)
    bench.port.send(0x000, b"\x01\x05")
    bench.run(40 * MS)
    bench.port.send(0x000, b"\x02\x05")
    bench.run(40 * MS)
    assert bench.sent(0x705) == [b"\x7f"] * 3 + [b"\x05"] * 2 + [b"\x04"] * 2
    times = [frame.t_ns for frame in bench.heard if frame.can_id == 0x705]
    assert [after - before for before, after in itertools.pairwise(times)] == pytest.approx([20 * MS] * 6, abs=60_000)


def test_watched_node_that_falls_silent_is_8130() -> None:
    bench = Bench()
    assert bench.write(0x1016, 1, bytes.fromhex("32000200")) == 0  # node 2, 50 ms
    bench.operational()
    bench.run(200 * MS)
    assert bench.application.events[-1] is S.OPERATIONAL  # never heard: not watched yet
    for _ in range(4):
        assert bench.tell(0x702, "05") == []
        bench.run(39 * MS)
    assert bench.node.nmt.state is S.OPERATIONAL
    bench.heard.clear()
    bench.run(20 * MS)
    assert bench.sent(0x085) == [bytes.fromhex("3081110200000000")]
    assert bench.application.events[-2:] == [CommunicationLoss.HEARTBEAT, S.PRE_OPERATIONAL]
    assert bench.read(0x1001) == 0x11
    assert bench.tell(0x702, "05") == ["085#0000000000000000"]
    assert bench.read(0x1001) == 0
    assert ("remote", 2, 5) in bench.application.events


@pytest.mark.parametrize(("behaviour", "state"), [(0, S.PRE_OPERATIONAL), (1, S.OPERATIONAL), (2, S.STOPPED)])
def test_error_behaviour_1029(behaviour: int, state: NmtState) -> None:
    bench = Bench()
    bench.write(0x1029, 1, bytes((behaviour,)))
    bench.write(0x1016, 1, bytes.fromhex("32000200"))
    bench.operational()
    bench.tell(0x702, "05")
    bench.run(60 * MS)
    assert bench.node.nmt.state is state
    assert len(bench.sent(0x085)) == 1


def test_one_node_is_watched_once() -> None:
    bench = Bench()
    assert bench.write(0x1016, 1, bytes.fromhex("32000200")) == 0
    assert bench.write(0x1016, 2, bytes.fromhex("64000200")) == 0x0604_0043
    assert bench.write(0x1016, 2, bytes.fromhex("64000300")) == 0


def test_own_heartbeat_from_somebody_else_locks_out_of_operational_until_reset() -> None:
    bench = Bench()
    bench.operational()
    assert bench.tell(0x705, "05") == ["085#5081110500000000"]
    assert bench.node.nmt.state is S.PRE_OPERATIONAL
    assert CommunicationLoss.DUPLICATE in bench.application.events
    bench.tell(0x000, "0105")
    assert bench.node.nmt.state is S.PRE_OPERATIONAL
    bench.tell(0x000, "8105")
    bench.tell(0x000, "0105")
    assert bench.node.nmt.state is S.OPERATIONAL


def test_two_real_nodes_with_one_id_find_each_other() -> None:
    bench = Bench()
    bench.operational()
    twin = type(bench.node)(replace(DEVICE, name="twin"), bench.clock, bench.bus)
    bench.write(0x1017, 0, struct.pack("<H", 20))
    twin.power_on()
    bench.run(50 * MS)
    bench.tell(0x000, "0100")
    assert (bench.node.nmt.state, twin.nmt.state) == (S.PRE_OPERATIONAL, S.PRE_OPERATIONAL)


def test_emergency_history_newest_first_and_cleared_by_zero_only() -> None:
    bench = Bench()
    bench.heard.clear()
    bench.node.emcy.report(EmcyCode.FOLLOWING_ERROR, b"\x01\x02\x03\x04\x05")
    bench.node.emcy.report(EmcyCode.HEARTBEAT, b"\x02")
    bench.node.emcy.report(EmcyCode.HEARTBEAT, b"\x02")  # told once as long as it lasts
    bench.run(MS)
    # error code, register (generic | profile, then | communication), five bytes of the manufacturer
    assert bench.sent(0x085) == [bytes.fromhex("1186210102030405"), bytes.fromhex("3081310200000000")]
    assert [bench.read(0x1003, sub) for sub in range(3)] == [2, 0x0002_8130, 0x0201_8611]
    assert bench.read(0x1003, 3) == -0x0800_0024  # no data
    assert bench.write(0x1003, 0, b"\x01") == 0x0609_0030
    assert bench.write(0x1003, 0, b"\x00") == 0
    assert bench.read(0x1003, 0) == 0
    assert bench.read(0x1001) == 0x31  # the errors themselves last
    bench.heard.clear()
    bench.node.emcy.resolve(EmcyCode.FOLLOWING_ERROR, EmcyCode.SENSOR)
    bench.node.emcy.resolve(EmcyCode.HEARTBEAT)
    bench.run(MS)
    assert bench.sent(0x085) == [bytes.fromhex("0000110000000000"), bytes(8)]


def test_history_keeps_the_newest() -> None:
    bench = Bench()
    codes = list(EmcyCode)[1:11]
    for code in codes:
        bench.node.emcy.report(code)
    bench.run(5 * MS)
    assert bench.read(0x1003, 0) == 8
    assert bench.read(0x1003, 8) == codes[2]


def test_emergency_inhibit_time_and_stopped_delay_messages() -> None:
    bench = Bench()
    bench.write(0x1015, 0, struct.pack("<H", 100))  # 10 ms
    bench.heard.clear()
    bench.node.emcy.report(EmcyCode.FOLLOWING_ERROR)
    bench.node.emcy.report(EmcyCode.HEARTBEAT)
    bench.run(5 * MS)
    assert len(bench.sent(0x085)) == 1
    bench.run(6 * MS)
    assert len(bench.sent(0x085)) == 2
    bench.run(20 * MS)
    bench.tell(0x000, "0205")
    bench.node.emcy.resolve(EmcyCode.HEARTBEAT)
    bench.run(20 * MS)
    assert bench.sent(0x085) == []
    assert bench.tell(0x000, "0105") == ["085#0000210000000000"]


def test_emergency_is_offered_again_when_the_bus_refuses_it() -> None:
    bench = Bench()
    bench.bus.disconnect("bench")
    bench.node.emcy.report(EmcyCode.SENSOR)
    bench.run(5 * MS)
    bench.bus.reconnect("bench")
    bench.run(3 * MS)
    assert bench.sent(0x085) == [bytes.fromhex("0073210000000000")]


def test_sync_of_the_wrong_length_is_8240_and_not_taken() -> None:
    bench = Bench()
    bench.operational()
    bench.application.events.clear()
    assert bench.tell(0x080, "01") == ["085#4082110100000000"]
    assert bench.application.events == []
    assert bench.tell(0x080, "")[0] == "085#0000000000000000"
    assert bench.application.events == [("sync", None)]


def test_sync_counter() -> None:
    bench = Bench()
    assert bench.write(0x1019, 0, b"\x0a") == 0
    assert bench.write(0x1019, 0, b"\xf1") == 0x0609_0031
    assert bench.write(0x1019, 0, b"\x01") == 0x0609_0030
    bench.application.events.clear()
    for counter in (9, 10, 1, 4):
        bench.tell(0x080, bytes((counter,)))
    assert bench.application.events == [("sync", 9), ("sync", 10), ("sync", 1), ("sync", 4)]
    assert bench.node.sync_consumer.missed == 2
    assert bench.tell(0x080, "") == ["085#4082110000000000"]


def test_no_sync_while_stopped() -> None:
    bench = Bench()
    bench.tell(0x000, "0205")
    bench.application.events.clear()
    bench.tell(0x080, "")
    assert bench.application.events == []


def test_sync_producer_sends_on_the_grid_and_takes_part_itself() -> None:
    bench = Bench()
    bench.write(0x1006, 0, struct.pack("<I", 10_000))
    assert bench.write(0x1005, 0, struct.pack("<I", 0x4000_0080)) == 0
    bench.heard.clear()
    bench.application.events.clear()
    bench.run(50 * MS)
    times = [frame.t_ns // 1000 * 1000 for frame in bench.heard if frame.can_id == 0x080]
    assert [t_ns % (10 * MS) for t_ns in times] == [48_000] * 5
    assert bench.application.events == [("sync", None)] * 5
    assert bench.write(0x1005, 0, struct.pack("<I", 0x4000_0081)) == 0x0609_0030
    bench.tell(0x000, "0205")
    bench.run(50 * MS)
    assert bench.sent(0x080) == []
    bench.tell(0x000, "8005")
    assert bench.write(0x1005, 0, struct.pack("<I", 0x80)) == 0
    bench.heard.clear()
    bench.run(50 * MS)
    assert bench.sent(0x080) == []


def test_sync_producer_counts() -> None:
    extra = (ObjectDef(0x1005, 0, "COB-ID SYNC", DataType.UNSIGNED32, Access.RW, 0x4000_0080),)
    period = (ObjectDef(0x1006, 0, "Cycle period", DataType.UNSIGNED32, default=5_000),)
    overflow = (ObjectDef(0x1019, 0, "Overflow", DataType.UNSIGNED8, Access.RO, 3),)
    others = tuple(entry for entry in DEVICE.objects if entry.index != 0x1006)
    bench = Bench(replace(DEVICE, objects=others + extra + period + overflow))
    bench.run(30 * MS)
    assert bench.sent(0x080) == [b"\x01", b"\x02", b"\x03", b"\x01", b"\x02", b"\x03"]
