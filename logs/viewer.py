"""Opening a recording in the Rerun viewer that came with the SDK."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import time
from pathlib import Path

import rerun_cli

PORT = 9876
"""Of the viewer's gRPC server, its own default."""
START_S = 30.0


def viewer_command(recording: Path, *, web: bool = False) -> list[str]:
    """The viewer, bound to this machine alone."""
    return [str(_binary()), str(recording), "--bind", "127.0.0.1", *(["--web-viewer"] if web else [])]


def has_display() -> bool:
    """Whether a window can be opened here (X11 or Wayland; always on other systems than Linux)."""
    return os.name != "posix" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_viewer(recording: Path, *, web: bool = False) -> int:
    """Runs the viewer until it is closed; its exit code."""
    return subprocess.run(viewer_command(recording, web=web), check=False).returncode


def live_viewer(port: int = PORT) -> str:
    """Address of a viewer on this machine that shows what it is sent: the one that listens already, or a new one.

    Raises OSError where there is none and none can be opened.
    """
    if not _listens(port):
        if not has_display():
            raise OSError(f"no viewer listens on 127.0.0.1:{port}, and there is no display to open one on")
        command = [str(_binary()), "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
        viewer = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        began = time.monotonic()
        while not _listens(port):
            if viewer.poll() is not None or time.monotonic() - began > START_S:
                viewer.kill()
                raise OSError(f"the Rerun viewer did not start on port {port}")
            time.sleep(0.1)
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _listens(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


def _binary() -> Path:
    """The native one: the `rerun` script only wraps it, and leaves it running when it is ended."""
    return Path(rerun_cli.__file__).with_name("rerun")


def is_torn(recording: Path) -> bool:
    """Whether the file lacks the footer that a closed recording ends with."""
    with recording.open("rb") as file:
        file.seek(max(0, recording.stat().st_size - 64))
        return _FOOTER not in file.read()


_FOOTER = b"RRF2FOOT"
