"""SDO server against the byte sequences of CiA 301 and of vendors' manuals (source with each)."""

from __future__ import annotations

import pytest

from drivers.canopen.nmt import NmtState
from tests.unit.canopen.bench import MS, NODE, Bench


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_expedited_upload_of_every_length(bench: Bench) -> None:
    # CiA 301: response 4Fh one byte, 4Bh two, 47h three, 43h four
    assert bench.sdo("4005200000000000") == "4F05200032000000"
    assert bench.sdo("4000200000000000") == "4B00200000000000"
    assert bench.sdo("4003200000000000") == "4703200000000000"
    assert bench.sdo("4006200000000000") == "4306200007000000"


def test_expedited_download_of_every_length(bench: Bench) -> None:
    # CiA 301: request 2Fh one byte, 2Bh two, 27h three, 23h four, 22h without size
    assert bench.sdo("2F05200064000000") == "6005200000000000"
    assert bench.sdo("2B002000FEFF0000") == "6000200000000000"
    assert bench.sdo("27032000FFFFFF00") == "6003200000000000"
    assert bench.sdo("230A2001785634 12".replace(" ", "")) == "600A200100000000"
    assert bench.sdo("22002000010000 00".replace(" ", "")) == "6000200000000000"
    dictionary = bench.node.dictionary
    assert [dictionary.get(*key) for key in ((0x2005, 0), (0x2003, 0), (0x200A, 1), (0x2000, 0))] == [
        100,
        -1,
        0x12345678,
        1,
    ]


def test_segmented_upload_as_in_the_manual_of_nanotec(bench: Bench) -> None:
    """PD4-E manual, chapter on segmented transfer: 17 bytes "FIR-v1748-B538662" (there of 100Ah)."""
    assert bench.sdo("4008100000000000") == "4108100011000000"
    assert bench.sdo("6008100000000000") == "004649522D763137"
    assert bench.sdo("7008100000000000") == "1034382D42353338"
    assert bench.sdo("6008100000000000") == "0936363200000000"


def test_segmented_upload_of_a_real64(bench: Bench) -> None:
    assert bench.sdo("4002200000000000") == "4102200008000000"
    assert bench.sdo("6000000000000000") == "00000000000000D0"  # 0.25 = 3FD0 0000 0000 0000h
    assert bench.sdo("7000000000000000") == "1D3F000000000000"


def test_segmented_download(bench: Bench) -> None:
    # "hello world", 11 bytes: 7 and 4 (n = 3, last)
    assert bench.sdo("210820000B000000") == "6008200000000000"
    assert bench.sdo("0068656C6C6F2077") == "2000000000000000"
    assert bench.sdo("176F726C64000000") == "3000000000000000"
    assert bench.node.dictionary.get(0x2008) == "hello world"


def test_segmented_download_without_announced_size(bench: Bench) -> None:
    assert bench.sdo("2008200000000000") == "6008200000000000"
    assert bench.sdo("0B414200 00000000".replace(" ", "")) == "2000000000000000"
    assert bench.node.dictionary.get(0x2008) == "AB"


@pytest.mark.parametrize(
    ("request_hex", "code"),
    [
        ("4000300000000000", "00000206"),  # 0602 0000h no such object
        ("40052001000000 00", "11000906"),  # 0609 0011h no such subindex
        ("4007200000000000", "01000106"),  # 0601 0001h write-only
        ("2306200001000000", "02000106"),  # 0601 0002h read-only
        ("2F08100041000000", "02000106"),  # constant
        ("2B05200001000000", "12000706"),  # 0607 0012h too long
        ("2F00200001000000", "13000706"),  # 0607 0013h too short
        ("2F05200065000000", "31000906"),  # 0609 0031h value too high
        ("230120000000C07F", "30000906"),  # 0609 0030h: NaN
        ("230120000000807F", "30000906"),  # infinity
        ("A000100020000000", "01000405"),  # 0504 0001h: block upload
        ("C208200010000000", "01000405"),  # block download
        ("E000000000000000", "01000405"),  # no such command
        ("6000000000000000", "01000405"),  # a segment of nothing
        ("0000000000000000", "01000405"),
    ],
)
def test_refusals_have_the_codes_of_the_standard(bench: Bench, request_hex: str, code: str) -> None:
    request = request_hex.replace(" ", "")
    assert bench.sdo(request) == "80" + request[2:8] + code


def test_toggle_bit_that_does_not_alternate_aborts(bench: Bench) -> None:
    bench.sdo("4008100000000000")
    bench.sdo("6008100000000000")
    assert bench.sdo("6008100000000000") == "8008100000000305"
    assert bench.sdo("7000000000000000") == "8000000001000405"  # nothing is under way any more


def test_toggle_bit_of_a_download(bench: Bench) -> None:
    bench.sdo("210820000B000000")
    assert bench.sdo("1068656C6C6F2077") == "8008200000000305"
    assert bench.node.dictionary.get(0x2008) == "x"


def test_less_than_announced_is_refused(bench: Bench) -> None:
    bench.sdo("210820000B000000")
    assert bench.sdo("0B41420000000000") == "8008200010000706"
    assert bench.node.dictionary.get(0x2008) == "x"


def test_more_than_memory_is_refused(bench: Bench) -> None:
    assert bench.sdo("2108200000000100") == "8008200005000405"


def test_silent_client_is_timed_out(bench: Bench) -> None:
    bench.sdo("4008100000000000")
    bench.heard.clear()
    bench.run(997 * MS)
    assert not bench.heard
    bench.run(5 * MS)
    assert [frame.data.hex() for frame in bench.heard] == ["8008100000000405"]


def test_every_segment_gives_the_client_new_time(bench: Bench) -> None:
    bench.sdo("4008100000000000")
    bench.run(900 * MS)
    assert bench.sdo("6008100000000000").startswith("00")
    bench.run(900 * MS)
    assert bench.sdo("7008100000000000").startswith("10")


def test_abort_of_the_client_ends_the_transfer_without_an_answer(bench: Bench) -> None:
    bench.sdo("4008100000000000")
    assert bench.tell(0x600 + NODE, "8008100000000405") == []
    bench.heard.clear()
    bench.run(1_200 * MS)
    assert not bench.heard


def test_new_request_replaces_an_unfinished_one(bench: Bench) -> None:
    bench.sdo("4008100000000000")
    assert bench.sdo("4005200000000000") == "4F05200032000000"
    bench.heard.clear()
    bench.run(1_200 * MS)
    assert not bench.heard


@pytest.mark.parametrize("request_hex", ["", "40", "40052000", "40052000000000"])
def test_request_that_is_not_eight_bytes_long_is_ignored(bench: Bench, request_hex: str) -> None:
    assert bench.tell(0x600 + NODE, request_hex) == []


def test_no_answer_while_stopped_but_in_operational(bench: Bench) -> None:
    bench.tell(0x000, "0205")
    assert bench.node.nmt.state is NmtState.STOPPED
    assert bench.tell(0x600 + NODE, "4005200000000000") == []
    bench.tell(0x000, "0105")
    assert bench.sdo("4005200000000000") == "4F05200032000000"


def test_transfer_does_not_survive_a_reset(bench: Bench) -> None:
    bench.sdo("210820000B000000")
    bench.tell(0x000, "8205")
    assert bench.sdo("0068656C6C6F2077") == "8065686C01000405".replace("65686C", "68656C")
