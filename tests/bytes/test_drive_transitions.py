"""The power state machine of a drive as frames: every state with every command, wrong frames, refusals, its error history.

Statuswords and controlwords are those of CiA 402 (bit patterns as in vendors' manuals), written out here.
"""

from __future__ import annotations

import struct

import pytest

from tests.unit.cia402.rig import MS, Master, Rig

JOINT, WHEEL = 25, 11
COMMANDS = {
    "shutdown": 0x06,
    "switch on": 0x07,
    "enable": 0x0F,
    "disable voltage": 0x00,
    "quick stop": 0x02,
    "fault reset": 0x80,
}
PATTERNS = {
    "switch on disabled": (0x4F, 0x40),
    "ready": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "enabled": (0x6F, 0x27),
    "quick stop": (0x6F, 0x07),
    "fault": (0x4F, 0x08),
}
WAYS: dict[str, tuple[int, ...]] = {
    "switch on disabled": (),
    "ready": (0x06,),
    "switched on": (0x06, 0x07),
    "enabled": (0x06, 0x07, 0x0F),
    "quick stop": (0x06, 0x07, 0x0F, 0x02),
    "fault": (0x06, 0x07, 0x0F),
}
"""Controlwords on the way there; the fault is a blocked axis besides."""
EXPECTED = {
    "switch on disabled": {"shutdown": "ready"},
    "ready": {
        "switch on": "switched on",
        "enable": "enabled",  # by way of switched on
        "disable voltage": "switch on disabled",
        "quick stop": "switch on disabled",
        "fault reset": "switch on disabled",  # 80h is disable voltage as well
    },
    "switched on": {
        "shutdown": "ready",
        "enable": "enabled",
        "disable voltage": "switch on disabled",
        "quick stop": "switch on disabled",
        "fault reset": "switch on disabled",
    },
    "enabled": {
        "shutdown": "ready",
        "switch on": "switched on",
        "disable voltage": "switch on disabled",
        "quick stop": "quick stop",
        "fault reset": "switch on disabled",
    },
    "quick stop": {
        "enable": "enabled",
        "disable voltage": "switch on disabled",
        "fault reset": "switch on disabled",
    },
    "fault": {"fault reset": "switch on disabled"},
}
"""CiA 402, transitions 2 to 12, 15, 16; what is not here stays."""


def state_of(master: Master) -> str:
    """What the statusword in TPDO1 shows."""
    word = struct.unpack("<Hih", master.rig.sent(0x180 + JOINT)[-1])[0]
    (found,) = [name for name, (mask, value) in PATTERNS.items() if word & mask == value]
    return found


def brought_to(state: str) -> tuple[Rig, Master]:
    rig = Rig(JOINT, defaults={(0x605A, 0): 6})  # stays in quick stop active
    master = Master(rig)
    rig.run(20 * MS)
    master.nmt(1)
    rig.run(30 * MS)
    for word in WAYS[state]:
        master.command(word)
    if state == "fault":
        master.follow = False
        rig.plant.blocked[0] = True
        master.target[JOINT] += 1_000_000
        rig.run(600 * MS)
        rig.plant.blocked[0] = False
        master.follow = True
        rig.run(30 * MS)
    assert state_of(master) == state
    return rig, master


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("state", WAYS)
def test_every_state_with_every_command_in_an_rpdo(state: str, command: str) -> None:
    rig, master = brought_to(state)
    master.command(COMMANDS[command], cycles=20)  # 605Ch: a ramp comes before «disable operation»
    assert state_of(master) == EXPECTED[state].get(command, state)
    powered = state_of(master) in ("enabled", "quick stop")
    assert powered or not rig.plant.command.any(), "no torque without power"


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("state", WAYS)
def test_every_state_with_every_command_by_sdo(state: str, command: str) -> None:
    _, master = brought_to(state)
    master.sends_rpdo = False  # ten periods without one are a loss of communication: the answer comes before that
    master.rig.run(15 * MS)  # the last one is applied with the next SYNC
    assert master.write(JOINT, 0x6040, 0, struct.pack("<H", COMMANDS[command])) == 0
    master.rig.run(40 * MS)
    assert state_of(master) == EXPECTED[state].get(command, state)


@pytest.mark.parametrize("data", ["", "0F", "0F00", "0F00000000 0000", "0F 00 00 00 00 00 00"])
def test_enable_in_a_frame_that_is_too_short_enables_nothing(data: str) -> None:
    rig, master = brought_to("switched on")
    master.sends_rpdo = False
    for _ in range(5):
        master.port.send(0x200 + JOINT, bytes.fromhex(data))
        rig.run(10 * MS)
    assert state_of(master) == "switched on"
    code, register = struct.unpack_from("<HB", rig.sent(0x080 + JOINT)[-1])
    assert (code, register & 0x11) == (0x8210, 0x11), "PDO not processed: length error; generic and communication"


