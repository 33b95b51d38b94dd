"""Frames as a table of signals, decoded with the DBC: one row for each signal of each frame, for pandas and spreadsheets."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path

import cantools

from drivers.export import DBC_NAME, dbc_files
from drivers.frame import Frame

COLUMNS = ("time_s", "can_id", "sender", "message", "signal", "value", "unit", "data")
_Row = tuple[str, str, str, str, str, str, str, str]


class SignalRows:
    """Turns frames into rows of COLUMNS, all text.

    `value` is physical (scaled, in `unit`); enumerations stay numbers. A frame without signals (SYNC), of an unknown
    identifier or too short for its message makes one row without `signal` and `value`. `data` is the frame in hex, in the
    first row of each frame only: the rows that have it are the frames.
    """

    def __init__(self) -> None:
        database = cantools.database.load_string(dbc_files()[DBC_NAME], "dbc")
        self._messages = {message.frame_id: message for message in database.messages}
        self._units = {
            (message.frame_id, signal.name): signal.unit or ""
            for message in database.messages
            for signal in message.signals
        }

    def rows(self, frame: Frame) -> Iterator[_Row]:
        """The rows of one frame, signals in the order of the DBC."""
        time_s = f"{frame.t_ns * 1e-9:.6f}"
        can_id = f"{frame.can_id:03X}"
        message = self._messages.get(frame.can_id)
        name = "" if message is None else message.name
        sender = ", ".join(message.senders) if message is not None else ""
        values: dict[str, float] = {}
        if message is not None and message.signals and len(frame.data) >= message.length:
            values = message.decode_simple(frame.data, decode_choices=False)
        data = frame.data.hex().upper()
        if not values:
            yield time_s, can_id, sender, name, "", "", "", data
        for signal, value in values.items():
            yield time_s, can_id, sender, name, signal, f"{value:.9g}", self._units[frame.can_id, signal], data
            data = ""


def write_csv(frames: Iterable[Frame], path: Path) -> int:
    """Writes the table with its head line and returns the number of frames. OSError where `path` cannot be written."""
    table = SignalRows()
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for frame in frames:
            count += 1
            writer.writerows(table.rows(frame))
    return count
