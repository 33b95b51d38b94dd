"""Frames into the log formats of other people's tools, by python-can's writers."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from pathlib import Path

import can

from drivers.frame import Frame

_WRITERS = {"asc": can.ASCWriter, "blf": can.BLFWriter, "mf4": can.MF4Writer, "trc": can.TRCWriter}


def formats() -> tuple[str, ...]:
    """The formats that can be written here: mf4 only where the package asammdf is installed."""
    has_mdf = importlib.util.find_spec("asammdf") is not None
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
