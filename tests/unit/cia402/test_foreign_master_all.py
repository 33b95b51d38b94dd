"""The `canopen` package as master of all ten drives at once, on one bus: every mode, and every way to stop.

Virtual time, as in test_foreign_master.py; the ten axes are linear plants of their own.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import canopen
import numpy as np
import pytest
from canopen.profiles.p402 import BaseNode402

from drivers.catalogue import DRIVE_IDS, JOINT_IDS, WHEEL_IDS
from stack.messages import Vector
from stack.servo.state import BoolVector
from tests.unit.cia402.bridge import LockstepBridge
from tests.unit.cia402.rig import LinearPlant, Rig

pytestmark = pytest.mark.slow

EDS = Path(__file__).parents[3] / "config" / "bus"
LIFT = 22
MASTER_ID = 0x7E
PATIENCE_S = 60.0
PATIENCE_CYCLES = 3_000
CSP, CSV, CST = (f"CYCLIC SYNCHRONOUS {what}" for what in ("POSITION", "VELOCITY", "TORQUE"))


class PatientNode(BaseNode402):
    TIMEOUT_RESET_FAULT = 0.05  # always waited out
    TIMEOUT_SWITCH_OP_MODE = TIMEOUT_SWITCH_STATE_FINAL = TIMEOUT_SWITCH_STATE_SINGLE = TIMEOUT_CHECK_TPDO = PATIENCE_S


class TenAxes(LinearPlant):
    """The lift moves in a tougher medium: a thousandth of its rated force is half a newton."""

    def __init__(self, position: Vector, velocity_axes: BoolVector) -> None:
        super().__init__(position, velocity_axes)
        self._friction = np.full(len(position), 0.5)  # type: ignore[assignment]
        self._friction[DRIVE_IDS.index(LIFT)] = 5.0  # type: ignore[index]


class Bench:
    """Network, ten nodes, and the simulated drives behind them; RPDO2 and TPDO3 mapped by this master."""

    def __init__(self) -> None:
        self.rig = Rig(*DRIVE_IDS, plant_type=TenAxes)
        self.network = canopen.Network(LockstepBridge(self.rig.clock, self.rig.bus))
        self.network.NOTIFIER_SHUTDOWN_TIMEOUT = PATIENCE_S
        self.emergencies: list[tuple[int, int]] = []
        self.nodes = {node_id: self._node(node_id) for node_id in DRIVE_IDS}
        missing, all_booted = set(DRIVE_IDS), threading.Event()

        def boot(can_id: int, data: bytearray, timestamp: float) -> None:
            missing.discard(can_id - 0x700)
            if not missing:
                all_booted.set()

        for node_id in DRIVE_IDS:
            self.network.subscribe(0x700 + node_id, boot)
        self.network.connect()
        assert all_booted.wait(PATIENCE_S), f"no boot-up from {missing}"

    def _node(self, node_id: int) -> PatientNode:
        eds = EDS / ("wheel_drive.eds" if node_id in WHEEL_IDS else "joint_drive.eds")
        node = PatientNode(node_id, str(eds))
        self.network.add_node(node)
        node.sdo.RESPONSE_TIMEOUT = PATIENCE_S
        node.emcy.add_callback(lambda error: self.emergencies.append((node_id, error.code)))
        return node

    def set_up(self) -> None:
        """Maps what the shipped PDOs lack, starts SYNC, RPDOs and nodes; targets are where the axes are."""
        for node_id, node in self.nodes.items():
            node.tpdo.read()
            node.rpdo.read()
            more = ["Target position"] if node_id in WHEEL_IDS else ["Target velocity", "Target torque"]
            remap(node.rpdo[2], more)
            remap(node.tpdo[3], ["Velocity actual value", "Error code"])
            node.setup_402_state_machine(read_pdos=False)
            node.rpdo_pointers[0x607A].raw = node.sdo["Position actual value"].raw
        self.network.sync.start(0.01)
        for node in self.nodes.values():
            node.rpdo[1].start(0.01)
            node.rpdo[2].start(0.01)
        self.network.nmt.state = "OPERATIONAL"  # one frame for all ten
        self.until(lambda: self.states() == {"SWITCH ON DISABLED"})

    def enable(self) -> None:
        for node in self.nodes.values():
            node.state = "OPERATION ENABLED"

    def switch_mode(self, mode: str, ids: Iterable[int] = DRIVE_IDS) -> None:
        for node_id in ids:
            self.seed(node_id)
            self.nodes[node_id].op_mode = mode
            assert self.nodes[node_id].op_mode == mode

    def seed(self, node_id: int) -> None:
        """Targets that move nothing."""
        self.target(node_id, 0x607A, self.position(node_id))
        self.target(node_id, 0x60FF, 0)
        if node_id in JOINT_IDS:
            self.target(node_id, 0x6071, 0)

    def target(self, node_id: int, index: int, value: int) -> None:
        self.nodes[node_id].rpdo_pointers[index].raw = value

    def position(self, node_id: int) -> int:
        return int(self.nodes[node_id].tpdo_values[0x6064])

    def velocity(self, node_id: int) -> int:
        return int(self.nodes[node_id].tpdo_values[0x606C])

    def states(self) -> set[str]:
        return {node.state for node in self.nodes.values()}

    def error_codes(self) -> dict[int, int]:
        """603Fh by the PDO that this master has mapped."""
        return {node_id: int(node.tpdo_values[0x603F]) for node_id, node in self.nodes.items()}

    def until(self, condition: Callable[[], bool]) -> None:
        """Looks with every TPDO1 of the last drive of a cycle."""
        for _ in range(PATIENCE_CYCLES):
            if condition():
                return
            self.nodes[DRIVE_IDS[-1]].check_statusword()
        pytest.fail(f"not within {PATIENCE_CYCLES} cycles; {[node.state for node in self.nodes.values()]}")

    def move_by(self, distance: float, ids: Iterable[int] = DRIVE_IDS) -> None:
        """All at once, in CSP; the lift, which has less room, by a tenth."""
        goals = {node_id: self.position(node_id) + way(node_id, distance) for node_id in ids}
        for node_id, goal in goals.items():
            self.target(node_id, 0x607A, goal)
        self.until(lambda: all(abs(self.position(node_id) - goal) < 500 for node_id, goal in goals.items()))

    def hurry(self) -> None:
        """All ten on their way, in their own modes: joints CSP, wheels CSV."""
        for node_id in JOINT_IDS:
            self.target(node_id, 0x607A, self.position(node_id) + way(node_id, 2.0))
        for node_id in WHEEL_IDS:
            self.target(node_id, 0x60FF, 2_000_000)
        self.until(lambda: all(self.velocity(node_id) > way(node_id, 0.5) for node_id in DRIVE_IDS))

    def standing(self) -> bool:
        return bool(np.all(np.abs(self.rig.plant.velocity) < 0.02))


def way(node_id: int, distance: float) -> int:
    return round(1e6 * (0.1 if node_id == LIFT else 1.0) * distance)


def remap(pdo: canopen.pdo.base.PdoMap, names: list[str]) -> None:
    pdo.clear()
    for name in names:
        pdo.add_variable(name)
    pdo.trans_type, pdo.enabled = 1, True
    pdo.save()
    pdo.read()
    assert [variable.name for variable in pdo] == names, "the drive has taken the mapping"


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    try:
        bench.set_up()
        yield bench
    finally:
        bench.network.disconnect()


def test_all_ten_enable_and_home(bench: Bench) -> None:
    for node_id in DRIVE_IDS:
        bench.nodes[node_id].sdo["Home offset"].raw = 1_000 * node_id
        bench.nodes[node_id].sdo["Software position limit"][2].raw = 2_900_000  # homing moves the zero
        assert bench.nodes[node_id].homing(timeout=PATIENCE_S)
    bench.until(lambda: all(abs(bench.position(node_id) - 1_000 * node_id) < 200 for node_id in DRIVE_IDS))
    assert bench.states() == {"OPERATION ENABLED"}


def test_all_ten_follow_positions(bench: Bench) -> None:
    bench.switch_mode(CSP)
    bench.enable()
    begin = bench.rig.plant.position.copy()
    bench.move_by(0.3)
    moved = bench.rig.plant.position - begin
    assert moved == pytest.approx([1e-6 * way(node_id, 0.3) for node_id in DRIVE_IDS], abs=2e-3)
    bench.move_by(-0.2)
    assert bench.emergencies == []


def test_all_ten_follow_velocities(bench: Bench) -> None:
    bench.switch_mode(CSV)
    bench.enable()
    for wanted in (0.4, -0.4, 0.0):
        goals = {node_id: way(node_id, wanted) for node_id in DRIVE_IDS}
        for node_id, goal in goals.items():
            bench.target(node_id, 0x60FF, goal)
        bench.until(lambda goals=goals: all(abs(bench.velocity(i) - goal) < 4_000 for i, goal in goals.items()))
    bench.until(bench.standing)
    bench.switch_mode(CSP)
    bench.move_by(0.1)
    assert bench.emergencies == []


def test_eight_joints_follow_torques_and_wheels_say_that_they_cannot(bench: Bench) -> None:
    for node_id in WHEEL_IDS:
        with pytest.raises(TypeError):
            bench.nodes[node_id].op_mode = CST
    bench.switch_mode(CST, JOINT_IDS)
    bench.enable()
    for sign in (1, -1):
        for node_id in JOINT_IDS:
            rated_nm = bench.nodes[node_id].sdo["Motor rated torque"].raw * 1e-3
            bench.target(node_id, 0x6071, sign * max(1, round(0.1 * 1000 / rated_nm)))
        bench.until(lambda sign=sign: all(sign * bench.velocity(i) > way(i, 0.05) for i in JOINT_IDS))
        for node_id in JOINT_IDS:
            node = bench.nodes[node_id]
            assert node.tpdo_values[0x6077] == node.rpdo_pointers[0x6071].raw
    bench.switch_mode(CSP, JOINT_IDS)
    bench.move_by(0.1, JOINT_IDS)
    assert bench.emergencies == []


def test_all_ten_quick_stop_at_once_and_go_on(bench: Bench) -> None:
    for node in bench.nodes.values():
        node.sdo["Quick stop option code"].raw = 6  # stays in quick stop active
    bench.enable()
    bench.hurry()
    for node in bench.nodes.values():
        node.controlword = 0x0002
    bench.until(lambda: bench.states() == {"QUICK STOP ACTIVE"} and bench.standing())
    bench.until(lambda: all(node.statusword & 0x400 for node in bench.nodes.values()))
    for node_id in DRIVE_IDS:
        bench.seed(node_id)
    bench.enable()
    bench.move_by(-0.1, JOINT_IDS)
    assert bench.emergencies == []


def test_all_ten_fault_tell_why_and_recover_without_power_cycle(bench: Bench) -> None:
    bench.enable()
    bench.rig.plant.blocked[:] = True
    for node_id in JOINT_IDS:
        bench.target(node_id, 0x607A, bench.position(node_id) + way(node_id, 1.0))
    for node_id in WHEEL_IDS:
        bench.target(node_id, 0x60FF, 3_000_000)
    bench.until(lambda: bench.states() == {"FAULT"})
    codes = {node_id: 0x8611 if node_id in JOINT_IDS else 0x8400 for node_id in DRIVE_IDS}
    bench.until(lambda: bench.error_codes() == codes)
    assert dict(bench.emergencies) == codes
    for node_id, node in bench.nodes.items():
        assert node.sdo["Pre-defined error field"][1].raw & 0xFFFF == codes[node_id]
    bench.rig.plant.blocked[:] = False
    for node_id, node in bench.nodes.items():
        bench.seed(node_id)
        node.reset_from_fault()
    assert bench.states() == {"OPERATION ENABLED"}
    bench.until(lambda: set(bench.error_codes().values()) == {0})
    bench.move_by(-0.1, JOINT_IDS)


def test_all_ten_stop_when_the_heartbeat_of_the_master_ends_and_go_on_when_it_is_back(bench: Bench) -> None:
    for node in bench.nodes.values():
        node.sdo["Consumer heartbeat time"][1].raw = MASTER_ID << 16 | 100
    heartbeat = bench.network.send_periodic(0x700 + MASTER_ID, b"\x05", 0.02)
    bench.enable()
    bench.hurry()
    heartbeat.stop()
    for node in bench.nodes.values():
        while node.nmt.wait_for_heartbeat(PATIENCE_S) != "PRE-OPERATIONAL":
            pass
    while not bench.standing():
        bench.nodes[DRIVE_IDS[0]].nmt.wait_for_heartbeat(PATIENCE_S)
    assert {(node_id, 0x8130) for node_id in DRIVE_IDS} <= set(bench.emergencies)
    for node_id, node in bench.nodes.items():
        assert node.sdo["Statusword"].raw & 0x4F == 0x40, "switch on disabled: the quick stop of 6007h is over"
        node.controlword = 0
        bench.seed(node_id)
        bench.target(node_id, 0x607A, node.sdo["Position actual value"].raw)
    bench.network.send_periodic(0x700 + MASTER_ID, b"\x05", 0.02)
    bench.network.nmt.state = "OPERATIONAL"
    bench.until(lambda: bench.states() == {"SWITCH ON DISABLED"})
    bench.enable()
    bench.move_by(-0.1, JOINT_IDS)
