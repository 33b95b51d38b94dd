"""From power-on to enabled with ten real drives: waiting, identity, configuration, enabling."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.bus.interception import Verdict
from drivers.catalogue import DRIVE_IDS, devices
from drivers.cia402.bring_up import MasterTimes
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.phases import EventKind, MasterPhase
from drivers.cia402.states import State
from drivers.frame import Frame
from drivers.objects import DeviceDef, PdoDef, PdoKind, Value

MS = 1_000_000
MakeCell = Callable[..., Any]


def with_defaults(device: DeviceDef, values: dict[tuple[int, int], Value]) -> DeviceDef:
    """The device with other power-on values."""
    objects = tuple(
        replace(entry, default=values[entry.key], low=None, high=None) if entry.key in values else entry
        for entry in device.objects
    )
    return replace(device, objects=objects)


def downloads(cell: Any, node: int) -> list[tuple[int, int, int]]:
    """(index, subindex, value) of every expedited SDO download to a node, in wire order."""
    return [
        (int.from_bytes(frame.data[1:3], "little"), frame.data[3], int.from_bytes(frame.data[4:8], "little"))
        for frame in cell.wire
        if frame.can_id == 0x600 + node and frame.data[0] & 0xE0 == 0x20
    ]


def test_ten_drives_boot_are_set_up_and_enabled_in_a_quarter_of_a_second(cell: Any) -> None:
    assert cell.master.phase is MasterPhase.OFF
    cell.power_on()
    assert cell.master.phase is MasterPhase.BOOT
    assert cell.master.positions() is None
    assert cell.master.feedback() == (None,) * 10
    ready_s = cell.run_to(MasterPhase.READY)
    assert [event.node_id for event in cell.of_kind(EventKind.CONFIGURED)] == list(DRIVE_IDS)
    cell.master.enable()
    assert cell.master.phase is MasterPhase.ENABLING
    enabled_s = cell.run_to(MasterPhase.ENABLED)
    assert ready_s + enabled_s < 0.25
    assert cell.failures() == []
    assert all(drive.state is State.OPERATION_ENABLED for drive in cell.drives.values())


def test_enabling_under_load_moves_nothing(cell: Any) -> None:
    start = cell.plant.position.copy()
    cell.enabled()
    cell.run(0.5)
    np.testing.assert_allclose(cell.plant.position, start, atol=1e-6)
    np.testing.assert_allclose(cell.master.positions(), start, atol=2e-6)


def test_nothing_is_written_where_nothing_differs(cell: Any) -> None:
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    assert [downloads(cell, node) for node in DRIVE_IDS] == [[]] * 10


def test_one_command_per_drive_and_sync(cell: Any) -> None:
    cell.enabled()
    cell.wire.clear()
    cell.run(0.5)
    syncs = [position for position, frame in enumerate(cell.wire) if frame.can_id == 0x080]
    for begin, end in itertools.pairwise(syncs):
        cycle = [frame.can_id for frame in cell.wire[begin:end]]
        assert [cycle.count(0x200 + node) for node in DRIVE_IDS] == [1] * 10


def test_a_late_drive_is_waited_for_by_name_every_second(make_cell: MakeCell) -> None:
    cell = make_cell()
    cell.power_on(late=[23])
    cell.run(3.5)
    assert cell.master.phase is MasterPhase.BOOT
    waiting = cell.of_kind(EventKind.WAITING)
    assert [(event.node_id, round(event.t_ns / 1e9)) for event in waiting] == [(23, 1), (23, 2), (23, 3)]
    assert "drive 23 (shoulder)" in waiting[0].text
    cell.drives[23].power_on()
    assert cell.run_to(MasterPhase.READY) < 0.1
    assert cell.failures() == []


def test_a_drive_that_never_comes_is_a_failure_and_may_come_after_all(make_cell: MakeCell) -> None:
    cell = make_cell(times=MasterTimes(boot_ns=2_500 * MS))
    cell.power_on(late=[23, 27])
    cell.run(2.49)
    assert cell.failures() == []
    cell.run(0.02)
    assert [(event.node_id, event.kind) for event in cell.failures()] == [
        (23, EventKind.BOOT_TIMEOUT),
        (27, EventKind.BOOT_TIMEOUT),
    ]
    assert "within 2.5 s" in cell.failures()[0].text
    assert cell.master.phase is MasterPhase.FAULT
    cell.drives[23].power_on()
    cell.drives[27].power_on()
    cell.master.reset_faults()
    cell.run_to(MasterPhase.READY)


def test_a_drive_without_heartbeat_that_booted_before_the_master_is_found(make_cell: MakeCell) -> None:
    silent = with_defaults(devices()[25], {(0x1017, 0): 0})
    cell = make_cell(drive_devices={25: silent})
    cell.drives[25].power_on()
    cell.run(1.0)
    cell.power_on(late=[25])
    assert cell.run_to(MasterPhase.READY, 2.0) == pytest.approx(1.03, abs=0.05)
    assert downloads(cell, 25) == [(0x1017, 0, 100)]


def shipped_differently(node: int) -> DeviceDef:
    """A drive as another maker ships it: RPDO1 and TPDO1 map something else, RPDO3 takes the frames of node 21."""
    device = devices()[node]
    pdos = tuple(
        replace(pdo, **changes) if (changes := OTHER_PDOS.get((pdo.kind, pdo.number))) else pdo for pdo in device.pdos
    )
    values: dict[tuple[int, int], Value] = {
        (0x1400, 2): 255,
        (0x1600, 0): 1,
        (0x1600, 2): 0,
        (0x1600, 3): 0,
        (0x1402, 1): 0x215,
        (0x1402, 2): 255,
        (0x1602, 0): 1,
        (0x1602, 1): 0x6040_0010,
        (0x1A00, 0): 2,
        (0x1A00, 3): 0,
        (0x6060, 0): 9,
        (0x60C2, 1): 1,
    }
    return replace(with_defaults(device, values), pdos=pdos)


OTHER_PDOS: dict[tuple[PdoKind, int], dict[str, Any]] = {
    (PdoKind.RPDO, 1): {"mapping": ((0x6040, 0),), "transmission_type": 255},
    (PdoKind.RPDO, 3): {"mapping": ((0x6040, 0),), "enabled": True, "cob_id": 0x215, "transmission_type": 255},
    (PdoKind.TPDO, 1): {"mapping": ((0x6041, 0), (0x6064, 0))},
}


def test_a_drive_that_is_shipped_differently_is_set_up_by_the_full_procedure(make_cell: MakeCell) -> None:
    cell = make_cell(drive_devices={24: shipped_differently(24)})
    cell.enabled()
    written = downloads(cell, 24)
    assert [entry for entry in written if entry[0] in (0x1400, 0x1600)] == [
        (0x1400, 1, 0x8000_0218),
        (0x1600, 0, 0),
        (0x1400, 2, 1),
        (0x1600, 1, 0x6040_0010),
        (0x1600, 2, 0x607A_0020),
        (0x1600, 3, 0x60B2_0010),
        (0x1600, 0, 3),
        (0x1400, 1, 0x0000_0218),
    ]
    assert [entry for entry in written if entry[0] == 0x1402] == [(0x1402, 1, 0x8000_0215)]
    assert (0x6060, 0, 8) in written
    assert (0x60C2, 1, 10) in written
    dictionary = cell.drives[24].node.dictionary
    assert dictionary.get(0x1A00, 0) == 3
    assert dictionary.get(0x6061) == 8


@pytest.mark.parametrize(
    ("node", "key", "value", "text"),
    [
        (22, (0x1000, 0), 0x0002_0191, "profile 401"),
        (22, (0x1018, 2), 99, "product code"),
        (22, (0x6502, 0), 1 << 8, "bit 7 of the supported modes"),
        (11, (0x6502, 0), 1 << 7, "bit 8 of the supported modes"),
        (26, (0x60A8, 0), 0x00B5_0000, "608Fh (encoder increments, motor revolutions), since 60A8h = 00B50000h"),
        (26, (0x60A8, 0), 0x0001_0000, "SI unit 00010000h"),  # metres, of a joint that turns
        (26, (0x6076, 0), 0, "rated torque"),
    ],
)
def test_a_drive_that_is_not_what_it_should_be_is_named(
    make_cell: MakeCell, node: int, key: tuple[int, int], value: int, text: str
) -> None:
    cell = make_cell(drive_devices={node: with_defaults(devices()[node], {key: value})})
    cell.power_on()
    cell.run(0.5)
    (event,) = cell.failures()
    assert (event.node_id, event.kind) == (node, EventKind.CONFIGURATION_FAILED)
    assert text in event.text
    assert cell.master.phase is MasterPhase.FAULT
    assert len(cell.of_kind(EventKind.CONFIGURED)) == 9  # the others do not care


def test_parameters_override_the_definition_and_are_in_the_drive(make_cell: MakeCell) -> None:
    settings = DriveSettings(parameters={22: {(0x607D, 1): 400_000, (0x605A, 0): 6}})
    cell = make_cell(settings=settings)
    cell.enabled()
    dictionary = cell.drives[22].node.dictionary
    assert (dictionary.get(0x607D, 1), dictionary.get(0x605A)) == (400_000, 6)
    assert cell.drives[23].node.dictionary.get(0x605A) == 2


def test_an_sdo_abort_is_told_with_its_code_and_object(make_cell: MakeCell) -> None:
    cell = make_cell(settings=DriveSettings(parameters={22: {(0x605A, 0): 3}}))
    cell.power_on()
    cell.run(0.5)
    (event,) = cell.failures()
    assert (event.node_id, event.code) == (22, 0x0609_0030)
    assert "605Ah sub 0" in event.text


def lost_answers(node: int, count: int) -> Callable[[str, Frame], Verdict | None]:
    left = [count]

    def fault(_: str, frame: Frame) -> Verdict | None:
        if frame.can_id == 0x580 + node and left[0]:
            left[0] -= 1
            return Verdict(drop=True)
        return None

    return fault


def test_a_lost_sdo_answer_costs_a_retry(cell: Any) -> None:
    cell.fault = lost_answers(24, 2)
    cell.power_on()
    assert 0.2 < cell.run_to(MasterPhase.READY) < 0.4
    assert cell.failures() == []


def test_a_drive_that_does_not_answer_sdo_is_a_failure(cell: Any) -> None:
    cell.fault = lost_answers(24, 1000)
    cell.power_on()
    cell.run(2.0)
    (event,) = cell.failures()
    assert (event.node_id, event.kind, event.code) == (24, EventKind.CONFIGURATION_FAILED, 0x0504_0000)
    assert "none, 8 times" in event.text
    cell.fault = None
    cell.master.reset_faults()
    cell.run_to(MasterPhase.READY)


def test_without_sync_the_message_says_so(cell: Any) -> None:
    for drive in cell.drives.values():
        drive.power_on()
    cell.node.power_on()
    cell.node.dictionary.entry(0x1005).value = 0x80  # does not produce it
    cell.node.sync_producer.stop()
    cell.node.start()
    cell.node.sync_producer.stop()
    cell.master.start()
    cell.run(1.5)
    assert cell.syncs == 0
    assert {event.node_id for event in cell.failures()} == set(DRIVE_IDS)
    assert "is SYNC running?" in cell.failures()[0].text


def test_mapping_changed_behind_the_masters_back_is_noticed_when_enabling_and_repaired(cell: Any) -> None:
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    dictionary = cell.drives[25].node.dictionary
    for index, subindex, value in (
        (0x1400, 1, 0x8000_0219),
        (0x1600, 0, 0),
        (0x1600, 3, 0x6071_0010),  # target torque where the torque offset was: the same length
        (0x1600, 0, 3),
        (0x1400, 1, 0x219),
    ):
        dictionary.entry(index, subindex).store(value)
    cell.master.enable()
    cell.run(0.3)
    (event,) = cell.failures()
    assert (event.node_id, event.kind) == (25, EventKind.ENABLE_FAILED)
    assert "1600h sub 3 is 0x60710010, not 0x60b20010" in event.text
    cell.master.disable()
    cell.master.reset_faults()
    cell.run_to(MasterPhase.READY)
    assert dictionary.get(0x1600, 3) == 0x60B2_0010
    cell.master.enable()
    cell.run_to(MasterPhase.ENABLED)


def test_a_bus_of_200_hz(make_cell: MakeCell) -> None:
    cell = make_cell(sync_ns=5 * MS)
    cell.enabled()
    dictionary = cell.drives[21].node.dictionary
    assert (dictionary.get(0x60C2, 1), dictionary.get(0x60C2, 2)) == (5, -3)
    cell.run(0.5)
    assert cell.failures() == []


def test_device_without_the_fast_objects_is_refused(make_cell: MakeCell) -> None:
    device = devices()[21]
    pdos = tuple(
        replace(pdo, mapping=((0x6040, 0), (0x607A, 0))) if pdo.kind is PdoKind.RPDO and pdo.number == 1 else pdo
        for pdo in device.pdos
    )
    with pytest.raises(ValueError, match=r"tower_rotate: RPDO1 maps 6040h, 607Ah; must be"):
        make_cell().master.__class__([replace(device, pdos=pdos)], lambda *_: True, make_cell().clock)
    assert isinstance(pdos[0], PdoDef)


def test_a_value_that_does_not_stay_in_the_drive_is_noticed(cell: Any) -> None:
    cell.drives[22].node.dictionary.bind(0x1017, source=lambda: 77)
    cell.power_on()
    cell.run(0.5)
    (event,) = cell.failures()
    assert event.node_id == 22
    assert "expected 100 in 1017h sub 0 after it was written, came 77" in event.text


def test_a_heartbeat_that_only_the_set_up_has_switched_on_is_given_time(make_cell: MakeCell) -> None:
    """Boot-up at 0, no heartbeat until 1017h is written at 620 ms: not lost at the second look, at 700 ms."""
    silent = with_defaults(devices()[11], {(0x1017, 0): 0})
    cell = make_cell(drive_devices={11: silent}, times=MasterTimes(sdo_ns=200_000_000))
    cell.fault = lost_answers(11, 3)
    cell.power_on()
    assert 0.6 < cell.run_to(MasterPhase.READY) < 0.66
    cell.run(1.0)
    assert cell.failures() == []
