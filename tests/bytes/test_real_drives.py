"""docs/real-drives.md against the master: what it says that is read, written and refused is what goes over the bus."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from config.bench import bench_drives
from config.load import dump_scenario, load_scenario, validate
from config.robot import load_robot
from config.scenario import Scenario
from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.catalogue import DRIVE_IDS
from drivers.cia402.bench import BenchDrive
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.gate_keeper import GATE_MARGIN, GATE_MARGIN_PER_MILLE
from drivers.cia402.phases import EventKind, MasterPhase
from drivers.cia402.settling import FREE, FREE_TO_DIFFER, LESS_IS_TIGHTER, MORE_IS_TIGHTER, PROTECTING
from drivers.objects import DeviceDef, PdoKind, Value
from tests.unit.cia402.rig import with_defaults
from tests.unit.master import conftest as master_cell

DOCUMENT = Path(__file__).parents[2] / "docs" / "real-drives.md"
NODE = 25
UNTOUCHED: dict[tuple[int, int], Value] = {
    (0x1006, 0): 0,
    (0x1016, 1): 0,
    (0x1017, 0): 0,
    (0x1400, 2): 255,
    (0x1600, 0): 1,
    (0x1600, 2): 0,
    (0x1600, 3): 0,
    (0x1401, 1): 0x319,
    (0x1401, 2): 255,
    (0x1601, 0): 2,
    (0x1601, 1): 0x6040_0010,
    (0x1601, 2): 0x6060_0008,
    (0x1402, 1): 0x419,
    (0x1402, 2): 255,
    (0x1602, 0): 2,
    (0x1602, 1): 0x6040_0010,
    (0x1602, 2): 0x607A_0020,
    (0x1800, 2): 255,
    (0x1A00, 0): 1,
    (0x1A00, 2): 0,
    (0x1A00, 3): 0,
    (0x1801, 2): 255,
    (0x1A01, 0): 1,
    (0x1A01, 1): 0x6041_0010,
    (0x1A01, 2): 0,
    (0x6007, 0): 1,
    (0x605A, 0): 6,
    (0x605B, 0): 1,
    (0x605C, 0): 0,
    (0x605D, 0): 2,
    (0x605E, 0): 1,
    (0x6060, 0): 0,
    (0x6065, 0): 1_000,
    (0x6066, 0): 0,
    (0x6072, 0): 1_000,
    (0x607D, 1): -(1 << 31),
    (0x607D, 2): (1 << 31) - 1,
    (0x607F, 0): 1_000,
    (0x6085, 0): 1_000,
    (0x60C2, 1): 1,
    (0x60C5, 0): 1_000,
}
"""A drive out of its box: the pre-defined PDOs of a drive, event driven, no heartbeat, everything else differs."""
_PDOS: dict[tuple[PdoKind, int], dict[str, Any]] = {
    (PdoKind.RPDO, 1): {"mapping": ((0x6040, 0),), "transmission_type": 255},
    (PdoKind.RPDO, 2): {"mapping": ((0x6040, 0), (0x6060, 0)), "transmission_type": 255, "enabled": True},
    (PdoKind.RPDO, 3): {"mapping": ((0x6040, 0), (0x607A, 0)), "transmission_type": 255, "enabled": True},
    (PdoKind.TPDO, 1): {"mapping": ((0x6041, 0),), "transmission_type": 255},
    (PdoKind.TPDO, 2): {"mapping": ((0x6041, 0),), "transmission_type": 255},
}


def out_of_its_box(device: DeviceDef) -> DeviceDef:
    pdos = tuple(
        replace(pdo, **changes) if (changes := _PDOS.get((pdo.kind, pdo.number))) else pdo for pdo in device.pdos
    )
    return replace(with_defaults(device, UNTOUCHED), pdos=pdos)


def as_planner() -> DriveSettings:
    """The settings that the planner's node makes."""
    gates = {node_id: {GATE_MARGIN: GATE_MARGIN_PER_MILLE} for node_id in DRIVE_IDS}
    return DriveSettings(sync_period_ns=master_cell.SYNC_NS, parameters=gates)


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> dict[int, DeviceDef]:
    """The devices of moma8; what the test puts in here is what the master believes."""
    found = load_robot("moma8").devices
    monkeypatch.setattr(master_cell, "devices", lambda: found)
    return found


def lines_of(section: str) -> list[tuple[int, int, int]]:
    """The rows `| 607Dh sub 1 | -2356194 | ... |` below a heading: (index, sub-index, value)."""
    text = DOCUMENT.read_text().split(f"\n## {section}\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([0-9A-F]{4})h(?: sub (\d+))? \| (?:([0-9A-F]+)h|(-?\d+)) \|", text, re.MULTILINE)
    return [(int(index, 16), int(sub or 0), int(hexa, 16) if hexa else int(plain)) for index, sub, hexa, plain in rows]


def downloads(cell: master_cell.Cell) -> list[tuple[int, int, int]]:
    """Expedited SDO downloads to the drive in their order: (index, sub-index, value)."""
    found = []
    for frame in cell.wire:
        if frame.can_id == 0x600 + NODE and frame.data[0] & 0xE0 == 0x20:
            data = frame.data[4 : 8 - (frame.data[0] >> 2 & 3)]
            index = int.from_bytes(frame.data[1:3], "little")
            found.append((index, frame.data[3], int.from_bytes(data, "little", signed=index == 0x607D)))
    return found


