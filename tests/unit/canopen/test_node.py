"""Nodes of the catalogue on a bus: all boot, their PDOs compile, the planner gives the SYNC; power and refused frames."""

from __future__ import annotations

import pytest

from drivers.bus.lockstep import LockstepBus
from drivers.canopen.nmt import NmtState
from drivers.canopen.node import CanopenNode
from drivers.catalogue import PLANNER_ID, devices
from drivers.clock import LockstepClock
from drivers.frame import Frame
from drivers.objects import PdoKind
from tests.unit.canopen.bench import MS, Bench


@pytest.fixture
def all_nodes() -> tuple[LockstepClock, LockstepBus, dict[int, CanopenNode], list[Frame]]:
    clock = LockstepClock()
    bus = LockstepBus(clock)
    frames: list[Frame] = []
    bus.observe(frames.append)
    return clock, bus, {node_id: CanopenNode(device, clock, bus) for node_id, device in devices().items()}, frames


def test_every_device_of_the_catalogue_boots(
    all_nodes: tuple[LockstepClock, LockstepBus, dict[int, CanopenNode], list[Frame]],
) -> None:
    clock, _, nodes, frames = all_nodes
    for node in nodes.values():
        node.power_on()
    clock.run_until(5 * MS)
    assert {frame.can_id - 0x700 for frame in frames if frame.data == b"\x00"} == set(nodes)
    assert {node.nmt.state for node in nodes.values()} == {NmtState.PRE_OPERATIONAL}


def test_planner_gives_the_sync_and_everybody_answers(
    all_nodes: tuple[LockstepClock, LockstepBus, dict[int, CanopenNode], list[Frame]],
) -> None:
    clock, _, nodes, frames = all_nodes
    for node in nodes.values():
        node.power_on()
    clock.run_until(MS)
    for node in nodes.values():
        node.start()
    clock.run_until(105 * MS)
    counts = {can_id: sum(frame.can_id == can_id for frame in frames) for can_id in {frame.can_id for frame in frames}}
    assert counts[0x080] == 10
    for node_id, node in nodes.items():
        for pdo in node.device.pdos:
            if pdo.kind is PdoKind.TPDO and pdo.enabled and 1 <= pdo.transmission_type <= 240:
                assert counts[pdo.cob_id] == 10 // pdo.transmission_type, f"{pdo.cob_id:03X} of {node_id}"
    assert counts.get(0x080 + PLANNER_ID) is None


def test_power_off_in_the_middle_leaves_no_timer_that_speaks() -> None:
    bench = Bench()
    bench.write(0x1017, 0, b"\x14\x00")
    bench.write(0x1801, 5, b"\x0a\x00")
    bench.operational()
    bench.run(50 * MS)
    assert bench.heard
    bench.node.power_off()
    bench.run(MS)
    bench.heard.clear()
    for can_id, data in ((0x605, bytes.fromhex("4005200000000000")), (0x000, b"\x01\x05"), (0x080, b"")):
        bench.port.send(can_id, data)
    bench.run(200 * MS)
    assert not bench.heard
    bench.node.power_on()
    bench.run(MS)
    assert bench.sent(0x705) == [b"\x00"]
    assert bench.node.dictionary.get(0x1017) == 0


def test_frames_that_the_bus_refuses_are_counted() -> None:
    bench = Bench()
    bench.operational()
    bench.tell(0x080, "")
    sent = bench.node.tpdo[1].sent
    bench.bus.disconnect("bench")
    bench.node.tpdo[2].trigger()
    assert bench.node.line.refused == 1
    assert bench.node.tpdo[2].sent == 0
    bench.bus.reconnect("bench")
    bench.tell(0x080, "")
    assert bench.node.tpdo[1].sent == sent + 1


def test_master_node_starts_itself() -> None:
    bench = Bench()
    bench.node.start()
    assert bench.node.nmt.state is NmtState.OPERATIONAL
