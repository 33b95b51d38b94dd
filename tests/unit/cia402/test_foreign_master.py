"""The `canopen` package as master: it reads our EDS, boots a simulated drive, sets it up, enables it and moves it.

Its waits end with the next frame of virtual time; its wall-clock time-outs are raised to where a slow machine does not
reach them, and no test sleeps.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from tests.unit.cia402.bridge import LockstepBridge
from tests.unit.cia402.rig import Rig

JOINT = 25
EDS = Path(__file__).parents[3] / "config" / "bus" / "joint_drive.eds"
PATIENCE_S = 30.0
PATIENCE_FRAMES = 3_000


class PatientNode(BaseNode402):
    TIMEOUT_RESET_FAULT = 0.05  # always waited out
    TIMEOUT_SWITCH_OP_MODE = TIMEOUT_SWITCH_STATE_FINAL = TIMEOUT_SWITCH_STATE_SINGLE = TIMEOUT_CHECK_TPDO = PATIENCE_S


class Foreign:
    """Network, node and the simulated drive behind them."""

    def __init__(self) -> None:
        self.rig = Rig(JOINT)
        self.network = canopen.Network(LockstepBridge(self.rig.clock, self.rig.bus))
        self.network.NOTIFIER_SHUTDOWN_TIMEOUT = PATIENCE_S
        self.node = self.network.add_node(PatientNode(JOINT, str(EDS)))
        self.node.sdo.RESPONSE_TIMEOUT = PATIENCE_S
        self.booted = threading.Event()
        self.network.subscribe(0x700 + JOINT, lambda can_id, data, timestamp: self.booted.set())
        self.network.connect()

    def start(self) -> None:
        """Operational, SYNC and cyclic RPDO, targets seeded."""
        node = self.node
        node.setup_402_state_machine()
        node.rpdo[1]["Target position"].raw = node.sdo["Position actual value"].raw
        node.nmt.state = "OPERATIONAL"
        self.network.sync.start(0.01)
        node.rpdo[1].start(0.01)
        node.check_statusword()

    def until(self, condition: Callable[[], bool]) -> None:
        for _ in range(PATIENCE_FRAMES):
            if condition():
                return
            self.node.check_statusword()
        pytest.fail(f"not within {PATIENCE_FRAMES} TPDOs; statusword {self.node.statusword:04X}h")

    def position(self) -> int:
        return int(self.node.tpdo[1]["Position actual value"].raw)

    def move_to(self, target: int) -> None:
        self.node.rpdo[1]["Target position"].raw = target
        self.until(lambda: abs(self.position() - target) < 300)


@pytest.fixture
def foreign() -> Iterator[Foreign]:
    foreign = Foreign()
    assert foreign.booted.wait(PATIENCE_S)
    try:
        yield foreign
    finally:
        foreign.network.disconnect()


def test_it_finds_and_identifies_the_drive(foreign: Foreign) -> None:
    node = foreign.node
    assert node.sdo[0x1000].raw & 0xFFFF == 402
    assert node.sdo[0x1008].raw == "joint drive"  # 11 bytes: segmented
    assert node.sdo["Identity"]["Product code"].raw == 1
    node.sdo["Following error window"].raw = 70_000
    assert node.sdo[0x6065].raw == 70_000


def test_it_gets_the_abort_codes(foreign: Foreign) -> None:
    node = foreign.node
    for index, value, code in ((0x6041, 1, 0x0601_0002), (0x6060, 3, 0x0609_0030), (0x6098, 1, 0x0609_0030)):
        with pytest.raises(canopen.SdoAbortedError) as refused:
            node.sdo[index].raw = value
        assert refused.value.code == code


@pytest.mark.slow
def test_every_object_of_the_eds_can_be_read_or_says_why_not(foreign: Foreign) -> None:
    node = foreign.node
    refusals = set()
    read = 0
    for entry in node.object_dictionary.values():
        variables = [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else list(entry.values())
        for variable in variables:
            access = node.sdo[variable.index]
            try:
                assert (access if variable is entry else access[variable.subindex]).raw is not None
                read += 1
            except canopen.SdoAbortedError as refused:
                refusals.add((variable.index, refused.code))
    assert refusals == {(0x1003, 0x0800_0024)}  # an empty history has no entries
    assert read > 100


def test_it_enables_and_moves_the_drive(foreign: Foreign) -> None:
    foreign.start()
    foreign.node.state = "OPERATION ENABLED"
    begin = foreign.position()
    assert begin == pytest.approx(500_000, abs=50)
    foreign.move_to(700_000)
    foreign.move_to(300_000)
    assert foreign.rig.plant.position[0] == pytest.approx(0.3, abs=1e-3)
    foreign.node.state = "SWITCH ON DISABLED"
    foreign.until(lambda: not foreign.rig.plant.command.any())


def test_it_changes_modes_and_homes(foreign: Foreign) -> None:
    foreign.start()
    node = foreign.node
    node.sdo["Home offset"].raw = 50_000
    assert node.homing(timeout=PATIENCE_S)
    foreign.until(lambda: abs(foreign.position() - 50_000) < 100)
    node.op_mode = "CYCLIC SYNCHRONOUS POSITION"
    assert node.op_mode == "CYCLIC SYNCHRONOUS POSITION"


def test_it_quick_stops_and_goes_on(foreign: Foreign) -> None:
    foreign.start()
    node = foreign.node
    node.sdo["Quick stop option code"].raw = 6
    node.state = "OPERATION ENABLED"
    node.rpdo[1]["Target position"].raw = 2_500_000
    foreign.until(lambda: foreign.position() > 700_000)
    node.state = "QUICK STOP ACTIVE"
    foreign.until(lambda: bool(node.statusword & 0x400))
    place = foreign.position()
    node.rpdo[1]["Target position"].raw = place
    node.state = "OPERATION ENABLED"
    foreign.until(lambda: abs(foreign.position() - place) < 100)


def test_it_hears_of_a_fault_and_recovers_without_power_cycle(foreign: Foreign) -> None:
    foreign.start()
    node = foreign.node
    node.state = "OPERATION ENABLED"
    heard = threading.Event()
    node.emcy.add_callback(lambda error: heard.set() if error.code == 0x8611 else None)
    foreign.rig.plant.blocked[0] = True
    node.rpdo[1]["Target position"].raw = 1_000_000
    assert heard.wait(PATIENCE_S)
    foreign.until(node.is_faulted)
    foreign.rig.plant.blocked[0] = False
    node.rpdo[1]["Target position"].raw = foreign.position()
    # the package raises bit 7 only together with its way up: give it the falling edge first
    node.reset_from_fault()
    assert node.state == "OPERATION ENABLED"
    foreign.move_to(600_000)


def test_it_remaps_a_pdo(foreign: Foreign) -> None:
    node = foreign.node
    node.tpdo.read()
    pdo = node.tpdo[3]
    pdo.clear()
    pdo.add_variable("Following error actual value")
    pdo.add_variable("Modes of operation display")
    pdo.trans_type, pdo.enabled = 1, True
    pdo.save()
    pdo.subscribe()
    foreign.start()
    assert pdo.wait_for_reception(PATIENCE_S) is not None
    assert pdo["Modes of operation display"].raw == 8
    assert len(pdo.data) == 5


def test_drive_stops_when_it_dies(foreign: Foreign) -> None:
    foreign.start()
    foreign.node.state = "OPERATION ENABLED"
    foreign.node.rpdo[1]["Target position"].raw = 2_500_000
    foreign.until(lambda: foreign.position() > 700_000)
    foreign.node.rpdo[1].stop()
    foreign.until(lambda: foreign.node.state == "SWITCH ON DISABLED")
    assert abs(foreign.rig.plant.velocity[0]) < 0.05
