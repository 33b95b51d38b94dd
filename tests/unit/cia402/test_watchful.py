"""What a drive does not believe, and what it does about it: encoders, wheels, set points; and what it bears."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

from drivers.catalogue import devices
from drivers.cia402 import gate_keeper
from drivers.cia402.states import State
from stack.messages import Vector
from stack.servo.state import AxisMode
from tests.unit.cia402.rig import MS, SYNC_NS, LinearPlant, Master, Rig

JOINT, WHEEL = 25, 12
GATE_MARGIN = 0x2100


class BadEncoder(LinearPlant):
    """Shows an offset, or for ever what it showed."""

    offset = 0.0
    frozen: Vector | None = None

    def read(self, position: Vector, velocity: Vector) -> None:
        super().read(position, velocity)
        position += self.offset
        if self.frozen is not None:
            position[:], velocity[:] = self.frozen, 0.0


def moving(node_id: int, velocity: int = 500_000) -> tuple[Rig, Master]:
    rig = Rig(node_id, plant_type=BadEncoder)
    master = Master(rig)
    master.enable()
    master.move(velocity)
    rig.run(300 * MS)
    assert rig.plant.velocity[0] == pytest.approx(velocity * 1e-6, rel=0.03)
    return rig, master


def emergencies(rig: Rig, node_id: int) -> list[int]:
    return [int.from_bytes(data[:2], "little") for data in rig.sent(0x080 + node_id)]


@pytest.mark.parametrize(("node_id", "jump"), [(JOINT, 0.1), (JOINT, -0.02), (WHEEL, 1.0)])
def test_an_encoder_that_jumps_takes_the_torque_away_before_the_loops_see_it(node_id: int, jump: float) -> None:
    rig, _ = moving(node_id)
    rig.plant.peak_acceleration[:] = 0.0
    rig.plant.offset = jump  # type: ignore[attr-defined]
    rig.run(2 * MS)
    assert rig.drive.state is State.FAULT
    assert rig.bank.mode[0] == AxisMode.OFF
    assert emergencies(rig, node_id) == [0x7300]
    assert rig.plant.peak_acceleration[0] < 5.0 or node_id == WHEEL


def test_a_small_step_of_an_encoder_is_borne() -> None:
    rig, _ = moving(JOINT)
    rig.plant.offset = 2e-3  # type: ignore[attr-defined]
    rig.run(100 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_an_encoder_that_shows_the_same_for_ever_is_found_before_the_axis_runs_away() -> None:
    rig, _ = moving(JOINT)
    rig.plant.frozen = rig.plant.position.copy()  # type: ignore[attr-defined]
    rig.run(60 * MS)
    assert rig.drive.state is State.FAULT
    assert emergencies(rig, JOINT) == [0x7300]
    assert abs(rig.plant.velocity[0]) < 1.0


def test_at_rest_an_encoder_may_show_the_same() -> None:
    rig, master = moving(JOINT)
    master.velocity = 0
    rig.run(300 * MS)
    rig.plant.frozen = rig.plant.position.copy()  # type: ignore[attr-defined]
    rig.run(500 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED


def test_a_wheel_that_does_not_turn_as_it_is_told() -> None:
    rig, _ = moving(WHEEL, 2_000_000)
    rig.plant.blocked[0] = True
    rig.run(350 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    rig.run(150 * MS)
    assert emergencies(rig, WHEEL) == [0x8400]
    rig.run(500 * MS)
    assert rig.drive.state is State.FAULT


def test_an_axis_that_gets_worse_during_its_fault_reaction_loses_its_torque() -> None:
    rig, _ = moving(JOINT, 0)
    rig.plant.load[0] = 300.0  # three times what the motor has
    rig.run(300 * MS)
    assert rig.drive.state is State.FAULT
    assert rig.bank.mode[0] == AxisMode.OFF


@pytest.mark.parametrize("missed", [1, 2, 3, 8])
def test_lost_set_points_are_borne_and_the_motion_goes_on(missed: int) -> None:
    rig, master = moving(JOINT)
    rig.plant.peak_acceleration[:] = 0.0
    master.sends_rpdo = False
    rig.run(missed * SYNC_NS)
    master.sends_rpdo = True
    rig.run(500 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert rig.plant.velocity[0] == pytest.approx(0.5, rel=0.03)
    assert rig.plant.position[0] * 1e6 == pytest.approx(master.target[JOINT], abs=15_000)
    assert emergencies(rig, JOINT) == ([0x8250, 0] if missed >= 3 else [])
    assert rig.plant.peak_acceleration[0] < 1.5 * 12.0


def test_a_lost_sync_is_borne_too() -> None:
    rig, master = moving(JOINT)
    master.alive = False
    rig.run(5 * SYNC_NS)
    master.alive = True
    rig.run(300 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert emergencies(rig, JOINT) == [0x8700, 0]


def test_a_set_point_that_jumps_is_refused_counted_and_told() -> None:
    rig, master = moving(JOINT)
    assert master.write(JOINT, GATE_MARGIN, 0, struct.pack("<H", 3000)) == 0
    master.command(0x0F, 1)
    rig.drive.gate.seed(master.target[JOINT])  # as enabling does; the margin is in force from then on
    rig.plant.peak_acceleration[:] = 0.0
    master.target[JOINT] += 400_000
    rig.run(SYNC_NS)
    master.target[JOINT] -= 400_000
    rig.run(100 * MS)
    assert emergencies(rig, JOINT) == [0xFF01, 0]
    assert rig.sent(0x080 + JOINT)[0][3] == 3  # a jump
    assert struct.unpack("<I", master.read(JOINT, 0x2101)) == (1,)
    assert rig.plant.velocity[0] == pytest.approx(0.5, rel=0.03)
    assert rig.plant.peak_acceleration[0] < 10.0
    assert np.isfinite(rig.plant.position).all()


def test_a_drive_as_shipped_lets_targets_jump_and_leads_the_axis_there_itself() -> None:
    rig, master = moving(JOINT, 0)
    master.target[JOINT] += 300_000
    rig.run(1500 * MS)
    assert rig.plant.position[0] * 1e6 == pytest.approx(master.target[JOINT], abs=500)
    assert emergencies(rig, JOINT) == []


def test_refusals_in_a_row_are_one_emergency() -> None:
    rig, master = moving(JOINT)
    assert master.write(JOINT, GATE_MARGIN, 0, struct.pack("<H", 3000)) == 0
    master.command(0x0F, 1)
    rig.drive.gate.seed(master.target[JOINT])
    master.target[JOINT] += 400_000
    rig.run(2 * SYNC_NS)
    master.target[JOINT] -= 400_000
    rig.run(10 * SYNC_NS)
    assert emergencies(rig, JOINT) == [0xFF01, 0]
    assert struct.unpack("<I", master.read(JOINT, 0x2101)) == (2,)


def test_a_target_beyond_the_limits_passes_as_the_limit_and_is_counted() -> None:
    rig, master = moving(JOINT, 0)
    (upper,) = struct.unpack("<i", master.read(JOINT, 0x607D, 2))
    master.target[JOINT] = upper + 1000
    rig.run(2 * SYNC_NS)
    assert struct.unpack("<i", master.read(JOINT, 0x607A)) == (upper,)
    assert struct.unpack("<I", master.read(JOINT, 0x2102))[0] >= 1
    assert emergencies(rig, JOINT) == []


def test_a_master_that_plans_smooth_motions_lets_three_times_the_velocity_limit_pass() -> None:
    assert (gate_keeper.GATE_MARGIN, gate_keeper.GATE_MARGIN_PER_MILLE) == ((0x2100, 0), 3000)
    joint = devices()[JOINT]
    assert gate_keeper.has_gate(joint)
    assert not gate_keeper.has_gate(replace(joint, objects=tuple(o for o in joint.objects if o.index != 0x2100)))


@pytest.mark.parametrize(("limit", "largest"), [(1000, 1000), (0xFFFF, 0x7FFF)])
@pytest.mark.parametrize("wanted", [0x7FFF, -0x8000])
def test_a_torque_offset_grows_by_half_of_the_limit_a_period_and_not_beyond_it(
    limit: int, largest: int, wanted: int
) -> None:
    rig = Rig(JOINT, defaults={(0x6072, 0): limit})
    master = Master(rig)
    master.enable()
    master.offset[JOINT] = wanted
    offsets: list[int] = []
    for _ in range(3):
        rig.run(SYNC_NS)
        assert rig.drive.state is State.OPERATION_ENABLED
        offsets.append(struct.unpack("<h", rig.drive.node.rpdo[1].pending[6:8])[0])  # type: ignore[index]
    sign = np.sign(wanted)
    assert offsets == [sign * round(largest / 2), sign * largest, sign * largest]


GATED = {(GATE_MARGIN, 0): 3000, (0x6007, 0): 0, (0x605C, 0): 1}
"""A gate; loss of the master: stop and hold under torque; «disable operation»: down the ramp first."""


def guarded(velocity: int) -> tuple[Rig, Master]:
    rig = Rig(JOINT, defaults=GATED)
    master = Master(rig)
    master.enable()
    master.move(velocity)
    rig.run(300 * MS)
    return rig, master


def test_a_jump_does_not_pass_with_a_fault_reset_in_the_command() -> None:
    rig, master = guarded(0)
    before = rig.plant.position[0]
    master.word[JOINT] = 0x8F
    master.target[JOINT] += 500_000
    rig.run(100 * MS)
    assert emergencies(rig, JOINT)[0] == 0xFF01
    assert rig.plant.position[0] == pytest.approx(before, abs=2e-3)


def test_a_jump_does_not_pass_after_a_hold() -> None:
    rig, master = guarded(500_000)
    master.sends_rpdo = False
    rig.run(500 * MS)
    assert rig.drive.state is State.OPERATION_ENABLED
    held = rig.plant.position[0]
    master.velocity, master.target[JOINT] = 0, round(1e6 * held) + 500_000
    master.sends_rpdo = True
    rig.run(100 * MS)
    assert 0xFF01 in emergencies(rig, JOINT)
    assert rig.plant.position[0] == pytest.approx(held, abs=2e-3)
    master.target[JOINT] = round(1e6 * held) + 10_000
    rig.run(300 * MS)
    assert rig.plant.position[0] == pytest.approx(held + 0.01, abs=2e-3)


def test_a_jump_does_not_pass_where_a_stop_is_taken_back_on_its_ramp() -> None:
    rig, master = guarded(500_000)
    master.velocity = 0
    master.target[JOINT] += 500_000
    master.command(0x07, 2)
    assert rig.drive.state is State.OPERATION_ENABLED, "still on the ramp"
    before = rig.plant.position[0]
    master.command(0x0F, 10)
    assert rig.drive.state is State.OPERATION_ENABLED
    assert 0xFF01 in emergencies(rig, JOINT)
    assert rig.plant.position[0] < before + 0.06
