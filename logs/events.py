"""Events of a run: what happened, when, how grave; `events.log` has one line for each."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from io import TextIOWrapper
from pathlib import Path


class Level(IntEnum):
    """How grave an event is; the values are those of Python's `logging`."""

    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40


@dataclass(frozen=True, slots=True)
class Event:
    """`text` is one line; `source` names the node or part that it is about, e.g. `planner`, `joint3`, `recorder`."""

    t_ns: int
    level: Level
    source: str
    text: str

    def line(self) -> str:
        """`   12.345678 WARN  planner        text`: time in s of the run, level, source, text."""
        text = " ".join(self.text.split())
        return f"{self.t_ns // 1000 / 1e6:12.6f} {self.level.name:<5} {self.source:<14} {text}"


class EventLog:
    """Writes `events.log`, line by line, so that a killed run leaves whole lines. A full disk is counted, not raised."""

    def __init__(self, path: Path) -> None:
        """Creates the file. Raises OSError if that cannot be done."""
        self._file: TextIOWrapper | None = path.open("w", encoding="utf-8", buffering=1)
        self.lost = 0
        """Events that could not be written."""

    def write(self, event: Event) -> None:
        """Appends one line."""
        if self._file is None:
            self.lost += 1
            return
        try:
            self._file.write(event.line() + "\n")
        except OSError:
            self.lost += 1

    def fileno(self) -> int:
        """The system's number of the open file; ValueError after `close`."""
        if self._file is None:
            raise ValueError("events.log is closed")
        return self._file.fileno()

    def close(self) -> None:
        """Closes the file; events that come later count as lost."""
        if self._file is None:
            return
        try:
            self._file.close()
        except OSError:
            self.lost += 1
        self._file = None
