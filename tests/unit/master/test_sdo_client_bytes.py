"""The bytes of the SDO client, against examples of CiA 301 and of drive makers' manuals, not against our own server."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from drivers.canopen.sdo_abort import SdoAborted, SdoTimeout, StepError
from drivers.canopen.sdo_client import SdoClient
from drivers.clock import LockstepClock
from drivers.frame import Frame

MS = 1_000_000


class Server:
    """The other end of the wire, played by hand: what the client sent, and what it got for its requests."""

    def __init__(self, attempts: int = 3) -> None:
        self.clock = LockstepClock()
        self.sent: list[str] = []
        self.results: list[bytes | StepError] = []
        self.accepts = True
        self.client = SdoClient(0x17, self._take, self.clock, timeout_ns=100 * MS, attempts=attempts)

    def _take(self, can_id: int, data: bytes) -> bool:
        assert can_id == 0x617
        if self.accepts:
            self.sent.append(data.hex(" "))
        return self.accepts

    def answer(self, data: str) -> None:
        self.client.on_frame(Frame(0x597, bytes.fromhex(data), self.clock.now_ns()))

    def run(self, milliseconds: float) -> None:
        self.clock.run_until(self.clock.now_ns() + round(milliseconds * MS))


@pytest.mark.parametrize(
    ("answer", "value"),
    [
        ("4f 60 60 00 08 00 00 00", "08"),
        ("4b 41 60 00 37 06 00 00", "37 06"),
        ("47 00 20 01 01 02 03 00", "01 02 03"),
        ("43 18 10 01 44 33 22 11", "44 33 22 11"),
        ("42 18 10 01 44 33 22 11", "44 33 22 11"),  # size not indicated
    ],
)
def test_expedited_upload(answer: str, value: str) -> None:
    server = Server()
    raw = bytes.fromhex(answer)
    server.client.upload(int.from_bytes(raw[1:3], "little"), raw[3], server.results.append)
    assert server.sent == ["40" + answer[2:11] + " 00 00 00 00"]
    server.answer(answer)
    assert server.results == [bytes.fromhex(value)]
    assert server.client.idle


@pytest.mark.parametrize(
    ("index", "data", "request_bytes"),
    [
        (0x6060, "08", "2f 60 60 00 08 00 00 00"),
        (0x1017, "e8 03", "2b 17 10 00 e8 03 00 00"),
        (0x2000, "01 02 03", "27 00 20 00 01 02 03 00"),
        (0x607A, "40 42 0f 00", "23 7a 60 00 40 42 0f 00"),
    ],
)
def test_expedited_download(index: int, data: str, request_bytes: str) -> None:
    server = Server()
    server.client.download(index, 0, bytes.fromhex(data), server.results.append)
    assert server.sent == [request_bytes]
    server.answer("60" + request_bytes[2:11] + " 00 00 00 00")
    assert server.results == [b""]


SIXTEEN = bytes(range(1, 17))


def test_segmented_download() -> None:
    """Sixteen bytes in three segments, the trace of a drive maker's manual (STÖBER SD6, CANopen, SDO examples)."""
    server = Server()
    server.client.download(0x2345, 1, SIXTEEN, server.results.append)
    server.answer("60 45 23 01 00 00 00 00")
    server.answer("20 00 00 00 00 00 00 00")
    server.answer("30 00 00 00 00 00 00 00")
    assert server.results == []
    server.answer("20 00 00 00 00 00 00 00")
    assert server.sent == [
        "21 45 23 01 10 00 00 00",
        "00 01 02 03 04 05 06 07",
        "10 08 09 0a 0b 0c 0d 0e",
        "0b 0f 10 00 00 00 00 00",
    ]
    assert server.results == [b""]


