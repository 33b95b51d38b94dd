"""250 Hz on 1 Mbit/s: no frame lost in a minute, and the load that follows from the table of the bus."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from config.robot import load_robot
from drivers.catalogue import DRIVE_IDS, JOINT_IDS, PLANNER_ID, STRATEGIC_ID, TRACKER_ID
from drivers.cia402.states import Control, State, Status
from drivers.frame import bit_length
from drivers.objects import DataType, DeviceDef, ObjectDef, PdoDef
from logs.bus_log import read_bus_log
from tests.scenarios.conftest import Runner

ARM_HZ, PLATFORM_HZ, MISSION_HZ = 250, 25, 50
BITRATE = 1_000_000
FROM_NS, TO_NS = 6_000_000_000, 56_000_000_000
"""The drives hold, all of the cyclic frames are there."""
DRAWS = 200
ENABLED = State.OPERATION_ENABLED.value | Status.VOLTAGE_ENABLED | Status.REMOTE | Status.FOLLOWS_TARGET
COMMAND = Control.SWITCH_ON | Control.ENABLE_VOLTAGE | Control.QUICK_STOP | Control.ENABLE_OPERATION


def rate_hz(device: DeviceDef, pdo: PdoDef) -> float:
    """How often a PDO comes in `hold-still`; what its node sends with cycles of its own is said here."""
    if 1 <= pdo.transmission_type <= 240:
        return ARM_HZ / pdo.transmission_type
    if device.node_id == STRATEGIC_ID:
        return MISSION_HZ if pdo.number <= 4 else 0.0  # the others are joint references
    assert device.node_id == PLANNER_ID, device.name
    return ARM_HZ if pdo.number <= 4 else PLATFORM_HZ


def at_rest(device: DeviceDef, entry: ObjectDef, chance: random.Random, position: float) -> int:
    """What an object says while the robot stands; what cannot be known beforehand (weights, counters) is drawn."""
    drive, joint = device.node_id in DRIVE_IDS, device.node_id in JOINT_IDS
    if drive:
        fixed = {
            0x6040: COMMAND,
            0x6041: ENABLED | Status.TARGET_REACHED,
            0x6061: int(device.object(0x6060).default),
            0x6064: round(position / entry.scale),
            0x607A: round(position / entry.scale),
        }
        if entry.index in (0x6077, 0x60B2) and joint:
            return chance.randint(-600, 600)
        return fixed.get(entry.index, 0)
    if entry.name in ("counter", "checksum"):
        return chance.randrange(256)
    if entry.name == "Path scale":
        return 65_535
    if device.node_id == PLANNER_ID and entry.name in ("x", "y", "z", "rx", "ry", "rz", "sync_count"):
        bits = entry.data_type.bits
        return chance.randrange(1 << bits) - ((1 << bits - 1) if entry.data_type.signed else 0)
    if entry.name in ("fx", "fy", "fz", "mx", "my", "mz"):
        return chance.randint(-5, 5)
    return 0


def payload(device: DeviceDef, pdo: PdoDef, chance: random.Random, position: float) -> bytes:
    parts = []
    for key in pdo.mapping:
        entry = device.object(*key)
        assert entry.data_type is not DataType.REAL32
        value = at_rest(device, entry, chance, position)
        parts.append(value.to_bytes(entry.data_type.bits // 8, "little", signed=entry.data_type.signed))
    return b"".join(parts)


def predicted_load() -> float:
    """Share of the bus from the catalogue alone: rate x bits of every frame, stuff bits included."""
    robot = load_robot("moma8")
    chance = random.Random(1)
    start = dict(zip(JOINT_IDS, robot.arm.home, strict=True))
    bits_per_s = float(ARM_HZ * bit_length(0x080))
    for node_id, device in robot.devices.items():
        if node_id == TRACKER_ID:
            continue  # `hold-still` has no camera
        bits_per_s += 1e3 / int(device.object(0x1017).default) * bit_length(0x700 + node_id, b"\x05")
        for pdo in device.pdos:
            if pdo.enabled:
                drawn = (payload(device, pdo, chance, start.get(node_id, 0.0)) for _ in range(DRAWS))
                mean = sum(bit_length(pdo.cob_id, data) for data in drawn) / DRAWS
                bits_per_s += rate_hz(device, pdo) * mean
    return bits_per_s / BITRATE


@pytest.mark.slow
def test_a_minute_at_250_hz_loses_no_frame_and_loads_the_bus_as_predicted(runner: Runner) -> None:
    outcome = runner(
        "hold-still",
        f"planner.arm_cycle_hz={ARM_HZ}",
        f"planner.platform_cycle_hz={PLATFORM_HZ}",
        f"bus.bitrate={BITRATE}",
        "step.0.duration_s=57",
        "duration_s=60",
        duration_s=60.0,
    )
    assert outcome.metrics["frames_lost"] == 0
    assert outcome.metrics["incomplete_cycles"] == 0
    bits = 0
    count: Counter[int] = Counter()
    for frame in read_bus_log(outcome.directory / "bus.log"):
        if FROM_NS <= frame.t_ns < TO_NS:
            bits += bit_length(frame.can_id, frame.data)
            count[frame.can_id] += 1
    cycles = (TO_NS - FROM_NS) * ARM_HZ // 1_000_000_000
    every_cycle = [0x080, 0x182, 0x282, 0x382, 0x482, 0x19F, 0x29F]
    for node_id in DRIVE_IDS:
        every_cycle += [0x180 + node_id, 0x200 + node_id]
    assert {can_id: count[can_id] for can_id in every_cycle} == {
        can_id: pytest.approx(cycles, abs=1) for can_id in every_cycle
    }
    load = bits * 1e9 / (TO_NS - FROM_NS) / BITRATE
    predicted = predicted_load()
    print(f"load {100 * load:.2f} %, predicted {100 * predicted:.2f} %")
    assert load == pytest.approx(predicted, abs=0.02)
    assert load < 0.9
