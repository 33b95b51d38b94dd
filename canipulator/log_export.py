"""`canipulator export`: the frames of a run in the formats of other tools."""

from __future__ import annotations

from pathlib import Path

from config.errors import ConfigError
from drivers.log_formats import MF4_PACKAGE, formats, write_log
from logs.bus_log import BusLogError, read_bus_log
from logs.signal_rows import write_csv


def export_log(run: Path, name: str, out: Path | None) -> tuple[Path, int]:
    """Converts the bus.log of `run` (its folder, or the log itself), by default to `bus.<format>` beside it.

    Returns the file and how many frames are in it. Raises ConfigError for a format or a run that is none and for a log
    that cannot be read (nothing is left of the file then), OSError where the file cannot be written.
    """
    valid = sorted((*formats(), "csv"))
    if name == "mf4" and name not in valid:
        raise ConfigError(
            f"--to mf4: needs {MF4_PACKAGE} of the extra canipulator[mf4], in the project's root: pip install -e '.[mf4]';"
            f" without it: {', '.join(valid)}"
        )
    if name not in valid:
        raise ConfigError(f"--to {name!r}: not a format here; valid: {', '.join(valid)}")
    log = run / "bus.log" if run.is_dir() else run
    if not log.is_file():
        raise ConfigError(f"{log}: no such file; RUN must be the folder of a run that had a bus")
    path = out or log.with_suffix(f".{name}")
    if path.resolve() == log.resolve():
        raise ConfigError(f"--out {path}: is the log itself")
    frames = read_bus_log(log)
    try:
        return path, write_csv(frames, path) if name == "csv" else write_log(frames, name, path)
    except BusLogError as error:
        path.unlink(missing_ok=True)
        raise ConfigError(str(error)) from None