def test_segmented_upload() -> None:
    server = Server()
    server.client.upload(0x2345, 1, server.results.append)
    server.answer("41 45 23 01 10 00 00 00")
    server.answer("00 01 02 03 04 05 06 07")
    server.answer("10 08 09 0a 0b 0c 0d 0e")
    server.answer("0b 0f 10 00 00 00 00 00")
    assert server.sent == [
        "40 45 23 01 00 00 00 00",
        "60 00 00 00 00 00 00 00",
        "70 00 00 00 00 00 00 00",
        "60 00 00 00 00 00 00 00",
    ]
    assert server.results == [SIXTEEN]


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("00 00 02 06", "object does not exist"),
        ("11 00 09 06", "subindex does not exist"),
        ("02 00 01 06", "read-only"),
        ("22 00 00 08", "present device state"),
    ],
)
def test_abort_by_the_server_is_told_in_words(code: str, text: str) -> None:
    server = Server()
    server.client.upload(0x1018, 9, server.results.append)
    server.answer("80 18 10 09 " + code)
    (error,) = server.results
    assert isinstance(error, SdoAborted)
    assert (error.code, error.index, error.subindex) == (int.from_bytes(bytes.fromhex(code), "little"), 0x1018, 9)
    assert text in error.text
    assert "1018h sub 9" in str(error)
    assert len(server.sent) == 1  # an abort is not answered, and not tried again


def begin_upload(server: Server) -> None:
    server.client.upload(0x2345, 1, server.results.append)
    server.answer("41 45 23 01 10 00 00 00")


def begin_download(server: Server) -> None:
    server.client.download(0x2345, 1, SIXTEEN, server.results.append)
    server.answer("60 45 23 01 00 00 00 00")


@pytest.mark.parametrize(
    ("begin", "answers", "abort"),
    [
        (begin_upload, ["10 01 02 03 04 05 06 07"], "00 00 03 05"),  # toggle bit not alternated
        (begin_upload, ["00 01 02 03 04 05 06 07", "00 01 02 03 04 05 06 07"], "00 00 03 05"),
        (begin_download, ["30 00 00 00 00 00 00 00"], "00 00 03 05"),
        (begin_upload, ["0b 01 02 00 00 00 00 00"], "10 00 07 06"),  # two bytes, sixteen were announced
        (begin_upload, ["60 45 23 01 00 00 00 00"], "01 00 04 05"),  # command specifier of a download
        (begin_download, ["00 01 02 03 04 05 06 07"], "01 00 04 05"),
    ],
)
def test_broken_protocol_is_aborted_by_the_client(
    begin: Callable[[Server], None], answers: list[str], abort: str
) -> None:
    server = Server()
    begin(server)
    for answer in answers:
        server.answer(answer)
    assert server.sent[-1] == "80 45 23 01 " + abort
    (error,) = server.results
    assert isinstance(error, SdoAborted)
    assert error.code == int.from_bytes(bytes.fromhex(abort), "little")


def test_silence_is_an_abort_to_the_server_a_retry_and_in_the_end_a_timeout() -> None:
    server = Server(attempts=3)
    server.client.upload(0x1018, 1, server.results.append)
    server.run(299)
    assert server.results == []
    server.run(2)
    request, abort = "40 18 10 01 00 00 00 00", "80 18 10 01 00 00 04 05"
    assert server.sent == [request, abort] * 3
    (error,) = server.results
    assert isinstance(error, SdoTimeout)
    assert (error.attempts, error.index, error.subindex) == (3, 0x1018, 1)
    server.run(1000)
    assert len(server.sent) == 6


def test_retry_gets_its_answer_and_the_late_one_of_the_first_attempt_harms_nothing() -> None:
    server = Server()
    begin_upload(server)
    server.answer("00 01 02 03 04 05 06 07")
    server.run(101)  # the second segment got lost: again from the start
    assert server.sent[-1] == "40 45 23 01 00 00 00 00"
    server.answer("10 08 09 0a 0b 0c 0d 0e")  # the lost one, late; belongs to nothing
    server.answer("41 45 23 01 10 00 00 00")
    server.answer("41 45 23 01 10 00 00 00")  # once more: late too
    server.answer("00 01 02 03 04 05 06 07")
    server.answer("10 08 09 0a 0b 0c 0d 0e")
    server.answer("0b 0f 10 00 00 00 00 00")
    assert server.results == [SIXTEEN]
    assert server.client.ignored == 2


