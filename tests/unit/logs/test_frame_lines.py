"""Frames in words: nothing is lost against the reader of single frames, and what is looked for is found."""

from __future__ import annotations

from drivers.frame import Frame
from logs.frame_batch import FrameBatch
from logs.frame_lines import FrameLineWriter
from logs.frame_text import FrameReader
from tests.unit.logs.synthetic_run import DEVICES, PERIOD_NS, Motion, Wire

SDO = Frame(0x602, bytes.fromhex("2F01200003000000"), 5)
EMCY = Frame(0x099, bytes.fromhex("1023030000000000"), 6)


def lines_of(frames: list[Frame]) -> dict[str, list[str]]:
    writer = FrameLineWriter(DEVICES.values())
    return {line.path: line.texts for line in writer.lines(FrameBatch.of(frames))}


def test_every_frame_but_sync_has_its_line_with_its_bytes(run: Motion) -> None:
    frames = [frame for k in range(20) for frame in Wire(run).cycle(k)]
    lines = lines_of(frames)
    texts = [text for some in lines.values() for text in some]
    others = [frame for frame in frames if frame.can_id != 0x080]
    assert len(texts) == len(others)
    joined = "\n".join(texts)
    for frame in others:
        assert f"{frame.can_id:03X} " in joined
        assert frame.data.hex().upper() in joined


def test_values_are_those_of_the_reader_of_single_frames(run: Motion) -> None:
    frame = next(f for f in Wire(run).cycle(120) if f.can_id == 0x199)
    fields = {field.name: field for field in FrameReader(DEVICES.values()).read(frame.can_id, frame.data).fields}
    ((text,),) = lines_of([frame]).values()
    assert text.startswith("199 feedback of elbow  ")
    assert f"Statusword {fields['Statusword'].value}" in text
    position = float(text.split("Position actual value ")[1].split()[0])
    assert abs(position - float(fields["Position actual value"].value)) < 1e-5


def test_services_are_told_in_words_under_their_own_paths() -> None:
    lines = lines_of([SDO, EMCY])
    assert set(lines) == {"can/602_SDO_request_to_planner", "can/099_EMCY_of_elbow"}
    assert "2001h sub 0" in lines["can/602_SDO_request_to_planner"][0]
    assert "2310h" in lines["can/099_EMCY_of_elbow"][0]


def test_a_frame_of_the_wrong_length_and_an_unknown_one_are_shown_as_bytes() -> None:
    lines = lines_of([Frame(0x199, b"\x01\x02", 1), Frame(0x7F1, b"\xab", PERIOD_NS)])
    assert "0102" in lines["can/199_feedback_of_elbow"][0]
    assert any("AB" in text for path, some in lines.items() if path.startswith("can/7F1") for text in some)