def test_the_page_has_what_the_master_writes_in_its_order(table: dict[int, DeviceDef]) -> None:
    drive = out_of_its_box(table[NODE])
    cell = master_cell.Cell(settings=as_planner(), drive_devices={NODE: drive}).enabled()
    assert downloads(cell) == lines_of("What the master writes")


def bench_of_the_page() -> dict[int, BenchDrive]:
    """What the page's example of a scenario says."""
    (example,) = re.findall(r"```toml\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    data = tomllib.loads(dump_scenario(load_scenario("hold-still"))) | tomllib.loads(example)
    scenario = validate(Scenario, data, DOCUMENT)
    return bench_drives(scenario.drives)


def hidden(cell: master_cell.Cell, *indices: int) -> master_cell.Cell:
    """The SDO server of the drive says of `indices` that there are no such objects."""
    dictionary = cell.drives[NODE].node.dictionary
    upload = dictionary.upload

    def without(index: int, subindex: int) -> bytes:
        if index in indices:
            raise SdoAbort(AbortCode.NO_SUCH_OBJECT)
        return upload(index, subindex)

    dictionary.upload = without  # type: ignore[method-assign]
    return cell


def test_a_bought_drive_is_refused_until_the_scenario_says_what_the_page_says(table: dict[int, DeviceDef]) -> None:
    text = " ".join(DOCUMENT.read_text().split())
    drive = with_defaults(table[NODE], {(0x1018, 1): 0x2AB, (0x1018, 2): 7})
    cell = master_cell.Cell(settings=as_planner(), drive_devices={NODE: drive})
    cell.power_on()
    cell.run(0.5)
    (event,) = cell.failures()
    assert (event.node_id, event.kind) == (NODE, EventKind.CONFIGURATION_FAILED)
    begin, end = event.text.split("start-up, read 1018h sub 2: ")
    assert f"`{begin}… {end}`" in text

    bench = bench_of_the_page()
    assert bench == {NODE: BenchDrive(vendor_id=0x2AB, product_code=7, accept_missing=frozenset({0x607F}))}
    settings = replace(as_planner(), bench=bench)
    cell = hidden(master_cell.Cell(settings=settings, drive_devices={NODE: drive}), 0x2100, 0x607F).enabled()
    assert cell.master.phase is MasterPhase.ENABLED
    noted = [event.text for event in cell.of_kind(EventKind.NOTED)]
    assert len(noted) == 2
    assert all("set up with a difference: " in line and "abort 06020000h" in line for line in noted)


def indices_in(cell: str) -> set[int]:
    """`605Bh … 605Eh, 6060h` to numbers; ranges of whole areas are left out."""
    found: set[int] = set()
    for part in cell.split(","):
        numbers = [int(number, 16) for number in re.findall(r"\b([0-9A-F]{4})h", part)]
        if "…" in part and numbers[1] - numbers[0] < 16:
            found.update(range(numbers[0], numbers[1] + 1))
        elif "…" not in part:
            found.update(numbers)
    return found


def test_what_the_page_says_may_be_missing_is_what_the_master_lets_be_missing() -> None:
    text = DOCUMENT.read_text().split("### What may be missing")[1].split("*Noted*")[0]
    rows = [row.split(" | ") for row in re.findall(r"^\| (.*[0-9A-F]{4}h.*) \|$", text, re.MULTILINE)]
    noted = set().union(*(indices_in(objects) for objects, missing, _ in rows if missing == "noted"))
    assert noted == set(FREE)
    (guards,) = (indices_in(objects) for objects, missing, _ in rows if "accept_missing" in missing)
    assert guards == set(PROTECTING)
    differ = set().union(
        *(indices_in(objects) for objects, _, other in rows if other.startswith("noted;") and "6060h, " in other)
    )
    assert differ == set(FREE_TO_DIFFER)
    tight = set().union(*(indices_in(objects) for objects, _, other in rows if other.startswith("noted if tighter")))
    assert tight == {index for index, _ in LESS_IS_TIGHTER | MORE_IS_TIGHTER} | {0x6007}


def test_what_the_page_calls_not_written_is_not_written(table: dict[int, DeviceDef]) -> None:
    text = DOCUMENT.read_text()
    claimed = text.split("Not written, and so yours to look after:")[1].split("\n\n")[0]
    indices = {int(found, 16) for found in re.findall(r"\b([0-9A-F]{4})h", claimed)} - {0x605C, 0x605D}
    assert len(indices) == 10
    other: dict[tuple[int, int], Value] = {
        (0x1019, 0): 0,
        (0x1029, 1): 2,
        (0x6084, 0): 5,
        (0x607C, 0): 5,
        (0x6099, 1): 5,
    }
    drive = with_defaults(table[NODE], other)
    cell = master_cell.Cell(settings=as_planner(), drive_devices={NODE: drive}).enabled()
    asked = {int.from_bytes(frame.data[1:3], "little") for frame in cell.wire if frame.can_id == 0x600 + NODE}
    assert not asked & indices
