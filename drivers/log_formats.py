"""Frames into the log formats of other people's tools, by python-can's writers."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable
from pathlib import Path

import can

from drivers.frame import Frame

MF4_PACKAGE = "asammdf"


class _FromZero(can.MF4Writer):
    """python-can counts from the moment of writing, 56 years after 0: what is left of a frame's time is then good to 0.2 µs."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._start_time = self.last_timestamp = 0.0
        self._mdf.header.abs_time = 0


_WRITERS: dict[str, Callable[[Path], can.io.generic.MessageWriter]] = {
    "asc": can.ASCWriter,
    "blf": can.BLFWriter,
    "mf4": _FromZero,
    "trc": can.TRCWriter,
}


def formats() -> tuple[str, ...]:
    """The formats that can be written here: mf4 only where the package asammdf is installed."""
    has_mdf = importlib.util.find_spec(MF4_PACKAGE) is not None
    return tuple(name for name in _WRITERS if name != "mf4" or has_mdf)


def write_log(frames: Iterable[Frame], name: str, path: Path) -> int:
    """Writes `frames` in the format `name` and returns how many. Times stay those of the run, which starts at 0.

    asc and trc hold times from the first frame on. Raises ValueError for what is not in `formats`, OSError where `path`
    cannot be written.
    """
    if name not in formats():
        raise ValueError(f"format {name!r}: must be one of {', '.join(formats())}")
    count = 0
    with _WRITERS[name](path) as writer:
        for frame in frames:
            count += 1
            writer.on_message_received(_message(frame))
    return count


def _message(frame: Frame) -> can.Message:
    return can.Message(
        timestamp=frame.t_ns * 1e-9,
        arbitration_id=frame.can_id,
        is_extended_id=False,
        data=frame.data,
        channel=0,
    )
