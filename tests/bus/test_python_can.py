"""The bus over python-can: who hears what, in which order, and what is said when there is no bus. No kernel needed: interface `virtual`."""

from __future__ import annotations

import socket

import can
import pytest

from drivers.bus.carrier import BusError
from drivers.bus.python_can import PythonCanBus
from drivers.frame import Frame, bit_length

URL = "virtual:test_python_can"


class Time:
    def __init__(self) -> None:
        self.ns = 0

    def __call__(self) -> int:
        return self.ns


@pytest.fixture
def bus():
    time = Time()
    made = PythonCanBus(URL, time, bitrate=500_000)
    made.time = time
    yield made
    made.close()


@pytest.fixture
def stranger():
    with can.Bus(interface="virtual", channel="test_python_can") as other:
        yield other


def listener(bus, name, can_ids=None):
    heard: list[Frame] = []
    return bus.attach(name, can_ids, heard.append), heard


def pump(bus) -> None:
    while (t_ns := bus.first_ns()) is not None:
        bus.hand_out(t_ns)


def test_nodes_of_one_process_hear_each_other_and_never_themselves(bus):
    a, heard_a = listener(bus, "a")
    _, heard_b = listener(bus, "b", [0x181])
    bus.time.ns = 700
    assert a.send(0x181, b"\x01")
    assert a.send(0x182, b"\x02")
    pump(bus)
    assert heard_a == []
    assert heard_b == [Frame(0x181, b"\x01", 700)]


def test_delivered_is_the_order_of_the_wire_with_strangers_among_it(bus, stranger):
    a, heard_a = listener(bus, "a")
    _, heard_b = listener(bus, "b")
    observed: list[Frame] = []
    bus.observe(observed.append)
    a.send(0x100, b"\x01")
    stranger.send(can.Message(arbitration_id=0x100, data=b"\x02", is_extended_id=False))
    a.send(0x100, b"\x03")
    pump(bus)
    assert [frame.data for frame in observed] == [b"\x01", b"\x02", b"\x03"]
    assert [frame.data for frame in heard_b] == [b"\x01", b"\x02", b"\x03"]
    assert [frame.data for frame in heard_a] == [b"\x02"]
    assert stranger.recv(0).data == b"\x01"


def test_a_stranger_with_the_same_frame_as_ours_is_heard_once(bus, stranger):
    a, heard = listener(bus, "a")
    a.send(0x701, b"\x05")
    stranger.send(can.Message(arbitration_id=0x701, data=b"\x05", is_extended_id=False))
    pump(bus)
    assert len(heard) == 1, "a second node with our id has to be noticed"


def test_what_is_no_standard_data_frame_is_ignored_and_errors_are_counted(bus, stranger):
    _, heard = listener(bus, "a")
    for message in (
        can.Message(arbitration_id=0x100, is_extended_id=True),
        can.Message(arbitration_id=0x100, is_extended_id=False, is_remote_frame=True),
        can.Message(is_error_frame=True),
        can.Message(arbitration_id=0x123, data=b"\x09", is_extended_id=False),
    ):
        stranger.send(message)
    pump(bus)
    assert heard == [Frame(0x123, b"\x09", 0)]
    assert bus.statistics().error_frames == 1


def test_a_frame_that_the_interface_does_not_take_is_refused_and_counted(bus):
    a, _ = listener(bus, "a")
    bus.close()
    assert not a.send(0x181, b"")
    assert bus.statistics().refused == {"a": 1}
    assert bus.statistics().frames_lost == 1
    with pytest.raises(BusError, match="gone away"):
        bus.first_ns()


def test_load_is_the_exact_length_of_the_frames_at_the_bit_rate(bus):
    a, _ = listener(bus, "a")
    for data in (b"", b"\x00" * 8, bytes(range(8))):
        a.send(0x080, data)
    pump(bus)
    bits = sum(bit_length(0x080, data) for data in (b"", b"\x00" * 8, bytes(range(8))))
    bus.time.ns = 1_000_000
    statistics = bus.statistics()
    assert (statistics.frames, statistics.bits) == (3, bits)
    assert statistics.load_mean == pytest.approx(bits * 2000 / 1e6)


def test_names_differ_and_frames_are_checked(bus):
    a, _ = listener(bus, "a")
    with pytest.raises(ValueError, match="'a' is taken"):
        listener(bus, "a")
    with pytest.raises(ValueError, match="0x800"):
        a.send(0x800, b"")


@pytest.mark.parametrize(
    ("url", "part"),
    [
        ("vcan0", "interface:channel"),
        ("socketcan:", "interface:channel"),
        ("socketcn:vcan0", "no interface 'socketcn'"),
        ("socketcan:no_such_bus", "cannot be opened"),
        ("slcan:/dev/no_such_line", "cannot be opened"),
    ],
)
def test_a_bus_that_cannot_be_had_is_one_clear_line(url, part, capfd):
    with pytest.raises(BusError) as caught:
        PythonCanBus(url, Time())
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", ""), "python-can's own words would be a second line"


def test_a_kernel_without_can_says_so():
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
        pytest.skip("this kernel has CAN")
    except OSError:
        pass
    with pytest.raises(BusError, match="no CAN sockets"):
        PythonCanBus("socketcan:vcan0", Time())
