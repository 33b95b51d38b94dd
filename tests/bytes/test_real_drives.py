"""docs/real-drives.md against the master: what it says that is read, written and refused is what goes over the bus."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from config.robot import load_robot
from drivers.catalogue import DRIVE_IDS
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.gate_keeper import GATE_MARGIN, GATE_MARGIN_PER_MILLE
from drivers.cia402.phases import EventKind, MasterPhase
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
    (0x1401, 2): 255,
    (0x1601, 0): 2,
    (0x1601, 1): 0x6040_0010,
    (0x1601, 2): 0x6060_0008,
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


def without(device: DeviceDef, *indices: int) -> DeviceDef:
    return replace(device, objects=tuple(entry for entry in device.objects if entry.index not in indices))


class Robot(master_cell.Cell):
    """Ten drives with the limits of moma8, node 25 another one; set up as the planner does it."""


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Any:
    table = load_robot("moma8").devices
    monkeypatch.setattr(master_cell, "devices", lambda: table)
    gates = {node_id: {GATE_MARGIN: GATE_MARGIN_PER_MILLE} for node_id in DRIVE_IDS}

    def make(device: DeviceDef | None = None) -> master_cell.Cell:
        settings = DriveSettings(sync_period_ns=master_cell.SYNC_NS, parameters=gates)
        return master_cell.Cell(settings=settings, drive_devices={NODE: device} if device is not None else {})

    make.device = table[NODE]  # type: ignore[attr-defined]
    return make


def downloads(cell: master_cell.Cell) -> list[tuple[int, int, int]]:
    """Expedited SDO downloads to the drive: (index, sub-index, value as it is on the wire)."""
    found = []
    for frame in cell.wire:
        if frame.can_id == 0x600 + NODE and frame.data[0] & 0xE0 == 0x20:
            size = 4 - (frame.data[0] >> 2 & 3)
            index = int.from_bytes(frame.data[1:3], "little")
            found.append((index, frame.data[3], int.from_bytes(frame.data[4 : 4 + size], "little", signed=index == 0x607D)))
    return found
