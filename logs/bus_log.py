"""Every frame of a run in candump's log format: `(0000000001.234567) can0 181#1122AABB`, one line each.

The log is the truth of a run: text, readable with any CAN tool, and readable up to the last lines after SIGKILL.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType

from drivers.clock import LAST, Clock
from drivers.frame import MAX_CAN_ID, Frame

FLUSH_PERIOD_NS = 2_000_000


class BusLogError(ValueError):
    """A line that is no frame; says which line of which file, and what is wrong with it."""


class BusLogWriter:
    """Observer of a bus that writes each frame. Only complete lines reach the file.

    With a `clock`, no line waits longer than `flush_ns` of bus time; without one, a line may wait for the next frame.
    An error of the file system (disk full) never gets into the run: it is given to `on_error` once, and the log ends
    there, with what was written so far.
    """

    def __init__(
        self,
        path: Path,
        channel: str = "can0",
        *,
        clock: Clock | None = None,
        flush_ns: int = FLUSH_PERIOD_NS,
        on_error: Callable[[OSError], None] | None = None,
    ) -> None:
        """Raises OSError when the file cannot be made, ValueError for a channel name that the format cannot carry."""
        if not re.fullmatch(r"[!-~]+", channel):
            raise ValueError(f"channel {channel!r}: must be a name of ASCII letters without spaces")
        if flush_ns < 0:
            raise ValueError(f"flush_ns {flush_ns}: must not be negative")
        self.frames = 0
        """Frames handed to the system."""
        self.error: OSError | None = None
        self._names = [f") {channel} {can_id:03X}#" for can_id in range(MAX_CAN_ID + 1)]
        self._clock = clock
        self._flush_ns = flush_ns
        self._due_ns = 0
        self._lines: list[str] = []
        self._on_error = on_error
        self._file = path.open("wb", buffering=0)

    def __call__(self, frame: Frame) -> None:
        can_id, data, t_ns = frame
        if not self._lines:
            self._start_waiting(t_ns)
        # ten digits of seconds, six of microseconds (rounded down: keeps the order), after a leading one to cut off
        digits = str(10_000_000_000_000_000 + t_ns // 1000)
        self._lines.append(f"({digits[1:11]}.{digits[11:]}{self._names[can_id]}{data.hex().upper()}\n")
        if t_ns >= self._due_ns:
            self.flush()

    def _start_waiting(self, t_ns: int) -> None:
        self._due_ns = t_ns + self._flush_ns
        if self._clock is not None:
            self._clock.call_at(self._clock.now_ns() + self._flush_ns, self.flush, LAST + 1)

    def fileno(self) -> int:
        """The system's number of the open file."""
        return self._file.fileno()

    def flush(self) -> None:
        """Hands all lines to the system now."""
        lines, self._lines = self._lines, []
        if self.error is not None or not lines:
            return
        rest = "".join(lines).encode("ascii")
        try:
            while rest:  # an unbuffered write may take less than it is given
                rest = rest[self._file.write(rest) or 0 :]
        except OSError as error:
            self._fail(error)
            return
        self.frames += len(lines)

    def close(self) -> None:
        """Writes what is left. May be called again."""
        if self._file.closed:
            return
        self.flush()
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        if self.error is None:
            self.error = error
            if self._on_error is not None:
                self._on_error(error)

    def __enter__(self) -> BusLogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


_LINE = re.compile(r"\((\d+)\.(\d{6})\) (\S+) ([0-9A-Fa-f]{3})#((?:[0-9A-Fa-f]{2}){0,8})")


def parse_line(line: str) -> tuple[str, Frame]:
    """One line without its end -> (channel, frame). Raises ValueError that says what is wrong."""
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(f"{line[:80]!r} is no frame; must look like '(0000000001.234567) can0 181#1122AABB'")
    seconds, microseconds, channel, can_id, data = match.groups()
    if int(can_id, 16) > 0x7FF:
        raise ValueError(f"identifier {can_id} has more than 11 bits; must be 000 … 7FF")
    t_ns = (int(seconds) * 1_000_000 + int(microseconds)) * 1000
    return channel, Frame(int(can_id, 16), bytes.fromhex(data), t_ns)


def read_bus_log(path: Path, channel: str | None = None) -> Iterator[Frame]:
    """The frames of a log in the order of the file, of one channel or of all. Empty lines are skipped.

    A last line without its end is what a killed writer leaves: it is left out. Raises BusLogError with file and line
    number for any other line that is no frame, and for time that runs backwards; OSError when the file cannot be read.
    """
    with path.open("r", encoding="ascii", errors="replace", newline="\n") as lines:
        yield from _frames(lines, path, channel)


def _frames(lines: Iterable[str], path: Path, channel: str | None) -> Iterator[Frame]:
    last_ns = 0
    for number, line in enumerate(lines, start=1):
        if not line.endswith("\n"):
            return
        text = line.rstrip("\r\n")
        if not text:
            continue
        try:
            name, frame = parse_line(text)
        except ValueError as error:
            raise BusLogError(f"{path}, line {number}: {error}") from None
        if frame.t_ns < last_ns:
            raise BusLogError(f"{path}, line {number}: {last_ns - frame.t_ns} ns before the line above it")
        last_ns = frame.t_ns
        if channel is None or name == channel:
            yield frame
