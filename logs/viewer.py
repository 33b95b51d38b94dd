"""Opening a recording in the Rerun viewer that came with the SDK."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import rerun_cli


def viewer_command(recording: Path, *, web: bool = False) -> list[str]:
    """The viewer's native binary (the `rerun` script only wraps it), bound to this machine alone."""
    binary = Path(rerun_cli.__file__).with_name("rerun")
    return [str(binary), str(recording), "--bind", "127.0.0.1", *(["--web-viewer"] if web else [])]


def has_display() -> bool:
    """Whether a window can be opened here (X11 or Wayland; always on other systems than Linux)."""
    return os.name != "posix" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_viewer(recording: Path, *, web: bool = False) -> int:
    """Runs the viewer until it is closed; its exit code."""
    return subprocess.run(viewer_command(recording, web=web), check=False).returncode


def is_torn(recording: Path) -> bool:
    """Whether the file lacks the footer that a closed recording ends with."""
    with recording.open("rb") as file:
        file.seek(max(0, recording.stat().st_size - 64))
        return _FOOTER not in file.read()


_FOOTER = b"RRF2FOOT"