def test_every_segment_has_its_own_timeout() -> None:
    server = Server()
    begin_upload(server)
    for answer in ("00 01 02 03 04 05 06 07", "10 08 09 0a 0b 0c 0d 0e", "0b 0f 10 00 00 00 00 00"):
        server.run(90)
        server.answer(answer)
    assert server.results == [SIXTEEN]


def test_requests_wait_for_each_other() -> None:
    server = Server()
    server.client.upload(0x1018, 1, server.results.append)
    server.client.download(0x6060, 0, b"\x08", server.results.append)
    assert server.sent == ["40 18 10 01 00 00 00 00"]
    server.answer("60 60 60 00 00 00 00 00")  # nobody asked that yet
    assert server.results == []
    server.answer("43 18 10 01 01 00 00 00")
    assert server.sent[1:] == ["2f 60 60 00 08 00 00 00"]
    server.answer("60 60 60 00 00 00 00 00")
    assert server.results == [b"\x01\0\0\0", b""]


def test_frame_that_the_port_refuses_is_offered_again() -> None:
    server = Server()
    server.accepts = False
    server.client.upload(0x1018, 1, server.results.append)
    server.run(5.5)
    assert server.sent == []
    assert server.client.refused == 6
    server.accepts = True
    server.run(1)
    assert server.sent == ["40 18 10 01 00 00 00 00"]
    server.run(20)
    assert len(server.sent) == 1


def test_cancel_tells_the_server_and_nobody_else() -> None:
    server = Server()
    begin_upload(server)
    server.client.upload(0x1018, 1, server.results.append)
    server.client.cancel()
    assert server.sent[-1] == "80 45 23 01 00 00 00 08"
    count = len(server.sent)
    server.run(500)
    assert server.results == []
    assert len(server.sent) == count
    server.client.upload(0x1000, 0, server.results.append)
    server.answer("43 00 10 00 92 01 02 00")
    assert server.results == [bytes.fromhex("92 01 02 00")]


def test_frames_that_are_no_sdo_are_ignored() -> None:
    server = Server()
    server.answer("43 18 10 01 01 00 00 00")  # unasked
    server.client.upload(0x1018, 1, server.results.append)
    server.answer("43 18 10 01 01 00 00")  # seven bytes
    server.answer("80 18 10 02 00 00 02 06")  # abort of another object
    assert server.results == []
    assert server.client.ignored == 3


def test_the_late_answer_to_a_write_is_not_taken_for_that_to_the_reading_back() -> None:
    """Written twice because the first answer was late: its second answer comes when the object is read already."""
    server = Server()
    server.client.download(0x2100, 0, bytes.fromhex("b8 0b"), server.results.append)
    server.client.upload(0x2100, 0, server.results.append)
    server.run(100)
    assert server.sent == ["2b 00 21 00 b8 0b 00 00", "80 00 21 00 00 00 04 05", "2b 00 21 00 b8 0b 00 00"]
    server.answer("60 00 21 00 00 00 00 00")
    assert server.sent[-1] == "40 00 21 00 00 00 00 00"
    server.answer("60 00 21 00 00 00 00 00")
    assert server.client.ignored == 1
    server.answer("4b 00 21 00 b8 0b 00 00")
    assert server.results == [b"", bytes.fromhex("b8 0b")]


def test_the_late_answer_to_a_read_is_not_taken_for_that_to_the_write() -> None:
    server = Server()
    server.client.upload(0x2100, 0, server.results.append)
    server.client.download(0x2100, 0, bytes.fromhex("b8 0b"), server.results.append)
    server.run(100)
    server.answer("4b 00 21 00 00 00 00 00")
    server.answer("4b 00 21 00 00 00 00 00")
    assert server.client.ignored == 1
    server.answer("60 00 21 00 00 00 00 00")
    assert server.results == [bytes(2), b""]
