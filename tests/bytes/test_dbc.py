"""The DBC file, read by cantools: is it the catalogue, and do its values come out in SI units?"""

from __future__ import annotations

from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.catalogue import devices
from drivers.codec import REFERENCE, TRACKED_POSE, TWIST, WRENCH, ReferencePose
from drivers.export import dbc_files
from drivers.objects import PdoKind
from stack.messages import Mode, PlannerPhase, TrackedPose, TwistCommand, Wrench

CHECKED_IN = Path(__file__).parents[2] / "config" / "bus"
DBC = cantools.database.load_file(CHECKED_IN / "canipulator.dbc")
TABLE = devices()
PDOS = [(device, pdo) for device in TABLE.values() for pdo in device.pdos if pdo.enabled]


def test_the_checked_in_file_is_the_generated_one():
    for name, text in dbc_files().items():
        assert (CHECKED_IN / name).read_bytes() == text.encode("ascii"), "run: canipulator bus export dbc config/bus"


@pytest.mark.parametrize(("device", "pdo"), PDOS, ids=lambda part: part.name)
@given(random=st.randoms(use_true_random=False))
def test_every_process_data_frame_decodes_to_si(device, pdo, random):
    entries = [device.object(*key) for key in pdo.mapping]
    data, expected = b"", {}
    for entry in entries:
        low = -(1 << entry.data_type.bits - 1) if entry.data_type.signed else 0
        raw = random.randrange(low, low + (1 << entry.data_type.bits))
        data += raw.to_bytes(entry.data_type.bits // 8, "little", signed=entry.data_type.signed)
        name = entry.name.lower().replace(" ", "_")
        if name == "statusword":
            expected["statusword_state"] = raw & 0x7F
            expected["statusword_following_error"] = raw >> 13 & 1
        elif name == "controlword":
            expected["controlword_command"] = raw & 0xF
            expected["controlword_fault_reset"] = raw >> 7 & 1
        else:
            expected[name] = raw * entry.scale
    message = DBC.get_message_by_frame_id(pdo.cob_id)
    assert message.length == len(data)
    decoded = message.decode(data, decode_choices=False)
    for name, value in expected.items():
        assert decoded[name] == pytest.approx(value, rel=1e-12), name


SENT = [
    (TWIST, TwistCommand(np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6]), 1), ["vx", "vy", "vz", "wx", "wy", "wz"]),
    (WRENCH, Wrench(np.array([1.0, -2.0, 3.0, 0.4, -0.5, 0.6]), 1), ["fx", "fy", "fz", "mx", "my", "mz"]),
    (
        TRACKED_POSE,
        TrackedPose(np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, 0.3]), 1_230_000, 1),
        ["x", "y", "z", "rx", "ry", "rz"],
    ),
    (
        REFERENCE,
        ReferencePose(np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, 0.3]), True, 5, 1),
        ["x", "y", "z", "rx", "ry", "rz"],
    ),
]


@pytest.mark.parametrize(("codec", "message", "names"), SENT, ids=lambda part: getattr(part, "__name__", None))
def test_what_the_codec_sends_reads_the_same_in_cantools(codec, message, names):
    decoded = {}
    for can_id, data in codec.encode(message)[0]:
        decoded |= DBC.decode_message(can_id, data, decode_choices=False)
    fields = [getattr(message, name) for name in type(message).__dataclass_fields__]
    sent = np.concatenate([value for value in fields if isinstance(value, np.ndarray)])
    assert [decoded[name] for name in names] == pytest.approx(list(sent), abs=1e-9)
    assert decoded["counter"] == 1


def test_units_are_si():
    feedback = DBC.get_message_by_name("shoulder_feedback")
    assert feedback.get_signal_by_name("position_actual_value").unit == "rad"
    lift = DBC.get_message_by_name("tower_lift_feedback")
    assert lift.get_signal_by_name("position_actual_value").unit == "m"
    assert DBC.get_message_by_name("force_sensor_torque").get_signal_by_name("mx").unit == "Nm"


def test_sender_receivers_and_cycle_time():
    for device, pdo in PDOS:
        message = DBC.get_message_by_frame_id(pdo.cob_id)
        assert message.senders == ["planner" if pdo.kind is PdoKind.RPDO else device.name]
        assert message.receivers, message.name
    assert DBC.get_message_by_name("SYNC").cycle_time == 10
    assert DBC.get_message_by_name("elbow_feedback").cycle_time == 10
    assert DBC.get_message_by_name("elbow_velocity").cycle_time == 100
    assert DBC.get_message_by_name("strategic_twist_linear").cycle_time == 20
    assert DBC.get_message_by_name("elbow_heartbeat").cycle_time == 100
    assert DBC.get_message_by_name("shoulder_set_point").receivers == {"shoulder"}


@pytest.mark.parametrize(
    ("can_id", "data", "signal", "text"),
    [
        (0x000, "0100", "command", "start"),
        (0x715, "05", "state", "operational"),
        (0x702, "7F", "state", "pre-operational"),
        (0x095, "3081110000000000", "error_code", "heartbeat lost"),
        (0x195, "3716000000000000", "statusword_state", "operation enabled"),
        (0x195, "1802000000000000", "statusword_state", "fault"),
        (0x195, "5002000000000000", "statusword_state", "switch on disabled"),
        (0x215, "0600000000000000", "controlword_command", "shutdown"),
        (0x215, "0F00000000000000", "controlword_command", "enable operation"),
        (0x215, "0200000000000000", "controlword_command", "quick stop"),
        (0x295, "0000000008", "modes_of_operation_display", "cyclic synchronous position"),
    ],
)
def test_values_have_names(can_id, data, signal, text):
    assert str(DBC.decode_message(can_id, bytes.fromhex(data))[signal]) == text


def test_modes_and_phases_have_the_names_of_the_stack():
    mode = DBC.get_message_by_name("strategic_mission").get_signal_by_name("mode")
    assert {value: str(name) for value, name in mode.choices.items()} == {m.value: m.name.lower() for m in Mode}
    phase = DBC.get_message_by_name("planner_state").get_signal_by_name("phase")
    assert {value: str(name) for value, name in phase.choices.items()} == {
        p.value: p.name.lower() for p in PlannerPhase
    }


def test_service_frames_are_there_for_every_node():
    for node_id in TABLE:
        for base in (0x080, 0x580, 0x600, 0x700):
            assert DBC.get_message_by_frame_id(base + node_id)
    decoded = DBC.decode_message(0x615, bytes.fromhex("4001100100000000"))
    assert (decoded["index"], decoded["subindex"]) == (0x1001, 1)
