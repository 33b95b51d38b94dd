"""How busy a bus is: mean over all the time, and peak over fixed windows."""

from __future__ import annotations


class LoadMeter:
    """Adds up busy intervals, given in the order of time and without overlap, split at the borders of the windows."""

    __slots__ = ("_end_ns", "_peak_ns", "_start_ns", "_window_busy_ns", "_window_end_ns", "busy_ns", "window_ns")

    def __init__(self, start_ns: int, window_ns: int) -> None:
        if window_ns < 1:
            raise ValueError(f"window_ns {window_ns}: must be at least 1")
        self.window_ns = window_ns
        self.busy_ns = 0
        self._start_ns = start_ns
        self._end_ns = start_ns
        self._window_end_ns = start_ns + window_ns
        self._window_busy_ns = 0
        self._peak_ns = 0

    def add(self, start_ns: int, end_ns: int) -> None:
        """The bus is busy from `start_ns` to `end_ns`."""
        self.busy_ns += end_ns - start_ns
        self._end_ns = end_ns
        if end_ns < self._window_end_ns:
            self._window_busy_ns += end_ns - start_ns
            return
        while end_ns >= self._window_end_ns:
            self._window_busy_ns += max(0, self._window_end_ns - start_ns)
            self._peak_ns = max(self._peak_ns, self._window_busy_ns)
            self._window_busy_ns = 0
            start_ns = max(start_ns, self._window_end_ns)
            idle_windows = (start_ns - self._window_end_ns) // self.window_ns
            self._window_end_ns += (1 + idle_windows) * self.window_ns
        self._window_busy_ns += end_ns - start_ns

    def mean(self, now_ns: int) -> float:
        """Busy part of the time since the start; 0 when none has passed."""
        elapsed_ns = max(now_ns, self._end_ns) - self._start_ns
        return self.busy_ns / elapsed_ns if elapsed_ns else 0.0

    def peak(self, now_ns: int) -> float:
        """Highest load of a window that is over; the mean as long as none is."""
        peak_ns = self._peak_ns
        if now_ns >= self._window_end_ns:
            peak_ns = max(peak_ns, self._window_busy_ns)
        elif self._window_end_ns == self._start_ns + self.window_ns:
            return self.mean(now_ns)
        return peak_ns / self.window_ns