def test_frames_for_pdos_that_are_off_move_nothing() -> None:
    rig, master = brought_to("switched on")
    for base in (0x300, 0x400, 0x500):
        master.port.send(base + JOINT, bytes.fromhex("0F00 00000000 0000"))
    rig.run(50 * MS)
    assert state_of(master) == "switched on"
    assert rig.sent(0x080 + JOINT) == []


@pytest.mark.parametrize(
    ("request_hex", "code"),
    [
        ("2B 41 60 00 01 00 00 00", 0x0601_0002),  # statusword: read only
        ("23 00 10 00 01 00 00 00", 0x0601_0002),  # device type: constant
        ("40 FF 5F 00 00 00 00 00", 0x0602_0000),  # no such object
        ("40 7D 60 03 00 00 00 00", 0x0609_0011),  # no such sub-index
        ("2F 40 60 00 0F 00 00 00", 0x0607_0013),  # one byte for two
        ("23 40 60 00 0F 00 00 00", 0x0607_0012),  # four bytes for two
        ("2F 60 60 00 03 00 00 00", 0x0609_0030),  # profile velocity: not in 6502h
        ("23 7F 60 00 00 00 00 00", 0x0609_0032),  # no speed at all
        ("23 7D 60 02 00 00 00 80", 0x0609_0036),  # upper limit below the lower one
        ("2B 5A 60 00 03 00 00 00", 0x0609_0030),  # quick stop at the current limit: not supported
        ("23 00 16 01 10 00 41 60", 0x0601_0000),  # mapping of a PDO that is valid
        ("E0 00 00 00 00 00 00 00", 0x0504_0001),  # no such command
    ],
)
def test_refusals_have_their_codes_and_change_nothing(request_hex: str, code: int) -> None:
    _, master = brought_to("enabled")
    request = bytes.fromhex(request_hex)
    reply = master.sdo(JOINT, request)
    assert reply[0] == 0x80
    assert reply[1:4] == request[1:4]
    assert struct.unpack_from("<I", reply, 4)[0] == code
    master.rig.run(20 * MS)
    assert state_of(master) == "enabled"


def test_history_of_a_fault_is_kept_until_zero_is_written() -> None:
    rig, master = brought_to("fault")
    emergencies = [struct.unpack_from("<HB", data) for data in rig.sent(0x080 + JOINT)]
    assert emergencies[0][0] == 0x8611
    assert emergencies[0][1] & 0x21 == 0x21, "generic, and of the profile"
    assert master.read(JOINT, 0x1003, 0) == b"\x01"
    assert struct.unpack("<I", master.read(JOINT, 0x1003, 1))[0] & 0xFFFF == 0x8611
    assert struct.unpack("<H", master.read(JOINT, 0x603F))[0] == 0x8611
    master.command(0x00)
    master.command(0x80)
    assert state_of(master) == "switch on disabled"
    assert struct.unpack_from("<H", rig.sent(0x080 + JOINT)[-1])[0] == 0, "error reset"
    assert master.read(JOINT, 0x1003, 0) == b"\x01", "the history outlasts the fault"
    assert master.write(JOINT, 0x1003, 0, b"\x01") == 0x0609_0030
    assert master.write(JOINT, 0x1003, 0, b"\x00") == 0
    assert master.read(JOINT, 0x1003, 0) == b"\x00"


def test_sync_with_a_counter_when_1019_says_so() -> None:
    """A drive takes the SYNC that it was told to expect; the other kind is 8240h and moves nothing."""
    rig = Rig(JOINT, defaults={(0x1019, 0): 10, (0x1800, 6): 3})  # TPDO1 begins with counter 3
    master = Master(rig)
    master.alive = False
    rig.run(20 * MS)
    master.nmt(1)
    for counter in (1, 2, 3, 4):
        master.port.send(0x080, bytes([counter]))
        rig.run(5 * MS)
        assert len(rig.sent(0x180 + JOINT)) == max(0, counter - 2)
    before = len(rig.sent(0x180 + JOINT))
    master.port.send(0x080, b"")
    rig.run(5 * MS)
    assert len(rig.sent(0x180 + JOINT)) == before
    assert struct.unpack_from("<H", rig.sent(0x080 + JOINT)[-1])[0] == 0x8240
