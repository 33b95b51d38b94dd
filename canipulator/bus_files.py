"""`canipulator bus export`: the DBC and EDS files for other people's tools."""

from __future__ import annotations

from pathlib import Path

from drivers.export import dbc_files, eds_files, write

BUS_DIRECTORY = Path(__file__).parent.parent / "config" / "bus"


def write_bus_files(what: str, directory: Path | None) -> list[Path]:
    """Writes the files of `what` (dbc or eds) into `directory`, by default where they are checked in. OSError where it cannot."""
    target = directory or BUS_DIRECTORY
    target.mkdir(parents=True, exist_ok=True)
    return write(target, dbc_files() if what == "dbc" else eds_files())
